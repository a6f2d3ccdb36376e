"""What those owe who decide what happens: environments, and the feedback that labels it."""

from __future__ import annotations

import torch

from credit.agents.random import Random
from credit.config import schema
from credit.core import contracts
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Environment, Feedback
from credit.core.windows import Windows
from credit.envs.collect import Collector
from credit.judges.choose import judge
from credit.rounds import problem_of
from credit.runs.intervals import is_rate
from credit.testing.cases import Case
from credit.testing.expect import close, expect, finite, shaped
from credit.testing.short import SEEDS


def environment(case: Case) -> None:
    """Windows are whole, in the problem's spaces, and can be judged."""
    env, feedback, problem = started(case)
    random = Random()
    random.start(problem)
    collector = Collector(env, feedback, problem)
    judged = judge(env, feedback, problem, collector.evaluation)
    demonstrations = env.demonstrations()
    rounds = [collector.collect(random, 3), *([demonstrations] if demonstrations else [])]
    for windows, primitive in rounds:
        whole(windows, primitive, problem)
    judged.update(*rounds[0], random)
    values = judged.measure(random.policies(), None)
    expect(judged.metric in values, f"the judge measured {sorted(values)}, and not {judged.metric}")
    for name, value in values.items():
        shaped(value, (2,), f"the metric {name}")
        if is_rate(name, judged.rates, values):
            expect(not ((value < 0) | (value > 1)).any(), f"the judge calls {name} a rate, and it is {value.tolist()}")
    grid = env.grid()
    expect(grid is None or len(grid.states) == len(grid.actions), "grid() has not as many states as actions")
    expect(isinstance(env.picture(1), dict), "picture() must be a dict")
    stays(env.twin(), problem)


def stays(env: Environment, problem: Problem) -> None:
    """A copy that is not in the mask stays where it is, while others act and begin anew.

    Args:
        env: to be started. problem: of its sizes.
    """
    env.start(problem, 2, "copies side by side")
    random = Random()
    random.start(problem)
    now = env.reset().clone()
    first = torch.tensor([[True, False]] * problem.replicas, device=problem.device)
    before = now
    for step, mask in enumerate([None, None, first, first]):  # all, then one of two
        out = env.step(random.act(now, torch.full((problem.replicas, 2), step)), mask)
        before = out.states.clone() if mask is None else before
        if any(over is not None and over.any() for over in (out.terminated, out.truncated)):
            break
    after = env.reset(first)
    right = torch.equal(after[:, 1], before[:, 1])
    expect(right, "a copy that is not in the mask of step and reset does not stay as it is")


def whole(windows: Windows, primitive: torch.Tensor, problem: Problem) -> None:
    """Rows, lengths and ends of collected windows go together."""
    expect(windows.labels.shape[0] == problem.replicas, "there are not labels for every replica")
    shaped(primitive, windows.states.shape[:2], "the primitive rewards")
    expect(windows.primitive is None, "a learner would be shown the primitive reward")
    shaped(windows.next_states, windows.states.shape, "the next states")
    if problem.finite_states:
        inside = ((windows.states >= 0) & (windows.states < problem.states)).all()
        expect(inside, f"states are not all in 0 … {problem.states - 1}")
    else:
        width = windows.states.shape[2]
        expect(
            width == problem.observations, f"a state has {width} numbers, and the problem says {problem.observations}"
        )
    lengths = windows.lengths
    expect(((lengths >= 1) & (lengths <= problem.window)).all(), f"windows have from 1 to {problem.window} steps")
    once = windows.sums(windows.final.long())
    expect(torch.equal(once, torch.ones_like(windows.labels).long()), "a window has not one last step")
    if windows.terminated is not None:
        expect(windows.ended is not None, "steps are terminal, and none is said to end an episode")
        assert windows.ended is not None
        expect(windows.ended[windows.terminated].all(), "a terminal step does not end its episode")


def feedback(case: Case) -> None:
    """Labels are finite, of the kind that they are said to be, of their own window, and the same for the same seeds."""
    labels = []
    for _ in range(2):
        env, part, problem = started(case)
        expect(isinstance(part, Feedback), f"{type(part).__name__} is no Feedback")
        random = Random()
        random.start(problem)
        windows, primitive = Collector(env, part, problem).collect(random, 3)
        whole(windows, primitive, problem)
        finite(windows.labels, "the labels")
        bits = ((windows.labels == 0) | (windows.labels == 1)).all()
        expect(part.kind != "bits" or bits, "kind says bits, and a label is neither 0 nor 1")
        labels.append(windows.labels)
    expect(torch.equal(*labels), "the same seeds gave other labels: draw noise from a Stream, made in `start`")
    of_its_window(case)


def of_its_window(case: Case) -> None:
    """A label does not depend on how far windows reach that lie beside its own."""
    found = list[torch.Tensor]()
    for behind in (0, 1):
        _, part, problem = started(case)
        most = max(problem.window - 1, 1)
        lengths = torch.tensor([[most, (most + 1) // 2, 1]] * problem.replicas)
        rewards = 1 + torch.rand(*lengths.shape, most, dtype=FLOAT, generator=torch.Generator().manual_seed(0))
        rewards *= torch.arange(most) < lengths.unsqueeze(-1)
        if part.whole or most == problem.window:
            return
        found.append(part.label(torch.nn.functional.pad(rewards, (0, behind)), lengths))
    what = "zeros behind the end of a window change its label: give `rule` (`Labels`), or heed the lengths in `label`"
    close(found[0], found[1], what)


def started(case: Case) -> tuple[Environment, Feedback, Problem]:
    """The environment and the feedback of a run, watched and started."""
    env, part = schema.build(case.config, "env"), schema.build(case.config, "feedback")
    expect(isinstance(env, Environment), f"{type(env).__name__} is no Environment")
    problem = problem_of(env, part, SEEDS, "cpu", rolling=False)
    contracts.watch(env, problem, "env")
    contracts.watch(part, problem, "feedback")
    env.start(problem)
    part.start(problem)
    return env, part, problem
