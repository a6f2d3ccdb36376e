"""A part that breaks a promise is told so by name, whichever promise it is; one that keeps them passes."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import pytest
import torch
from torch import Tensor

from credit.agents.q_learning import QLearning
from credit.core.component import Component
from credit.core.errors import UserError
from credit.core.policy import Policy
from credit.core.problem import Problem
from credit.core.seams import Environment, FeatureMap, Feedback, Mixer, Transitions
from credit.envs.advertiser.environment import Advertiser
from credit.envs.feedback import BlockSum
from credit.envs.gymnasium.environment import Gymnasium
from credit.planning.counts import Counts
from credit.recovery.bonuses import Count
from credit.recovery.features.tabular import Identity
from credit.recovery.mixers import RelativeMSE
from credit.recovery.scaler import Standard
from credit.rivals.rules import Uniform
from credit.testing import check, leaks
from credit.testing.words import keys_without_comment


class Right(RelativeMSE):
    """The same again."""


class Third(RelativeMSE):
    def weights(self, *args: Any) -> Tensor:
        return super().weights(*args) / 3


class OfOneSize(RelativeMSE):
    """Right, as long as proxies are of the usual size."""

    def weights(self, mse: Tensor, label_errors: Tensor | None = None) -> Tensor:
        shares = 1 / (mse + 1e-12)
        return shares / shares.sum(-2, keepdim=True) if mse.max() < 1e9 else shares * 0


class Neighbourly(Identity):
    def __call__(self, steps: Any) -> Tensor:
        return super().__call__(steps).cumsum(-2)


class Crowd(Count):
    """Looks at the other replicas."""

    def __call__(self, belief: Any, *args: Any) -> Tensor:
        return super().__call__(belief, *args) + belief.mixed.std(0, correction=0)


class Unseeded(Count):
    def __call__(self, *args: Any) -> Tensor:
        return super().__call__(*args) + torch.rand(())


class Upside(Standard):
    def __call__(self, rewards: Tensor) -> tuple[Tensor, Tensor]:
        scaled, unit = super().__call__(rewards)
        return -scaled, unit


class Generous(Uniform):
    def rewards(self, windows: Any) -> Tensor:
        return super().rewards(windows) + 1


class Verdict(BlockSum):
    """Says that its labels are bits."""

    kind: ClassVar = "bits"


class Least(Feedback):
    """The smallest reward, of zeros too that are none."""

    window, objective = 7, "sum"

    def start(self, problem: Problem) -> None:
        """There is no noise."""

    def __call__(self, rewards: Tensor) -> Tensor:
        return rewards.abs().amin(-1)


class Remembers(Counts):
    """Counts windows twice that come alone."""

    def observe(self, windows: Any) -> None:
        super().observe(windows)
        if windows.labels.shape[1] == 1:
            super().observe(windows)


class Nowhere(Advertiser):
    def step(self, *args: Any) -> Any:
        out = super().step(*args)
        return out._replace(states=out.states + 7)


class Sized(RelativeMSE):
    def __init__(self, power: float) -> None:
        super().__init__()
        self.power = power


class Abroad(Identity):
    """Asks for what no environment of credit's knows."""

    knows: ClassVar = dict


class Best(Policy):
    """The action of the largest Q, which is looked up when it is asked for."""

    def __init__(self, agent: QLearning) -> None:
        self._agent = agent

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        return self._agent._q.argmax(-1).gather(1, states)


class Forgets(QLearning):
    """Says that its policy looks at nothing that was learned."""

    acts: ClassVar = ()

    def policies(self) -> dict[str, Policy]:
        return {"behaviour": Best(self)}


class Half(FeatureMap):
    """Not yet written."""


DEFAULT = [
    (OfOneSize, ["OfOneSize in experiment=advertiser", "M = 1 with huge proxies", "sum to one"]),
    (Forgets, ["Forgets in experiment=advertiser", "kept and made anew, does something else", "name in `acts`"]),
    (Least, ["Least", "zeros behind the end of a window change its label"]),
    (Upside, ["Upside", "two steps changed their order"]),
]
SLOW = [
    (Third, ["mixer: Third.weights", "sum to 0.333", "sum to 1"]),
    (Neighbourly, ["Neighbourly", "depend on the steps beside it"]),
    (Crowd, ["Crowd", "depend on who is beside it"]),
    (Unseeded, ["Unseeded", "came to other numbers"]),
    (Generous, ["Generous", "must sum to its label"]),
    (Verdict, ["Verdict", "neither 0 nor 1"]),
    (Nowhere, ["Nowhere", "next states hold", "0 to 9"]),
    (Half, ["Half does not define __call__, start"]),
]


