"""What intervals of an evaluation are over, and that those of rates lie in [0, 1]."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from credit.report.evaluated import caption, summary
from credit.report.statistics import wilson


def found(**seeds: list[float]) -> pd.DataFrame:
    """Episodes of seeds."""
    rows = [("run", int(seed[1:]), k, value) for seed, values in seeds.items() for k, value in enumerate(values)]
    return pd.DataFrame(rows, columns=["run", "seed", "episode", "return"]).set_index(["run", "seed", "episode"])


@pytest.mark.parametrize(("successes", "trials"), [(0, 10), (3, 10), (10, 10), (50, 100)])
def test_wilson(successes: int, trials: int) -> None:
    rate, low, high = wilson(successes, trials)
    theirs = stats.binomtest(successes, trials).proportion_ci(method="wilson")
    assert (rate, low, high) == pytest.approx((successes / trials, theirs.low, theirs.high))
    assert 0 <= low <= rate <= high <= 1


def test_of_several_seeds_the_seeds_are_the_unit() -> None:
    (row,) = summary(found(s0=[1, 3], s1=[4, 4], s2=[6, 8])).to_dict("records")
    assert (row["seeds"], row["episodes"], row["return"]) == (3, 2, pytest.approx(13 / 3))
    interval = stats.t.interval(0.95, 2, np.mean([2, 4, 7]), stats.sem([2, 4, 7]))
    assert (row["return_low"], row["return_high"]) == pytest.approx(interval)


def test_of_one_seed_its_episodes() -> None:
    (row,) = summary(found(s0=[1, 2, 4])).to_dict("records")
    assert (row["return_low"], row["return_high"]) == pytest.approx(
        stats.t.interval(0.95, 2, 7 / 3, stats.sem([1, 2, 4]))
    )
    (row,) = summary(found(s0=[0, 1, 1, 1])).to_dict("records")
    assert (row["return_low"], row["return_high"]) == pytest.approx(wilson(3, 4)[1:])


def test_rates_stay_within_their_bounds_and_seeds_of_one_mind_have_no_interval() -> None:
    (row,) = summary(found(s0=[0, 0, 0, 1], s1=[1, 1, 1, 1])).to_dict("records")
    assert 0 <= row["return_low"] < 0.25 < 1 == pytest.approx(row["return_high"], abs=0.01)
    (row,) = summary(found(s0=[1, 1], s1=[1, 1])).to_dict("records")
    assert row["return"] == 1
    assert np.isnan([row["return_low"], row["return_high"]]).all()


def test_what_the_intervals_are_over_is_said() -> None:
    def said(exact: bool = False, **seeds: list[float]) -> str:
        return " ".join(caption(summary(found(**seeds)), exact))

    few = said(s0=[1, 2], s1=[2, 3])
    assert "over seeds, each by the mean of its episodes" in few
    assert "fewer than 10 seeds" in few
    assert "fewer" not in said(**{f"s{seed}": [1, 2] for seed in range(10)})
    assert "nothing of what another seed" in said(s0=[1, 2])
    assert "no interval" in said(True, s0=[1])
