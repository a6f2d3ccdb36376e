"""A policy from logs, where the best one and what it is worth are known."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import credit
from credit.logged.result import LoggedCredit
from tests.logged.test_recovering import found, table

WORTH = np.array([[0.0, 1.0], [2.0, 0.0]])  # of state and action: "b" in state "p", "a" in state "q"


def logs(windows: int, length: int, seed: int = 0) -> pd.DataFrame:
    random = np.random.default_rng(seed)
    count = windows * length
    state, action = random.integers(0, 2, count), (random.uniform(size=count) < 0.7).astype(int)
    label = WORTH[state, action].reshape(windows, length).sum(1) + 0.3 * random.normal(size=windows)
    return pd.DataFrame(
        {
            "w": np.repeat(np.arange(windows), length),
            "s": np.array([*"pq"])[state],
            "a": np.array([*"ab"])[action],
            "mu": np.where(action == 1, 0.7, 0.3),
            "y": np.repeat(label, length),
        }
    )


def recovered(frame: pd.DataFrame, **words: object) -> LoggedCredit:
    return credit.recover(
        frame, window="w", label="y", actions=["a"], states=["s"], draws=30, reference="1 + s * a", **words
    )


@pytest.mark.parametrize("propensity", [None, "mu"])
def test_the_best_policy_is_found_and_valued_by_labels(propensity: str | None) -> None:
    one = recovered(logs(800, 2), propensity=propensity)
    assert one.policies is not None
    assert one.policies.table.set_index("s")["a"].to_dict() == {"p": "b", "q": "a"}
    values = {(value.policy, value.estimator): value for value in one.policies.values}
    for estimator in ("self-normalised importance weights", "doubly robust"):
        value = values["chosen", estimator]
        assert value.low < 3.0 < value.high  # two rows, each worth 1 or 2
        assert value.high - value.low < 0.8
    done = values["what was done", "mean label"]
    assert done.value == pytest.approx(2 * (0.5 * 0.7 * 1 + 0.5 * 0.3 * 2), abs=0.15)


def test_a_sample_that_is_too_small_gives_no_number() -> None:
    one = recovered(logs(60, 8))
    assert one.policies is not None
    chosen = [value for value in one.policies.values if value.policy == "chosen"]
    assert all(value.effective < 10 and np.isnan(value.value) for value in chosen)


def test_what_is_not_finite_has_no_policy() -> None:
    assert found(table()).policies is None


def test_half_of_the_windows_may_tell_nothing() -> None:
    frame = logs(60, 2)
    first = (frame["w"] % 2) == 0
    frame.loc[first, "y"] = 1.0
    one = recovered(frame)
    assert one.policies is not None
    assert "no policy is chosen" in one.policies.said
    assert not one.policies.values
