import numpy as np
import pytest
from scipy import stats

from credit.report.statistics import (
    Interval,
    count_trapped,
    interquartile_mean,
    iqm_interval,
    mean_and_error,
    pair_by_seed,
    paired_difference,
    probability_of_improvement,
)
from credit.runs.intervals import GAP, mean_interval


def test_mean_and_error_by_hand():
    mean, error = mean_and_error([1.0, 2.0, 3.0, 6.0])
    # deviations −2, −1, 0, 3: s² = 14/3, s/√4
    assert mean == 3.0
    assert error == pytest.approx(np.sqrt(14 / 3) / 2)


def test_one_seed_has_a_mean_and_no_error():
    mean, error = mean_and_error([5.0])
    assert mean == 5.0
    assert np.isnan(error)
    assert all(np.isnan(end).all() for end in mean_interval([[1.0, 2.0]])[1:])
    assert np.isnan(iqm_interval([5.0]).low)
    assert np.isnan(paired_difference([5.0], [4.0]).low)


def test_differences_of_rates_stay_within_theirs():
    # two seeds, of which one has it all: Student's interval would end at −6.66 and 6.20
    found = paired_difference([0.0, 0.9], [0.74, 0.62], GAP)
    assert found.value == pytest.approx(-0.23)
    assert -1 <= found.low < found.value < found.high <= 1
    assert paired_difference([0.0, 0.9], [0.74, 0.62]).high > 6


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
    # The seeds of a task hardly differ, so resampling within tasks changes hardly anything.
    scores = np.array([[0.0, 0.1, 0.0, 0.1, 0.0, 0.1], [10.0, 10.1, 10.0, 10.1, 10.0, 10.1]])
    found = iqm_interval(scores)
    assert 4.9 < found.low < found.high < 5.2


def test_seeds_of_one_mind_leave_no_spread_to_measure():
    found = iqm_interval(np.repeat([[0.0], [10.0]], 6, axis=1)), paired_difference([3.0, 5.0], [1.0, 3.0])
    assert [interval.value for interval in found] == [5.0, 2.0]
    assert np.isnan([ends for interval in found for ends in interval[1:]]).all()
    assert not found[1].excludes_zero


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


def expanded(n: int) -> list[float]:
    """The percentiles of a bootstrap of n, widened to those of a t-interval."""
    tail = stats.norm.cdf(-np.sqrt(n / (n - 1)) * stats.t.ppf(0.975, n - 1))
    return [tail, 1 - tail]


def test_probability_interval_agrees_with_a_plain_bootstrap():
    rng = np.random.default_rng(6)
    x, y = rng.normal(size=20), rng.normal(0.5, 1, size=25)
    samples = []
    for _ in range(4000):
        a, b = rng.choice(x, 20), rng.choice(y, 25)
        samples.append((a[:, None] < b).mean())
    expected = np.quantile(samples, expanded(20))
    for seeds in ((), (range(20), range(20, 45))):
        result = probability_of_improvement(x, y, *seeds)
        assert (result.low, result.high) == pytest.approx(expected, abs=0.02)


def test_runs_of_one_seed_are_no_pair_of_independent_runs():
    # seeds 2 and 3 are common: of 6 pairs, (2, 2) and (3, 3) are left out, and (2, 3), (3, 4) are won
    x, y = [1.0, 5.0], [0.5, 2.0, 6.0]
    assert probability_of_improvement(x, y, [2, 3], [2, 3, 4]).value == pytest.approx(3 / 4)
    # who is always a little better on the same seed is no better on another
    scores = np.arange(20.0)
    assert probability_of_improvement(scores - 0.1, scores, range(20), range(20)).value == pytest.approx(0.5)
    assert probability_of_improvement([1.0, 2.0], [1.0, 2.0], [0, 1], [0, 1]) == pytest.approx(
        (0.5, np.nan, np.nan), nan_ok=True
    )
    assert np.isnan(probability_of_improvement([1.0], [2.0], [0], [0])).all()
    # five of one mind: that the interval has no width does not make it certain
    assert probability_of_improvement(range(5), range(9, 14), range(5), range(5)) == pytest.approx(
        (1.0, np.nan, np.nan), nan_ok=True
    )
    with pytest.raises(ValueError, match="both sides"):
        probability_of_improvement([1.0], [2.0], [0])


def test_pairs_are_resampled_as_pairs_whatever_their_order():
    rng = np.random.default_rng(7)
    x, y, seeds = rng.normal(size=12), rng.normal(0.3, 1, size=15), np.arange(15)
    mixed = rng.permutation(15)
    straight = probability_of_improvement(x, y, seeds[:12], seeds)
    turned = probability_of_improvement(x, y[mixed], seeds[:12], seeds[mixed])
    assert straight.value == pytest.approx(turned.value)
    assert straight == pytest.approx(turned, abs=0.02)
    # a plain bootstrap of the pairs, and of the rest among themselves
    samples = []
    for _ in range(4000):
        common = rng.integers(12, size=12)
        left, right = common, np.concatenate([common, rng.integers(12, 15, size=3)])
        pairs = left[:, None] != right
        samples.append((x[left][:, None] < y[right])[pairs].mean())
    assert (straight.low, straight.high) == pytest.approx(np.quantile(samples, expanded(12)), abs=0.02)


def covered(correlation: float, shift: float, *, paired: bool, count: int = 20, worlds: int = 1000) -> float:
    """How often the interval has P(X < Y) of independent runs, where common seeds make scores correlate."""
    rng = np.random.default_rng(8)
    truth, hits, seeds = stats.norm.cdf(shift / np.sqrt(2)), 0, (range(count),) * 2 if paired else ()
    for world in range(worlds):
        common, own_x, own_y = rng.normal(size=(3, count))
        x, y = (np.sqrt(correlation) * common + np.sqrt(1 - correlation) * own for own in (own_x, own_y))
        result = probability_of_improvement(x, y + shift, *seeds, draws=1000, seed=world)
        hits += result.low <= truth <= result.high
    return hits / worlds


@pytest.mark.slow
@pytest.mark.parametrize(
    ("correlation", "shift"), [(0.0, 0.0), (0.0, 0.5), (0.5, 0.0), (0.5, 0.5), (0.5, 1.5), (0.9, 0.5)]
)
def test_the_interval_of_improvement_covers_what_it_says(correlation: float, shift: float):
    # .95, with three standard errors of 1,000 worlds; correlated ranks make it cautious
    assert 0.93 <= covered(correlation, shift, paired=True) <= 0.985


@pytest.mark.slow
def test_without_its_pairs_the_interval_is_too_wide():
    assert covered(0.9, 0.0, paired=False) > 0.99
    assert covered(0.0, 0.5, paired=False) == pytest.approx(0.95, abs=0.02)


def test_trapped_seeds_lie_above_the_threshold():
    assert count_trapped([10.0, 300.0, 300.1, 900.0], above=300.0) == 2
