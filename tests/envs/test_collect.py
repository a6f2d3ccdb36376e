"""The one place where rewards meet the feedback: windows of any environment, and what it refuses."""

from __future__ import annotations

from typing import Any, ClassVar

import pytest
import torch
from torch import Tensor

from credit.agents.random import Random
from credit.core.errors import RunError, UserError
from credit.core.problem import Problem
from credit.core.seams import Feedback, Transitions
from credit.core.store import Store
from credit.envs import spaces
from credit.envs.advertiser.environment import Advertiser
from credit.envs.exact.base import ExactEnvironment
from credit.envs.feedback import BlockSum, Success, Terminal
from credit.envs.sepsis.environment import Sepsis
from credit.judges import judge
from credit.judges.exact import AverageReward, Episodic
from credit.judges.rollouts import Rollouts
from credit.rivals.rules import Delayed
from credit.trainer import Trainer

from .collecting import Follow, begun
from .outside import Shelves, pushes


class Told(Feedback):
    """Keeps what it is shown."""

    objective: ClassVar = "sum"

    def __init__(self, window: int) -> None:
        self.window = window
        self.seen: list[Tensor] = []

    def start(self, problem: Problem) -> None: ...

    def __call__(self, rewards: Tensor) -> Tensor:
        self.seen.append(rewards)
        return rewards.sum(-1)


