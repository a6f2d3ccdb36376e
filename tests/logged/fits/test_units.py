"""Weights that follow from names alone, and what is resampled for which residuals."""

from __future__ import annotations

import numpy as np
import pytest

from credit.logged.fits.units import Units, block_length, correlations, exponential, units_of
from credit.logged.panel import Windows


def windows(groups: int, times: int) -> Windows:
    count = groups * times
    return Windows(
        id=np.tile(np.arange(times), groups).astype(object),
        group=np.repeat(np.arange(groups), times),
        groups=tuple(f"g{i}" for i in range(groups)),
        time=np.tile(np.arange(times), groups),
        steps=np.full(count, 7),
        label=np.zeros(count),
        key=np.arange(count, dtype=np.uint64),
    )


def residuals(groups: int, times: int, rho: float, shared: float, seed: int = 0) -> np.ndarray:
    random = np.random.default_rng(seed)

    def chain(rows: int) -> np.ndarray:
        noise = random.normal(size=(rows, times + 50))
        for t in range(1, times + 50):
            noise[:, t] += rho * noise[:, t - 1]
        return noise[:, 50:]

    return (chain(groups) + shared * chain(1)).ravel()


def test_weights_are_exponential_and_follow_from_key_seed_and_draw() -> None:
    keys = np.random.default_rng(0).integers(0, 2**63, 4000).astype(np.uint64)
    found = exponential(keys, 50, seed=3)
    assert found.shape == (4000, 50)
    assert (found > 0).all()
    np.testing.assert_allclose([found.mean(), found.var(), (found < 1).mean()], [1, 1, 1 - np.exp(-1)], atol=0.02)
    assert np.abs(np.corrcoef(found[:, :6].T) - np.eye(6)).max() < 0.06
    order = np.random.default_rng(1).permutation(4000)
    assert np.array_equal(exponential(keys[order], 50, 3), found[order])
    assert np.array_equal(exponential(keys, 20, 3), found[:, :20])
    assert np.isclose(exponential(keys, 50, 4), found).mean() < 1e-3
    neighbours = exponential(np.arange(4000, dtype=np.uint64), 2, 0)  # keys that follow each other
    assert abs(np.corrcoef(neighbours[1:, 0], neighbours[:-1, 0])[0, 1]) < 0.06


def test_the_first_fit_counts_every_unit_once() -> None:
    found = units_of(residuals(5, 100, 0, 0), windows(5, 100))
    assert np.array_equal(found.weights(np.arange(3), 4, 0)[:, 0], np.ones(3))


def test_correlations_are_those_that_were_made() -> None:
    made = windows(40, 156)
    along, across, _, _ = correlations(residuals(40, 156, 0.6, 0), made)
    np.testing.assert_allclose([along, across], [0.6, 0], atol=0.03)
    along, across, _, _ = correlations(residuals(40, 156, 0, 1.0), made)
    np.testing.assert_allclose([along, across], [0, 0.5], atol=0.1)


def test_unlabelled_windows_and_windows_of_other_groups_do_not_count() -> None:
    values = np.array([1.0, -1, np.nan, 2, -2, 3])
    some = windows(2, 3)
    centred = values - np.nanmean(values)
    variance = np.nanmean(centred**2)
    along, across, _, _ = correlations(values, some)
    np.testing.assert_allclose(
        along, np.mean([centred[0] * centred[1], centred[3] * centred[4], centred[4] * centred[5]]) / variance
    )
    np.testing.assert_allclose(across, np.mean([centred[0] * centred[3], centred[1] * centred[4]]) / variance)


@pytest.mark.parametrize(
    ("groups", "times", "rho", "shared", "kind"),
    [
        (40, 156, 0.6, 0.0, "groups"),
        (40, 156, 0.6, 1.0, "blocks"),  # a shock that all groups share
        (12, 156, 0.6, 0.0, "blocks"),  # too few groups
        (1, 156, 0.6, 0.0, "blocks"),
        (1, 156, 0.0, 0.0, "blocks"),
    ],
)
def test_the_scheme_follows_from_the_residuals(groups: int, times: int, rho: float, shared: float, kind: str) -> None:
    found = units_of(residuals(groups, times, rho, shared, seed=2), windows(groups, times))
    assert found.kind == kind
    assert kind in found.said or "windows are resampled" in found.said
    if kind == "blocks":
        assert (found.length > 1) == (rho > 0)
        one = found.of.reshape(groups, times)
        assert (one == one[0]).all()  # common to all groups
    else:
        assert len(found) == groups


def test_blocks_grow_with_the_correlation_and_ten_are_left() -> None:
    assert [block_length(rho, 156) for rho in (-0.5, 0.0, 0.3, 0.6)] == [1, 1, 5, 10]
    assert block_length(0.95, 156) == 15
    assert block_length(0.6, 9) == 1


def test_below_ten_units_there_is_no_interval_and_it_is_said_why() -> None:
    found = units_of(residuals(3, 9, 0, 0), windows(3, 9))
    assert not found.enough
    assert np.isnan(found.quantile(0.9))
    assert "no intervals" in found.said
    assert "10" in found.said


def test_a_mean_is_covered_as_often_as_said() -> None:
    """Of 12 units: with the correction and Student's t, and not with the normal quantile alone."""
    count, draws, level = 12, 200, 0.9
    units = Units("blocks", np.arange(count), np.arange(count, dtype=np.uint64), 1, 0, 0, "")
    random, covered = np.random.default_rng(0), []
    for trial in range(600):
        values = random.normal(size=count)
        weights = units.weights(np.arange(count), draws, seed=trial)[:, 1:]
        error = ((weights.T @ values) / weights.sum(0)).std() * units.correction
        covered.append(abs(values.mean()) < units.quantile(level) * error)
    assert 0.87 < np.mean(covered) < 0.93


def test_groups_are_weighted_by_their_names() -> None:
    one = units_of(residuals(30, 50, 0, 0), windows(30, 50))
    assert one.kind == "groups"
    half = windows(15, 50)
    assert np.array_equal(one.key[:15], units_of(residuals(30, 50, 0, 0), windows(30, 50)).key[: len(half.groups)])
