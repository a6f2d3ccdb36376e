"""Whatever is registered can be stopped between any two rounds and gone on with to the bit, by way of a file."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import pytest
import torch

from credit.config import classes, files, kinds, registry
from credit.core.errors import UserError
from credit.recovery.bonuses import Count
from credit.runs import checkpoint, job
from credit.testing import short
from credit.testing.runs import goes_on
from credit.testing.short import SMALL, selection

KINDS = [kind for kind in kinds.KINDS if kind != "tracking"]
EXPERIMENTS = sorted(short.experiments(), key="pointmaze".__eq__)  # the quick ones first
QUICK = {"mixer": pytest.mark.thorough, "bonus": ()}  # of the rest, methods and two tests below stand for most
ALONE = ["method=reference"]  # where no surrogate has the name of the reference
ROUNDS = {"windows_per_round": 2, "first_windows": 0, "log_every": 4, "random_windows": 3}
WINDOWS = 9


@cache
def composed(*overrides: str) -> dict[str, Any]:
    """The configuration of a short run: five rounds and a window that is cut short; not to be changed."""
    config = registry.compose(["tracking=none", *overrides])
    if classes.resolve("env", config["env"]).__name__ in SMALL:
        return short.composed(*overrides)
    window = config["feedback"]["window"]
    return config | {"trainer": config["trainer"] | ROUNDS | {"steps": WINDOWS * window + window // 2}}


@cache
def fits(slot: str, *overrides: str) -> bool:
    """Whether overrides go together, and something is made of the slot."""
    try:
        found = job.check(composed(*overrides))
    except UserError:  # there is nothing where the option would go
        return False
    return not found.problems and slot in found.used


FIRST = ("delayed", "disagreement", "thompson")  # a state for each: an agent's, a recovery's, streams'


def marks(experiment: str, method: str) -> Any:
    """The quick experiment is tried in CI, and of it three methods by default."""
    if experiment != "advertiser":
        return pytest.mark.slow
    return () if method in FIRST else pytest.mark.thorough


METHODS = [
    pytest.param(
        (f"experiment={experiment}", f"method={method}"),
        id=f"{experiment}-{method}",
        marks=marks(experiment, method),
    )
    for experiment in EXPERIMENTS
    for method in sorted(files.options("method"))
]


def every_component() -> Iterator[Any]:
    """Overrides that put an option of a kind to use, experiment by experiment."""
    for kind in KINDS:
        for name in files.options(kind):
            slot = "reference" if kind in ("reward", "features") else kind
            ways: list[list[str]] = [[], ALONE, [*ALONE, "reward@reference=linear"]]
            found = [
                (slot, f"experiment={experiment}", *way, *selection(kind, name))
                for experiment in EXPERIMENTS
                for way in ways
            ]
            yield pytest.param(found, id=f"{kind}={name}", marks=QUICK.get(kind, pytest.mark.slow))


@pytest.mark.parametrize("names", METHODS)
def test_a_method_goes_on_after_any_round(tmp_path: Path, names: tuple[str, ...]) -> None:
    if not fits("assigner", *names):
        pytest.skip("does not go with this experiment")
    goes_on(composed(*names), tmp_path, (3, 4), slice(None))


@pytest.mark.parametrize("choices", every_component())
def test_a_component_goes_on(tmp_path: Path, choices: list[tuple[str, ...]]) -> None:
    names = next((names for names in choices if fits(*names)), None)
    assert names, "goes with no experiment"
    goes_on(composed(*names[1:]), tmp_path, (3, 4, 5), slice(1, 2))


@pytest.mark.thorough
def test_a_replay_buffer_that_wrapped_around_goes_on(tmp_path: Path) -> None:
    config = composed("experiment=sepsis", "method=delayed", "agent.capacity=5", "agent.batch=8")
    goes_on(config, tmp_path, (3, 4), slice(None))


def test_a_maze_goes_on_from_its_demonstrations(tmp_path: Path) -> None:
    config = composed("experiment=pointmaze", "method=disagreement")
    goes_on(config, tmp_path, (3, 4, 5), slice(0, 1))
    assert checkpoint.load(tmp_path / "1")["trainer"]["collected"] == 0


class Forgetful(Count):
    """Grows from round to round, and forgets that it did."""

    keeps: ClassVar = ()

    def start(self, problem: Any) -> None:
        self._seen = 0

    def __call__(self, belief: Any, reference: Any, steps: Any = None) -> torch.Tensor:
        self._seen += 1
        return super().__call__(belief, reference, steps) * self._seen * (-1) ** self._seen


def test_a_state_that_is_forgotten_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("credit.recovery.bonuses.Count", Forgetful)
    with pytest.raises(AssertionError, match="rows after round 2"):
        goes_on(composed("method=reference"), tmp_path, (3, 4), slice(1, 2))