@pytest.mark.parametrize(("part", "said"), [*DEFAULT, *(pytest.param(*case, marks=pytest.mark.slow) for case in SLOW)])
def test_a_broken_promise_is_named(part: type[Component], said: list[str]) -> None:
    with pytest.raises(AssertionError) as found:
        check(part)
    for piece in said:
        assert piece in str(found.value), found.value


@pytest.mark.parametrize("part", [Right, pytest.param(RelativeMSE(0.5), marks=pytest.mark.slow)])
def test_what_is_right_passes(part: Any) -> None:
    check(part)


@pytest.mark.slow
@pytest.mark.parametrize(
    "option", ["mixer/stacking", "env/advertiser", "env/pointmaze", "feedback/success", "reward/primitive", "agent/sac"]
)
def test_what_is_registered_passes(option: str) -> None:
    check(option)


class Walk(Environment):
    """Three steps to the right lead out, of episodes that may end at any time."""

    def problem(self, window: int, seeds: tuple[int, ...], device: torch.device | str) -> Problem:
        return Problem.finite(4, 2, window, seeds, device, episodic=True)

    def start(self, problem: Problem, copies: int = 1, purpose: str = "environment") -> None:
        self._place = torch.zeros(problem.replicas, copies, dtype=torch.int64)

    def reset(self, mask: Tensor | None = None) -> Tensor:
        self._place = torch.zeros_like(self._place) if mask is None else self._place.masked_fill(mask, 0)
        return self._place

    def step(self, actions: Tensor, mask: Tensor | None = None) -> Transitions:
        moved = (self._place + 2 * actions - 1).clamp(0, 3)
        self._place = moved if mask is None else torch.where(mask, moved, self._place)
        out = self._place == 3
        return Transitions(self._place, out.double(), out, torch.zeros_like(out))


class Restless(Walk):
    """Begins anew everywhere, whoever is asked to."""

    def reset(self, mask: Tensor | None = None) -> Tensor:
        return super().reset()


@pytest.mark.slow
@pytest.mark.parametrize(
    "env", [Walk, Gymnasium("CartPole-v1"), Gymnasium("FrozenLake-v1")], ids=["walk", "cartpole", "lake"]
)
def test_environments_that_are_right_pass(env: Any) -> None:
    check(env)


@pytest.mark.slow
def test_copies_that_should_stay_are_watched() -> None:
    with pytest.raises(AssertionError, match="does not stay as it is"):
        check(Restless)


@pytest.mark.parametrize(
    ("thing", "said"),
    [
        ("mixer/relative_mes", ["no option 'relative_mes'", "did you mean 'relative_mse'"]),
        ("mixers/best", ["'mixers' is no kind", "did you mean 'mixer'"]),
        ("best", ["'best' is no kind"]),
        (dict, ["dict: no component of credit's", "Mixer"]),
        (Sized, ["Sized: no defaults for power", "Sized(...)"]),
        pytest.param(Abroad, ["Abroad goes with no experiment", "sepsis: ", "needs dict"], marks=pytest.mark.slow),
    ],
)
def test_what_cannot_be_checked_says_why(thing: Any, said: list[str]) -> None:
    with pytest.raises(UserError) as found:
        check(thing)
    for piece in said:
        assert piece in str(found.value)


def test_an_unfinished_class_is_told_what_it_lacks() -> None:
    with pytest.raises(AssertionError, match="Unfinished does not define weights"):
        check(type("Unfinished", (Mixer,), {}))


class Spy(QLearning):
    """Got hold of the rewards."""

    seen: ClassVar[list[Tensor]] = [torch.zeros(1)]

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        return (super().act(states, step) + (self.seen[0].sum() > 0).long()) % 3


@pytest.mark.slow
def test_a_leak_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    step = leaks.Moved.step

    def peeped(*args: Any) -> Any:
        out = step(*args)
        Spy.seen[0] = out.rewards
        return out

    monkeypatch.setattr(leaks.Moved, "step", peeped)
    with pytest.raises(AssertionError, match=r"other rewards with the same labels led to other .*actions"):
        check(Spy)


def test_keys_without_a_comment_are_found(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("# What it is.\n_target_: a.B\nfirst: 1  # said\n# said above\nsecond: 2\nthird: 3\n")
    assert keys_without_comment(path) == ["third"]
