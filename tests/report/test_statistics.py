import numpy as np
import pytest
from scipy import stats

from credit.report.statistics import (
    Interval,
    count_trapped,
    interquartile_mean,
    iqm_interval,
    mean_and_error,
    mean_band,
    pair_by_seed,
    paired_difference,
    probability_of_improvement,
)


def test_mean_and_error_by_hand():
    mean, error = mean_and_error([1.0, 2.0, 3.0, 6.0])
    # deviations −2, −1, 0, 3: s² = 14/3, s/√4
    assert mean == 3.0
    assert error == pytest.approx(np.sqrt(14 / 3) / 2)


def test_one_seed_has_a_mean_and_no_error():
    mean, error = mean_and_error([5.0])
    assert mean == 5.0
    assert np.isnan(error)
    assert all(np.isnan(end).all() for end in mean_band([[1.0, 2.0]])[1:])
    assert np.isnan(iqm_interval([5.0]).low)
    assert np.isnan(paired_difference([5.0], [4.0]).low)


def test_mean_band_is_the_t_interval_of_scipy():
    values = np.random.default_rng(0).normal(size=(7, 3))
    mean, low, high = mean_band(values)
    expected = stats.t.interval(0.95, 6, loc=values.mean(axis=0), scale=stats.sem(values, axis=0))
    np.testing.assert_allclose(mean, values.mean(axis=0))
    np.testing.assert_allclose([low, high], expected)


def test_interquartile_mean_by_hand():
    # 8 scores: the two lowest and the two highest go
    assert interquartile_mean([100.0, 3, 1, 2, 4, 5, 6, -50]) == pytest.approx((2 + 3 + 4 + 5) / 4)
    # 5 scores: ⌊5/4⌋ = 1 goes at each end
    assert interquartile_mean([9.0, 1, 2, 3, 100]) == pytest.approx((2 + 3 + 9) / 3)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7, 10, 101])
def test_interquartile_mean_is_the_trimmed_mean_of_scipy(count):
    scores = np.random.default_rng(count).normal(size=(3, count))
    np.testing.assert_allclose(interquartile_mean(scores), stats.trim_mean(scores, 0.25, axis=-1))


def test_iqm_interval_agrees_with_scipys_bootstrap():
    scores = np.random.default_rng(1).normal(50, 10, size=40)
    ours = iqm_interval(scores)
    theirs = stats.bootstrap(
        (scores,), interquartile_mean, method="percentile", n_resamples=10_000, rng=np.random.default_rng(2)
    ).confidence_interval
    assert ours.value == pytest.approx(float(interquartile_mean(scores)))
    assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), abs=0.25)


def test_iqm_interval_is_stratified_by_task():
    # Every seed of a task is the same, so resampling within tasks cannot change anything.
    scores = np.repeat([[0.0], [10.0]], 6, axis=1)
    assert iqm_interval(scores) == Interval(5.0, 5.0, 5.0)


def test_bootstrap_is_seeded():
    scores = np.random.default_rng(3).normal(size=20)
    assert iqm_interval(scores, draws=100) == iqm_interval(scores, draws=100)
    assert iqm_interval(scores, draws=100) != iqm_interval(scores, draws=100, seed=1)


def test_pairing_keeps_common_seeds_only():
    x, y = pair_by_seed([3, 1, 2], [30.0, 10.0, 20.0], [2, 5, 3], [200.0, 500.0, 300.0])
    assert x.tolist() == [20.0, 30.0]
    assert y.tolist() == [200.0, 300.0]


def test_paired_difference_is_the_paired_t_test_of_scipy():
    rng = np.random.default_rng(4)
    x, y = rng.normal(size=12), rng.normal(size=12)
    expected = stats.ttest_rel(x, y).confidence_interval(0.95)
    assert paired_difference(x, y) == pytest.approx((np.mean(x - y), expected.low, expected.high))


def test_paired_difference_by_hand():
    # d = 1, 2, 3: mean 2, s = 1, t(2) = 4.3027
    value, low, high = paired_difference([2.0, 4.0, 6.0], [1.0, 2.0, 3.0])
    assert (value, low, high) == pytest.approx((2.0, 2 - 4.302653 / np.sqrt(3), 2 + 4.302653 / np.sqrt(3)))
    assert not Interval(value, low, high).excludes_zero
    assert Interval(2.0, 0.1, 3.9).excludes_zero
    assert not Interval(2.0, float("nan"), float("nan")).excludes_zero


def test_no_common_seed_gives_no_difference():
    assert np.isnan(paired_difference([], [])).all()


def test_probability_of_improvement_by_hand():
    # pairs (1,2) (1,3) (3,2) (3,3): won, won, lost, tied
    assert probability_of_improvement([1.0, 3.0], [2.0, 3.0], draws=10).value == pytest.approx(2.5 / 4)
    higher = probability_of_improvement([1.0, 3.0], [2.0, 3.0], lower_is_better=False, draws=10)
    assert higher.value == pytest.approx(1.5 / 4)


def test_probability_of_improvement_is_the_mann_whitney_statistic():
    rng = np.random.default_rng(5)
    x, y = rng.integers(0, 9, size=15), rng.integers(2, 11, size=11)
    result = probability_of_improvement(x, y)
    assert result.value == pytest.approx(stats.mannwhitneyu(y, x).statistic / (15 * 11))
    assert 0 <= result.low < result.value < result.high <= 1


def test_probability_interval_agrees_with_a_plain_bootstrap():
    rng = np.random.default_rng(6)
    x, y = rng.normal(size=20), rng.normal(0.5, 1, size=25)
    samples = []
    for _ in range(4000):
        a, b = rng.choice(x, 20), rng.choice(y, 25)
        samples.append((a[:, None] < b).mean())
    result = probability_of_improvement(x, y)
    assert (result.low, result.high) == pytest.approx(np.quantile(samples, [0.025, 0.975]), abs=0.02)


def test_trapped_seeds_lie_above_the_threshold():
    assert count_trapped([10.0, 300.0, 300.1, 900.0], above=300.0) == 2
