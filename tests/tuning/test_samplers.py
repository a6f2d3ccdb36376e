"""Samplers: chosen by name, with short numbers, and the same trials for the same study."""

from __future__ import annotations

import optuna
import pytest

from credit.core.errors import UserError
from credit.tuning.samplers import SAMPLERS, require, sampler
from credit.tuning.space import Space, read

optuna.logging.set_verbosity(optuna.logging.ERROR)
SMOOTH = ["a=interval(0,1)", "b=tag(log,interval(1e-4,1))", "c=1,2"]
STEPS = ["a=1,2", "b=range(0,3)"]


def space(*words: str) -> Space:
    return read(words, {})


def asked(name: str, ranges: Space, count: int) -> list[dict[str, float]]:
    study = optuna.create_study()
    for number in range(count):
        study.sampler = sampler(name, number)
        trial = study.ask(dict(ranges.ranges))
        study.tell(trial, sum(trial.params.values()))
    return [trial.params for trial in study.trials]


@pytest.mark.parametrize("name", sorted(SAMPLERS))
def test_the_same_study_asks_for_the_same_trials(name: str) -> None:
    ranges = space(*(STEPS if name == "grid" else SMOOTH))
    first = asked(name, ranges, 6)
    assert asked(name, ranges, 6) == first
    assert len({tuple(params.items()) for params in first}) == 6
    assert all(float(f"{value:.4g}") == value for params in first for value in params.values())


def test_a_grid_is_every_setting_once() -> None:
    assert {tuple(params.values()) for params in asked("grid", space(*STEPS), 6)} == {
        (a, b) for a in (1, 2) for b in (0, 1, 2)
    }


def test_tpe_learns_from_what_came_before() -> None:
    later = [params["a"] for params in asked("tpe", space("a=interval(0,1)"), 30)][15:]
    assert sum(later) / len(later) < 0.25  # the mean of random ones is .5 ± .07


def test_samplers_that_cannot() -> None:
    with pytest.raises(UserError, match=r"sampler=tpa: .* did you mean 'tpe'"):
        require("tpa", space(*SMOOTH))
    with pytest.raises(UserError, match="an interval has no end of them; write range"):
        require("grid", space(*SMOOTH))
    require("grid", space(*STEPS))


def test_what_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(UserError, match=r"cmaes is not installed; pip install 'credit-rl\[tune\]'"):
        require("cmaes", space(*SMOOTH))