def test_an_environment_with_no_more_than_it_must_have() -> None:
    feedback = Told(12)
    collector, problem = begun(Shelves(), feedback, (3, 4))
    assert (problem.states, problem.actions, problem.finite_actions) == (12, 1, False)
    found, primitive = collector.collect(pushes(1, 3), 4)
    assert found.labels.shape == (2, 4)
    assert set(found.lengths[0].tolist()) == {2, 3}  # starts with 0 or 1 on the shelf
    assert set(found.lengths[1].tolist()) == {4, 7}
    states, arrivals = found.states, found.next_states
    for r in range(2):
        for last, length in zip(found.ends[r].tolist(), found.lengths[r].tolist(), strict=True):
            rows = slice(last + 1 - length, last + 1)
            assert torch.equal(states[r, rows][1:], arrivals[r, rows][:-1])
            assert (arrivals[r, rows] // 3 == 3).tolist() == [False] * (length - 1) + [True]
            assert (states[r, rows] % 3).tolist() == [t % 3 for t in range(length)]
            assert primitive[r, rows].tolist() == [0.25] * (length - 1) + [1.25]
    assert found.ended is not None
    assert found.terminated is not None
    assert torch.equal(found.ended, found.terminated)
    [shown] = feedback.seen  # one call, 0 behind the ends
    assert shown.shape == (2, 4, 12)
    assert torch.equal((shown != 0).sum(-1), found.lengths)
    assert torch.equal(shown.sum(-1), found.sums(primitive))


def test_an_episode_that_does_not_end_is_cut_at_the_window() -> None:
    collector, _ = begun(Shelves(), BlockSum(5, 0.0), (3,))
    found, _ = collector.collect(pushes(9), 2)
    assert found.lengths.tolist() == [[5, 5]]
    assert found.count is None
    assert found.ended is not None
    assert found.terminated is not None
    assert found.ended[0].nonzero().flatten().tolist() == [4, 9]
    assert not found.terminated.any()
    assert found.times[0].tolist() == [*range(5), *range(5)]


@pytest.mark.parametrize("copies", [1, 2, 3])
def test_as_many_copies_at_once_as_the_environment_says(copies: int) -> None:
    env = Shelves()
    env.copies = copies
    collector, problem = begun(env, Told(12), (3, 4))
    sizes: list[int] = []

    def act(states: Tensor, step: Tensor) -> Tensor:
        if int(step[0, 0]) == 0:
            sizes.append(states.shape[1])
        return pushes(1, 3).act(states, step)

    store = Store(problem)
    for _ in range(2):
        found, primitive = collector.collect(Follow(act), 5)
        assert found.labels.shape == (2, 5)
        assert torch.equal(found.sums(primitive), found.labels)
        assert found.valid is not None
        assert (primitive[~found.valid] == 0).all()
        store.append(found)
    assert sizes == {1: [1] * 10, 2: [2, 2, 1] * 2, 3: [3, 2] * 2}[copies]
    assert len(store) == 10


def test_the_primitive_reward_is_not_in_what_a_learner_gets() -> None:
    for env, feedback in ((Shelves(), BlockSum(6)), (Advertiser(), BlockSum(7)), (Sepsis(), Terminal(5))):
        collector, problem = begun(env, feedback)  # type: ignore[arg-type]
        still = Follow(lambda states, step: torch.zeros_like(states))
        found, primitive = collector.collect(still if problem.finite_actions else pushes(1), 2)
        assert found.primitive is None
        held = [value for value in vars(found).values() if isinstance(value, Tensor)]
        assert all(value.data_ptr() != primitive.data_ptr() for value in held)


class Cancelled(ExactEnvironment):
    """Another reward function whose windows have the same sum: rewards move by dyadic amounts that cancel.

    Args:
        env: whose steps. amount: by which all but the last reward of a window move, the last by the opposite.
    """

    def __init__(self, env: Any, amount: float) -> None:
        self.env, self.amount = env, amount
        self.setting = env.setting

    @property
    def mdp(self) -> Any:
        return self.env.mdp

    def start(self, problem: Problem, copies: int = 1, purpose: str = "environment") -> None:
        self.env.start(problem, copies, purpose)
        self._t, self._last = 0, problem.window - 1

    def reset(self, mask: Tensor | None = None) -> Tensor:
        self._t = 0
        return self.env.reset(mask)

    def step(self, actions: Tensor, mask: Tensor | None = None) -> Transitions:
        out = self.env.step(actions, mask)
        exact = (out.rewards * 2**20).round() / 2**20  # sums of these are exact
        moved = exact - self.amount * self._last if self._t == self._last else exact + self.amount
        self._t = 0 if self._t == self._last else self._t + 1
        return out._replace(rewards=moved)

    def _draw(self, row: Tensor, uniform: Tensor) -> tuple[Tensor, Tensor]:
        raise NotImplementedError


@pytest.mark.parametrize("env", [Advertiser(), Sepsis()])
def test_other_rewards_with_the_same_labels_give_the_same_windows_to_the_bit(env: Any) -> None:
    found = []
    for amount in (0.0, 0.5):
        collector, problem = begun(Cancelled(env, amount), BlockSum(5, 0.2), (3, 4))
        act = Follow(lambda states, step: (states * 5 + step) % problem.actions)  # noqa: B023
        found.append(collector.collect(act, 20))
    (plain, rewards), (other, moved) = found
    for name, value in vars(plain).items():
        same = getattr(other, name)
        assert torch.equal(value, same) if isinstance(value, Tensor) else value == same, name
    assert not torch.equal(rewards, moved)  # the judge sees the difference


def test_a_fact_is_shown_instead_of_the_reward_where_the_feedback_reads_it() -> None:
    class Goals(Shelves):
        """Success is another thing than a positive reward."""

        def step(self, actions: Tensor, mask: Tensor | None = None) -> Transitions:
            out = super().step(actions, mask)
            return out._replace(facts={"success": torch.zeros_like(out.rewards)})

    for env, expected in ((Shelves(), [[1, 1]]), (Goals(), [[0, 0]])):
        collector, _ = begun(env, Success(6))
        found, primitive = collector.collect(pushes(1), 2)
        assert found.labels.tolist() == expected
        assert primitive.max() == 1.25


def test_a_last_reward_needs_windows_that_end_together() -> None:
    class Last(Terminal):
        whole: ClassVar = True

    with pytest.raises(UserError, match=r"Last reads the reward of a window's last step.*Shelves may end before"):
        begun(Shelves(), Last(5))
    begun(Sepsis(), Last(5))


def test_a_last_reward_is_that_of_the_last_step_that_there_was() -> None:
    collector, _ = begun(Shelves(), Terminal(6), (3, 4))
    windows, primitive = collector.collect(pushes(2), 2)
    assert torch.equal(windows.labels, primitive.gather(1, windows.ends))


class Endless(Shelves):
    """Says that it goes on for ever, and has as many copies as anybody likes."""

    def problem(self, window: int, seeds: tuple[int, ...], device: torch.device | str) -> Problem:
        return spaces.problem(self.seen, self.done, window, seeds, device, episodic=False)


def test_a_task_that_goes_on_for_ever_has_one_copy() -> None:
    with pytest.raises(UserError, match=r"Endless goes on for ever and says copies=None, ends_early=True.*copies = 1"):
        begun(Endless(), BlockSum(5))


class Lying(Endless):
    """Says that nothing ends, and ends."""

    copies = 1
    ends_early: ClassVar = False


def test_an_end_that_was_denied_is_found() -> None:
    collector, _ = begun(Lying(), BlockSum(7))
    with pytest.raises(RunError, match=r"Lying ended an episode in step [12] of a window of 7"):
        collector.collect(pushes(1), 1)


def test_states_of_another_shape_are_refused() -> None:
    class Raw(Shelves):
        """Forgets to encode."""

        def reset(self, mask: Tensor | None = None) -> Tensor:
            super().reset(mask)
            return torch.from_numpy(self._shelves)

    collector, _ = begun(Raw(), BlockSum(5), (0, 1))
    with pytest.raises(UserError, match=r"Raw\.reset gave states torch\.int64 \[2, 3, 2\].*torch\.int64 \[2, 3\]"):
        collector.collect(pushes(1, 1), 3)


def test_evaluation_takes_nothing_from_the_run() -> None:
    def starts(evaluations: int) -> list[Tensor]:
        collector, _ = begun(Shelves(), BlockSum(6), (3, 4))
        evaluate = collector.evaluation(50)
        found = []
        for _ in range(3):
            found.append(collector.collect(pushes(1, 2), 8)[0].states)
            for _ in range(evaluations):
                episodes = evaluate(pushes(1, 2))
                assert episodes.windows.labels.shape == (2, 50)
                assert torch.equal(episodes.windows.sums(episodes.primitive), episodes.windows.labels)
        return found

    for never, often in zip(starts(0), starts(2), strict=True):
        assert torch.equal(never, often)


@pytest.mark.parametrize("make", [Shelves, Advertiser, Sepsis])
def test_a_collector_goes_on_where_it_stopped(make: Any) -> None:
    """The environment and the feedback are saved beside it, as a trainer does."""

    def parts() -> tuple[Any, ...]:
        env, feedback = make(), BlockSum(6)
        collector, problem = begun(env, feedback, (3, 4))
        evaluation = collector.evaluation(3)
        act = Follow(lambda s, t: (s + t) % problem.actions if problem.finite_actions else pushes(1, 2).act(s, t))
        return env, feedback, collector, evaluation, act

    env, feedback, collector, evaluation, act = parts()
    for count in (2, 1, 2):
        collector.collect(act, count)
        evaluation(act)
    saved = [part.state_dict() for part in (env, feedback, collector, evaluation)]
    on = [(collector.collect(act, count), evaluation(act)) for count in (2, 3)]
    *others, again = parts()
    for part, state in zip(others, saved, strict=True):
        part.load_state_dict(state)
    for ((found, primitive), looked), count in zip(on, (2, 3), strict=True):
        same, rewards = others[2].collect(again, count)
        assert torch.equal(found.states, same.states)
        assert torch.equal(found.labels, same.labels)
        assert torch.equal(primitive, rewards)
        assert torch.equal(looked.primitive, others[3](again).primitive)


def test_the_judge_is_exact_where_there_is_truth() -> None:
    for env, feedback, expected in (
        (Advertiser(), BlockSum(7), AverageReward),
        (Sepsis(), Terminal(5), Episodic),
        (Shelves(), BlockSum(6), Rollouts),
    ):
        collector, problem = begun(env, feedback)  # type: ignore[arg-type]
        found = judge(env, feedback, problem, collector.evaluation)  # type: ignore[arg-type]
        assert type(found) is expected


class Median(Feedback):
    """An objective of its own."""

    objective: ClassVar = "median"

    def __init__(self, window: int) -> None:
        self.window = window

    def start(self, problem: Problem) -> None: ...

    def __call__(self, rewards: Tensor) -> Tensor:
        return rewards.median(-1).values


@pytest.mark.parametrize("env", [Advertiser(), Sepsis()])
def test_an_objective_that_nobody_can_judge_is_refused(env: Any) -> None:
    collector, problem = begun(env, Median(5))
    with pytest.raises(UserError, match="asks for 'median'"):
        judge(env, Median(5), problem, collector.evaluation)


class Unsaid(Feedback):
    """Does not say what it asks for."""

    def __init__(self, window: int) -> None:
        self.window = window

    def start(self, problem: Problem) -> None: ...

    def __call__(self, rewards: Tensor) -> Tensor:
        return rewards.amax(-1)


class Older(Unsaid):
    """Says it in an older version's words."""

    additive = False


class Wrong(Unsaid):
    """Says something that is no name."""

    objective: ClassVar = True


@pytest.mark.parametrize(
    ("feedback", "message"),
    [
        (Unsaid, "Unsaid does not say its objective.*'sum'.*'last'.*'success'"),
        (Older, "additive = False.*declare objective = 'last'"),
        (Wrong, "objective = True.*'sum'.*'last'.*'success'"),
    ],
)
@pytest.mark.parametrize("env", [Advertiser(), Shelves()])
def test_a_feedback_says_its_objective(env: Any, feedback: Any, message: str) -> None:
    with pytest.raises(UserError, match=message):
        Trainer(env, feedback(5), Delayed(), Random(), 100).start((0,))


def test_sizes_of_evaluations_are_the_environments() -> None:
    env = Shelves()
    env.evaluation_episodes = 7
    asked: list[int] = []
    collector, problem = begun(env, BlockSum(6))

    def evaluation(episodes: int) -> Any:
        asked.append(episodes)
        return collector.evaluation(episodes)

    found = judge(env, BlockSum(6), problem, evaluation)
    values = found.measure({"behaviour": pushes(1)}, None)
    assert asked == [7]
    assert values["eval/return"].shape == (1,)
    assert not any("success" in name for name in values)  # nobody said what a success is
