"""Means with intervals: Student's, and Wilson's for what cannot leave its bounds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from credit.judges.exact import AverageReward
from credit.judges.rollouts import Rollouts
from credit.runs.intervals import GAP, POSITIVE, SHARE, is_rate, mean_interval


def test_without_bounds_it_is_the_t_interval_of_scipy() -> None:
    values = np.random.default_rng(0).normal(size=(7, 3))
    expected = stats.t.interval(0.95, 6, loc=values.mean(axis=0), scale=stats.sem(values, axis=0))
    mean, low, high = mean_interval(values)
    np.testing.assert_allclose(mean, values.mean(axis=0))
    np.testing.assert_allclose([low, high], expected)


@pytest.mark.parametrize(("bounds", "values"), [(SHARE, [0.2, 0.5, 0.3, 0.9]), (GAP, [-0.9, -0.6, -0.95])])
def test_the_ends_of_a_bounded_interval_solve_the_score_equation(
    bounds: tuple[float, float], values: list[float]
) -> None:
    mean, low, high = mean_interval(values, bounds)
    width = bounds[1] - bounds[0]
    share, ends = (mean - bounds[0]) / width, (np.array([low, high]) - bounds[0]) / width
    half = stats.t.ppf(0.975, len(values) - 1) * stats.sem(values) / width
    # the error at an end is that at the mean, as far as p(1 − p) says
    error = half * np.sqrt(ends * (1 - ends) / (share * (1 - share)))
    np.testing.assert_allclose([share - ends[0], ends[1] - share], error)


def test_what_is_never_negative_has_students_interval_as_far_as_0() -> None:
    values = np.array([[1.0, 10.0], [5.0, 11.0]])
    mean, low, high = mean_interval(values)
    assert low[0] < 0 < low[1]
    found = mean_interval(values, POSITIVE)
    np.testing.assert_array_equal(found, [mean, [0.0, low[1]], high])


@pytest.mark.parametrize("count", [2, 3, 5, 20])
@pytest.mark.parametrize("mean", [0.02, 0.5, 0.97])
def test_intervals_of_rates_stay_between_0_and_1_and_cover_the_mean(count: int, mean: float) -> None:
    rng = np.random.default_rng(count)
    rates = rng.binomial(20, rng.beta(5 * mean, 5 * (1 - mean), size=(count, 2000))) / 20
    found, low, high = mean_interval(rates, SHARE)
    assert ((low >= 0) & (low <= found) & (found <= high) & (high <= 1)).all()
    spread = rates.std(0) > 0  # seeds of one mind say nothing of their spread
    assert ((low <= mean) & (mean <= high))[spread].mean() > 0.87  # .95, but of skewed rates


def test_one_seed_has_no_interval_and_equal_ones_have_no_width() -> None:
    assert all(np.isnan(end) for end in mean_interval([0.5], SHARE)[1:])
    assert [float(end) for end in mean_interval([1.0, 1.0], SHARE)] == [1.0, 1.0, 1.0]
    assert [float(end) for end in mean_interval([0.0, 0.0, 0.0], SHARE)] == [0.0, 0.0, 0.0]


def test_a_judge_declares_its_rates() -> None:
    exact, rollouts = AverageReward.rates, Rollouts.rates
    for metric in ("policy/error", "policy/error_greedy", "policy/error_occupancy", "weight/ridge", "best/linear"):
        assert is_rate(metric, exact, [metric])
    for metric in ("regret/cumulative", "reward/mse", "return/label", "policy/errors"):
        assert not is_rate(metric, exact, [metric])
    with_success = ["eval/success", "eval/auc", "eval/auc_averaged", "eval/final", "eval/return"]
    assert [is_rate(metric, rollouts, with_success) for metric in with_success] == [True, True, True, True, False]
    assert not is_rate("eval/auc", rollouts, ["eval/auc", "eval/return"])  # of returns
