"""Moments against sums written out; ridge against the normal equations, scikit-learn and a grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from credit.logged.fits.moments import Moments, moments
from credit.logged.fits.ridge import LAMBDAS, held_out, signed, solutions
from credit.logged.panel import Floats, Ints


def stacked(several: Sequence[Moments]) -> Moments:
    """Of several sets, side by side."""
    parts = [[getattr(one, name) for one in several] for name in ("xx", "xy", "yy", "weight")]
    return Moments(*(np.stack(part) for part in parts))


def ones(units: Ints) -> Floats:
    """Every window counts once, in one fit."""
    return np.ones((len(units), 1))


def made(windows: int = 60, size: int = 4, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    x = random.normal(size=(windows, size)) * np.array([1.0, 10, 0.1, 3])[:size] + 5
    x[:, 0] = random.integers(3, 9, windows)
    return x, x @ np.arange(1.0, size + 1) + random.normal(size=windows)


def plain(x: np.ndarray, y: np.ndarray, w: np.ndarray | None = None) -> Moments:
    w = np.ones(len(y)) if w is None else w
    return Moments((x * w[:, None]).T @ x, x.T @ (w * y), (w * y) @ y, w.sum())


def test_moments_of_pieces_and_draws_are_sums_written_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("credit.logged.fits.moments.NUMBERS", 100)  # many rounds
    x, y = made()
    random = np.random.default_rng(1)
    piece, unit = random.integers(0, 3, 60), random.integers(0, 7, 60)
    weights = random.exponential(size=(7, 5))
    found = moments(x, y, piece, unit, lambda units: weights[units], pieces=4, fits=5)
    for number in range(4):
        own = piece == number
        for fit in range(5):
            wanted = plain(x[own], y[own], weights[unit[own], fit])
            for name in ("xx", "xy", "yy", "weight"):
                np.testing.assert_allclose(
                    getattr(found[number, fit], name), getattr(wanted, name), rtol=1e-12, atol=1e-12
                )


def test_pieces_add_up_and_can_be_taken_away() -> None:
    x, y = made()
    piece = np.arange(60) // 20
    found = moments(x, y, piece, np.arange(60), ones, pieces=3, fits=1)
    whole, rest = found.sum(0)[0], (found.sum(0) - found[1])[0]
    np.testing.assert_allclose(whole.xx, x.T @ x, rtol=1e-12)
    np.testing.assert_allclose(rest.xy, x[piece != 1].T @ y[piece != 1], rtol=1e-12)
    np.testing.assert_allclose(whole.of(np.array([2, 0])).xx, (x.T @ x)[np.ix_([2, 0], [2, 0])], rtol=1e-12)


@pytest.mark.parametrize("penalty", [0.0, 0.3, 50.0])
def test_a_path_solves_the_normal_equations_with_columns_in_units_of_their_spread(penalty: float) -> None:
    x, y = made()
    theta = solutions(plain(x, y), np.array([7.0, penalty]), free=0)[1]
    spread = x - np.outer(x[:, 0], x[:, 0] @ x / (x[:, 0] @ x[:, 0]))  # the intercept taken out
    held = penalty * (spread**2).mean(0)
    held[0] = 0
    np.testing.assert_allclose(theta, np.linalg.solve(x.T @ x + np.diag(held), x.T @ y), rtol=1e-9)


def test_a_path_agrees_with_scikit_learn_where_all_windows_have_one_step() -> None:
    from sklearn.linear_model import Ridge

    x, y = made()
    x[:, 0] = 1
    unit = x[:, 1:].std(0)
    peer = Ridge(alpha=3.0).fit(x[:, 1:] / unit, y)
    theta = solutions(plain(x, y), np.array([3.0]), free=0)[0]
    np.testing.assert_allclose(theta, [peer.intercept_, *(peer.coef_ / unit)], rtol=1e-9)


def test_units_of_columns_do_not_matter() -> None:
    x, y = made()
    by = np.array([1.0, 1e6, 1e-6, -2])
    one = solutions(plain(x, y), LAMBDAS, free=0)
    np.testing.assert_allclose(solutions(plain(x * by, y), LAMBDAS, free=0) * by, one, rtol=1e-7, atol=1e-12)


def test_what_cannot_be_told_apart_shares_and_what_says_nothing_is_nothing() -> None:
    x, y = made()
    again = np.column_stack([x, x[:, 1], np.zeros(60), x[:, 0] * 2])  # twice, never, and the intercept's own
    theta = solutions(plain(again, y), np.array([0.0]), free=0)[0]
    alone = solutions(plain(x, y), np.array([0.0]), free=0)[0]
    np.testing.assert_allclose(theta[1], theta[4], rtol=1e-6)
    np.testing.assert_allclose(theta[1] + theta[4], alone[1], rtol=1e-6)
    assert theta[5] == theta[6] == 0
    np.testing.assert_allclose(again @ theta, x @ alone, rtol=1e-8)


def test_no_window_gives_no_effect() -> None:
    x, y = made()
    theta = solutions(plain(x[:0], y[:0]), LAMBDAS, free=0)
    assert not theta.any()


def test_held_out_errors_are_those_of_fits_that_have_not_seen_the_windows() -> None:
    x, y = made()
    piece = np.arange(60) // 12
    pieces = moments(x, y, piece, np.arange(60), ones, pieces=5, fits=1)
    folds = [(np.array([k]), np.array([j for j in range(5) if abs(j - k) > 1])) for k in range(5)]  # with a gap
    apart = [stacked([pieces[fold[side]].sum(0) for fold in folds]) for side in (1, 0)]
    found = held_out(*apart, LAMBDAS, free=0)[0]
    wanted = np.zeros(len(LAMBDAS))
    for tested, fitted in folds:
        inside, outside = np.isin(piece, fitted), np.isin(piece, tested)
        both = inside | outside  # by what columns are scaled
        theta = solutions(plain(x[inside], y[inside]), LAMBDAS, 0, plain(x[both], y[both]))
        wanted += ((y[outside] - theta @ x[outside].T) ** 2).sum(-1)
    np.testing.assert_allclose(found, wanted, rtol=1e-7)


def test_signs_are_kept_and_nothing_else_changes() -> None:
    x, y = made()
    y = y - 4 * x[:, 2]
    free = solutions(plain(x, y), np.array([1.0]), free=0)[0]
    assert free[2] < 0
    assert np.array_equal(signed(plain(x, y), 1.0, 0, np.array([0, 1, -1, 0])), free)  # as it is, it obeys
    bound = signed(plain(x, y), 1.0, 0, np.array([0, 1, 1, 0]))
    assert bound[2] == 0  # exactly: it is held there
    left = np.array([0, 1, 3])
    np.testing.assert_allclose(bound[2], 0, atol=1e-9)
    np.testing.assert_allclose(bound[left], solutions(plain(x[:, left], y), np.array([1.0]), 0)[0], rtol=1e-5)
