"""The six arrows: replicas do not touch each other, no primitive reward leaks, a run ends well or with a reason."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch

from credit.config import files, registry
from credit.core.errors import RunError, UserError
from credit.core.policy import Policy
from credit.core.seams import Agent, CreditAssigner
from credit.core.store import Store
from credit.core.windows import Windows
from credit.envs.collect import Collector
from credit.envs.feedback import BlockSum
from credit.runs import job
from credit.trainer import Trainer

ALL = files.options("method")
MAIN = {"block", "delayed", "disagreement", "oracle", "reference"}  # the others are their parts in other combinations
Make = Callable[..., Trainer]
Journal = list[tuple[int, dict[str, torch.Tensor]]]


@pytest.fixture(params=[pytest.param(name, marks=() if name in MAIN else pytest.mark.slow) for name in sorted(ALL)])
def method(request: pytest.FixtureRequest) -> str:
    """Every method that runs on the advertiser."""
    name = str(request.param)
    if name not in MAIN and (problems := job.check(registry.compose(["tracking=none", f"method={name}"])).problems):
        pytest.skip(problems[0])
    return name


def run(trainer: Trainer) -> Journal:
    journal: Journal = []
    trainer.run(lambda step, values: journal.append((step, values)))
    return journal


def experience(trainer: Trainer) -> tuple[torch.Tensor, ...]:
    windows = trainer.store.windows
    return windows.states, windows.actions, windows.next_states, windows.labels


def test_a_replica_goes_alone_as_in_a_batch(make_trainer: Make, method: str) -> None:
    seeds = (40, 41, 42, 43, 44)
    batch = make_trainer(method, seeds, "trainer.steps=280")
    together = run(batch)
    for index in (0, 3):
        alone = make_trainer(method, (seeds[index],), "trainer.steps=280")
        journal = run(alone)
        for mine, theirs in zip(experience(alone), experience(batch), strict=True):
            assert torch.equal(mine[0], theirs[index])
        for (_, mine), (_, theirs) in zip(journal, together, strict=True):
            for name in mine:
                torch.testing.assert_close(mine[name][0], theirs[name][index], equal_nan=True, rtol=1e-7, atol=1e-9)


@pytest.mark.slow
def test_a_replica_goes_alone_as_in_a_large_batch(make_trainer: Make, method: str) -> None:
    batch = make_trainer(method, tuple(range(64)), "trainer.steps=560")
    alone = make_trainer(method, (37,), "trainer.steps=560")
    run(batch)
    run(alone)
    for mine, theirs in zip(experience(alone), experience(batch), strict=True):
        assert torch.equal(mine[0], theirs[37])


def test_one_seed_one_run_and_another_seed_another(make_trainer: Make, method: str) -> None:
    first, again, other = (make_trainer(method, seeds, "trainer.steps=210") for seeds in ((1, 2), (1, 2), (3, 4)))
    for trainer in (first, again, other):
        run(trainer)
    assert all(torch.equal(a, b) for a, b in zip(experience(first), experience(again), strict=True))
    assert not torch.equal(experience(first)[3], experience(other)[3])
    assert not torch.equal(experience(first)[3][0], experience(first)[3][1])


class SpyOptimizer(Agent):
    """Acts by the state, and keeps the windows that it and the assigner are given."""

    def __init__(self) -> None:
        self.seen: list[Windows] = []

    def start(self, problem: Any) -> None: ...

    def act(self, states: torch.Tensor, step: torch.Tensor) -> torch.Tensor:
        return (states + step) % 3

    def improve(self, store: Store, assigner: CreditAssigner) -> None:
        self.seen += [store.new, store.windows]

    def policies(self) -> dict[str, Policy]:
        return {}


def test_only_the_oracle_is_given_primitive_rewards(make_trainer: Make, method: str) -> None:
    trainer = make_trainer(method, (0, 1), "trainer.steps=70")
    seen: list[Windows] = []
    for part, name in ((trainer.assigner, "observe"), (trainer.agent, "improve")):
        original = getattr(part, name)

        def spy(store: Store, *more: Any, original: Callable[..., None] = original) -> None:
            seen.extend((store.new, store.windows))
            original(store, *more)

        setattr(part, name, spy)
    run(trainer)
    assert len(seen) == 40  # two parts, ten windows, new and all of them
    shown = [windows.primitive is not None for windows in seen]
    assert any(shown) == (method == "oracle")


def test_a_window_cut_short_counts_in_the_regret_alone(make_trainer: Make) -> None:
    # random actions depend on the seed alone, so both runs start with the same ten windows
    whole, longer = (make_trainer("random", (0, 1), f"trainer.steps={steps}") for steps in (70, 74))
    cut = whole_regret = None
    for trainer, rows in ((whole, run(whole)), (longer, run(longer))):
        assert len(trainer.store) == 10
        step, values = rows[-1]
        if trainer is whole:
            assert step == 70
            whole_regret = values["regret/cumulative"]
        else:
            assert step == 74
            cut = values["regret/cumulative"]
    assert all(torch.equal(a, b) for a, b in zip(experience(whole), experience(longer), strict=True))
    reward = longer.env.mdp.reward  # type: ignore[attr-defined]
    assert cut is not None
    extra = cut - whole_regret
    assert ((extra >= 4 * (0.037222 - reward.max()) - 1e-4) & (extra <= 4 * (0.037223 - reward.min()))).all()
    assert (extra != 0).all()


def test_regret_is_that_of_all_steps_taken(make_trainer: Make) -> None:
    trainer = make_trainer("reference", (0, 1), "trainer.steps=353")
    rewards: list[torch.Tensor] = []
    original = trainer.collector.collect

    def collect(*arguments: Any) -> Any:
        windows, primitive = original(*arguments)
        rewards.append(primitive)
        return windows, primitive

    trainer.collector.collect = collect  # type: ignore[method-assign]
    journal = run(trainer)
    taken = torch.cat(rewards, 1)
    assert taken.shape[1] == 353
    gain = trainer.env.mdp.optimal.gain  # type: ignore[attr-defined]
    torch.testing.assert_close(journal[-1][1]["regret/cumulative"], 353 * gain - taken.sum(1))


@pytest.mark.parametrize(
    ("steps", "log_every", "per_round", "expected"),
    [
        (70, 3, 1, [21, 42, 63, 70]),
        (70, 5, 1, [35, 70]),  # the last row is not written twice
        (72, 5, 1, [35, 70, 72]),
        (70, 3, 4, [28, 56, 70]),  # rows fall on the ends of rounds
        (7, 40, 1, [7]),
    ],
)
def test_rows_of_the_journal(
    make_trainer: Make, steps: int, log_every: int, per_round: int, expected: list[int]
) -> None:
    trainer = make_trainer(
        "random",
        (0,),
        f"trainer.steps={steps}",
        f"trainer.log_every={log_every}",
        f"trainer.windows_per_round={per_round}",
    )
    told: list[int] = []
    journal: list[int] = []
    trainer.run(lambda step, values: journal.append(step), told.append)
    assert journal == expected
    assert told[-1] == steps
    assert told == sorted(told)
    assert len(trainer.store) == steps // 7


def test_rounds_of_several_windows_are_refitted_once(make_trainer: Make) -> None:
    trainer = make_trainer("random", (0,), "trainer.steps=70", "trainer.windows_per_round=4")
    spy = SpyOptimizer()
    trainer.agent = spy
    run(trainer)
    assert [windows.labels.shape[1] for windows in spy.seen[::2]] == [4, 4, 2]
    assert [windows.labels.shape[1] for windows in spy.seen[1::2]] == [4, 8, 10]


class Broken(BlockSum):
    """The label of one window of one replica is not finite."""

    def __init__(self, window: int, replica: int, value: float) -> None:
        super().__init__()
        self._at, self._replica, self._value, self._count = window, replica, value, 0

    def __call__(self, rewards: torch.Tensor) -> torch.Tensor:
        labels = super().__call__(rewards)
        if self._count <= self._at < self._count + labels.shape[1]:
            labels[self._replica, self._at - self._count] = self._value
        self._count += labels.shape[1]
        return labels


@pytest.mark.parametrize("per_round", [1, 4])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
def test_a_label_that_is_not_finite_stops_the_run(make_trainer: Make, value: float, per_round: int) -> None:
    trainer = make_trainer(
        "reference", (10, 11, 12), "trainer.steps=140", "trainer.log_every=2", f"trainer.windows_per_round={per_round}"
    )
    trainer.feedback = Broken(6, 1, value)
    trainer.feedback.start(trainer.problem)
    trainer.collector = Collector(trainer.env, trainer.feedback, trainer.problem)
    journal: list[int] = []
    with pytest.raises(RunError, match=rf"window 6 of seed 11 .*{value}"):
        trainer.run(lambda step, values: journal.append(step))
    assert journal == ([14, 28, 42] if per_round == 1 else [28])
    assert len(trainer.store) == (6 if per_round == 1 else 4)
    assert torch.isfinite(trainer.store.windows.labels).all()


def test_a_run_shorter_than_a_window_is_refused(make_trainer: Make) -> None:
    trainer = make_trainer("random", (0,))
    trainer.steps = 6
    with pytest.raises(UserError, match=r"trainer\.steps=6.*feedback\.window=7"):
        trainer.start((0,))


def test_the_oracle_runs_with_exact_resampling(make_trainer: Make) -> None:
    exact = make_trainer("oracle", (0,), "trainer.steps=70", "uncertainty.resample=exact")
    online = make_trainer("oracle", (0,), "trainer.steps=70")
    run(exact)
    run(online)
    assert torch.equal(exact.store.windows.actions, online.store.windows.actions)


@pytest.mark.parametrize("method", ["reference", "adaptive_mse", "disagreement"])
def test_exact_resampling_runs_and_is_independent_of_the_batch(make_trainer: Make, method: str) -> None:
    overrides = ("trainer.steps=140", "uncertainty.resample=exact", "uncertainty.draws=4")
    batch, alone = make_trainer(method, (4, 5), *overrides), make_trainer(method, (5,), *overrides)
    run(batch)
    run(alone)
    assert torch.equal(batch.store.windows.actions[1], alone.store.windows.actions[0])
