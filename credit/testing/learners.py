"""What those owe who turn windows into behaviour: credit assigners, transition models, agents."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from credit.agents.random import Random
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Agent, CreditAssigner, Encoder, Transition
from credit.core.windows import Windows
from credit.networks.modules import Network
from credit.networks.seeding import seeded
from credit.testing.cases import Case
from credit.testing.expect import close, expect, finite, shaped
from credit.testing.kept import kept


def assigner(case: Case) -> None:
    """Every step has a reward; a redistribution, which believes nothing, gives out the label, no more and no less."""
    part, _, store = case.assigned()
    expect(isinstance(part, CreditAssigner), f"{type(part).__name__} is no CreditAssigner")
    windows = store.windows
    rewards = part.rewards(windows)
    shaped(rewards, windows.states.shape[:2], "the rewards")
    finite(rewards, "the rewards")
    if part.belief() is None:
        close(windows.sums(rewards), windows.labels, "the rewards of a window must sum to its label")


def transition(case: Case) -> None:
    """Expected values are means of values, and do not depend on how windows are dealt out to `observe`."""
    first, problem, store = case.built("transition")
    second, _, _ = case.built("transition")
    values = torch.rand(2, problem.states, dtype=FLOAT, generator=torch.Generator().manual_seed(0))
    for part in (first, second):
        expect(isinstance(part, Transition), f"{type(part).__name__} is no Transition")
        part.start(problem)
    for seen in (False, True):
        if seen:
            first.observe(store.windows)
        when = "after windows" if seen else "before any window"
        total = first.backup(torch.ones_like(values))
        shaped(total, (2, problem.states, problem.actions), f"expected values {when}")
        right = ((total - 1).abs().lt(1e-9) | total.eq(0)).all()
        expect(right, f"{when}, the chances of all next states must sum to 1, or to 0 where nothing is known")
        found = first.backup(values)
        within = ((found >= 0) & (found <= values.amax() + 1e-9)).all()
        expect(within, f"{when}, an expected value is less or more than any value")
        close(first.backup(2 * values + 1), 2 * found + total, f"{when}, expected values must be linear in the values")
    if store.windows.length is not None:
        half = store.windows.labels.shape[1] * 2 // 3
        for piece in (slice(0, half), slice(half, None)):
            second.observe(part_of(store.windows, piece))
        close(second.backup(values), found, "windows in two parts must count as windows at once")


def part_of(windows: Windows, which: slice) -> Windows:
    """Some of the windows, which have equal lengths."""
    steps = (windows.states, windows.actions, windows.next_states)
    states, actions, arrivals = (windows.grid(part)[:, which] for part in steps)
    return Windows.of_grid(states, actions, arrivals, windows.labels[:, which])


def encoder(case: Case) -> None:
    """A state has one look, whatever stands beside it; no look changes another, and the state stays what it is."""
    part, problem, store = case.built("encoder")
    expect(isinstance(part, Encoder), f"{type(part).__name__} is no Encoder")
    part.start(problem)
    states = store.windows.states
    before = states.clone()
    for seen in (False, True):
        if seen:
            part.observe(store.windows)
        found = part(states)
        shaped(found, states.shape, "what networks see")
        finite(found, "what networks see")
        _typed(found, torch.float32, "what networks see")
        expect(torch.equal(states, before), "the states that it was given were changed in place")
        close(part(states[:, :1]), found[:, :1], "a state looks different beside others, or the second time")
        close(part(states[0])[0], found[0], "a state looks different where it is given for all replicas at once")


def network(case: Case) -> None:
    """One answer a row, whatever stands beside it, on float32; weights come from PyTorch's global generator alone."""
    part: Any = case.built("reference")[0].network
    expect(isinstance(part, Network), f"{type(part).__name__} is no Network")
    device, rows = torch.device("cpu"), torch.rand(4, 5, generator=torch.Generator().manual_seed(0))
    made = []
    for _ in range(2):
        with seeded(0, device):
            made.append(part.make(5, 3, device).eval())
    found = made[0](rows)
    shaped(found, (4, 3), "outputs")
    finite(found, "outputs")
    _typed(found, torch.float32, "outputs")
    expect(torch.equal(found, made[1](rows)), "two networks from one seed must have the same weights")
    close(made[0](rows[:1]), found[:1], "a row has another answer beside others")
    close(
        made[0](rows.view(2, 2, 5)), found.view(2, 2, 3), "rows [2, 2, inputs] have other answers than rows [4, inputs]"
    )
    expect(any(weight.requires_grad for weight in made[0].parameters()), "there is no weight that could learn")


def agent(case: Case) -> None:
    """Actions are the problem's, before and after learning, and of every policy; and each seed's policy can be kept."""
    part, problem, store = case.built("agent")
    assigner, _, _ = case.assigned()
    expect(isinstance(part, Agent), f"{type(part).__name__} is no Agent")
    part.start(problem)
    states = store.windows.states[:, :1]
    for learned in (False, True):
        if learned:
            part.improve(store, assigner)
        policies = part.policies()
        expect("behaviour" in policies, f"policies() has {sorted(policies)}, and one must be 'behaviour'")
        alone = problem.finite_actions and isinstance(part, Random)
        for name, one in {"the agent": part, **({} if alone else policies)}.items():
            for step in range(3):
                acts(one.act(states, torch.full((2, 1), step)), problem, f"actions of {name}")
        if problem.tabular and problem.episodic:
            chances = part.executed().probabilities(torch.arange(problem.states), 0)
            expect(chances is not None, "executed() cannot say its probabilities, and the exact judge asks for them")
            close(chances.sum(-1), torch.ones(2, problem.states, dtype=FLOAT), "probabilities must sum to 1")
    for name, value in part.diagnostics().items():
        shaped(value, (2,), f"diagnostics()[{name!r}]")
    kept(case, part, problem, store)


def acts(actions: Any, problem: Problem, what: str) -> None:
    """Actions of one copy of two replicas are in the problem's action space."""
    if problem.finite_actions:
        shaped(actions, (2, 1), what)
        _typed(actions, torch.int64, what)
        expect(((actions >= 0) & (actions < problem.actions)).all(), f"{what} are not all in 0 … {problem.actions - 1}")
    else:
        shaped(actions, (2, 1, problem.actions), what)
        _typed(actions, torch.float32, what)
        expect((actions.abs() <= 1).all(), f"{what} are not all in [−1, 1]")


def _typed(value: Tensor, dtype: torch.dtype, what: str) -> None:
    expect(value.dtype == dtype, f"{what} are {value.dtype}, and they must be {dtype}")
