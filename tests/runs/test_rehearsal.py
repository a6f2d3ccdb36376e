"""Somebody's own part that is nearly right is told so before a run, by its name; one that is right is not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from credit.agents.value_iteration import ValueIteration
from credit.config import registry
from credit.core.policy import Policy
from credit.envs.advertiser.environment import Advertiser
from credit.envs.feedback import BlockSum
from credit.planning.counts import Counts
from credit.recovery.bonuses import Count
from credit.recovery.features.tabular import Identity
from credit.recovery.mixers import RelativeMSE
from credit.recovery.uncertainty.bootstrap import Bootstrap
from credit.rivals.rules import Uniform
from credit.runs import job, rehearsal

RECOVERY = ("method=adaptive_mse",)
BONUS = ("method=reference", "bonus=[count]")
SPREAD = ("method=delayed", "assigner=uniform")


class Right(Count):
    """Keeps a running mean, made in start, and is random by its own stream."""

    def start(self, problem: Any) -> None:
        super().start(problem)
        self._mean, self._random = problem.zeros(), np.random.default_rng(problem.seeds[0])

    def __call__(self, *args: Any) -> Tensor:
        bonus = super().__call__(*args)
        self._mean = 0.5 * self._mean + bonus.mean(1)
        return bonus + self._mean.unsqueeze(1) * self._random.random()


class MadeLate(Uniform):
    def observe(self, store: Any) -> None:
        self._calls = getattr(self, "_calls", 0) + 1


class Forgetful(Bootstrap):
    """Has a state that the inherited `keeps` does not name."""

    def start(self, problem: Any) -> None:
        super().start(problem)
        self._seen = 1.0

    def weights(self, store: Any) -> Any:
        self._seen += 1
        return super().weights(store)._replace(values=super().weights(store).values * self._seen)


class Unseeded(Count):
    def __call__(self, *args: Any) -> Tensor:
        return super().__call__(*args) + torch.rand(())


class Opaque(Count):
    def start(self, problem: Any) -> None:
        super().start(problem)
        self.thing = object()


class NoBonus(Count):
    def __call__(self, *args: Any) -> Any:
        return None


class BonusOfAnotherShape(Count):
    def __call__(self, *args: Any) -> Tensor:
        return super().__call__(*args)[:, :-1]


class NoNumber(Count):
    def __call__(self, *args: Any) -> Tensor:
        return super().__call__(*args) * torch.nan


class Raises(Count):
    def __call__(self, *args: Any) -> Tensor:
        return {}["visits"]  # type: ignore[no-any-return]


class Third(RelativeMSE):
    def weights(self, *args: Any) -> Tensor:
        return super().weights(*args) / 3


class Infinite(Identity):
    def __call__(self, steps: Any) -> Tensor:
        return super().__call__(steps) / 0


class Flat(BlockSum):
    def __call__(self, rewards: Tensor) -> Tensor:
        return super().__call__(rewards).flatten()


class TooFar(ValueIteration):
    def act(self, states: Tensor, step: Tensor) -> Tensor:
        return super().act(states, step) + 3


class Dumb(ValueIteration):
    def policies(self) -> dict[str, Policy]:
        return {}


class Even(Counts):
    def probabilities(self) -> Tensor:
        return super().probabilities() * 0.5


class Half(Uniform):
    def rewards(self, windows: Any) -> Tensor:
        return super().rewards(windows)[:, ::2]


class Nowhere(Advertiser):
    def step(self, actions: Tensor, mask: Tensor | None = None) -> Any:
        out = super().step(actions, mask)
        return out._replace(states=out.states + 7)


class Alone(Advertiser):
    def step(self, actions: Tensor, mask: Tensor | None = None) -> Any:
        return super().step(actions, mask)[:2]


def problems(monkeypatch: pytest.MonkeyPatch, part: type, *overrides: str) -> list[str]:
    base = part.__mro__[1]
    monkeypatch.setattr(f"{base.__module__}.{base.__name__}", part)
    monkeypatch.setattr(rehearsal, "_right", set())
    return job.check(registry.compose(["tracking=none", "replicas=3", *overrides])).problems


@pytest.mark.parametrize(
    ("part", "overrides", "said"),
    [
        (MadeLate, SPREAD, ["could not be stopped and gone on with", "MadeLate", "_calls", "`start`"]),
        (Forgetful, RECOVERY, ["uncertainty", "could not be stopped and gone on with", "`keeps`"]),
        (Unseeded, BONUS, ["bonus.count", "came to other numbers"]),
        (Opaque, BONUS, ["could not be stopped and gone on with (Opaque.thing is a object", "`keeps`"]),
        (NoBonus, BONUS, ["bonus.count: NoBonus.__call__", "None was given", "a tensor [2, 30]"]),
        (BonusOfAnotherShape, BONUS, ["BonusOfAnotherShape", "[2, 29]", "[2, 30]"]),
        (NoNumber, BONUS, ["NoNumber", "is nan at [0, 0]", "finite"]),
        (Raises, BONUS, ["Raises.__call__ raised KeyError: 'visits' (test_rehearsal.py, line "]),
        (Third, RECOVERY, ["mixer: Third.weights", "sum to 0.333", "sum to 1"]),
        (Infinite, RECOVERY, ["features: Infinite.__call__", "finite"]),
        (Flat, RECOVERY, ["feedback: Flat.__call__", "the labels", "[2]", "[2, 1]"]),
        (TooFar, RECOVERY, ["agent: TooFar.act", "actions hold", "0 to 2"]),
        (Dumb, RECOVERY, ["agent: Dumb.policies", "'behaviour'"]),
        (Even, RECOVERY, ["transition: Even.probabilities", "sums neither to 1 nor"]),
        (Half, SPREAD, ["assigner: Half.rewards", "[2, 4]", "[2, 7]"]),
        (Nowhere, RECOVERY, ["env: Nowhere.step", "next states hold", "0 to 9"]),
        (Alone, RECOVERY, ["env: Alone.step", "a tuple was given", "Transitions(states"]),
    ],
)
def test_what_is_nearly_right_is_told_so_by_name(
    part: type, overrides: tuple[str, ...], said: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = problems(monkeypatch, part, *overrides)
    assert len(found) == 1, found
    for piece in said:
        assert piece in found[0], found[0]


@pytest.mark.thorough
@pytest.mark.parametrize("experiment", ["advertiser", "sepsis", "pointmaze"])
def test_what_is_right_is_tried_once(experiment: str, monkeypatch: pytest.MonkeyPatch) -> None:
    overrides = (f"experiment={experiment}", *BONUS)
    assert problems(monkeypatch, Right, *overrides) == []
    monkeypatch.setattr(rehearsal, "_tried", None)  # another seed, another key: the same classes
    assert job.check(registry.compose(["tracking=none", *overrides, "seed=5", "trainer.log_every=7"])).problems == []


def test_what_credit_ships_is_not_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rehearsal, "_tried", None)
    assert job.check(registry.compose(["tracking=none", *RECOVERY])).problems == []
