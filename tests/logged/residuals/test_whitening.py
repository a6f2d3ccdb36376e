"""Whitening and expected errors of steps against dense matrices of the same model, and Chow-Lin's formula."""

from __future__ import annotations

import numpy as np
import pytest

from credit.core.errors import UserError
from credit.logged.panel import LabelIs
from credit.logged.residuals.autocorrelation import solved
from credit.logged.residuals.balance import balanced
from credit.logged.residuals.whitening import Layout, errors, whiten

from .peers import autoregression, chow_lin, sums

RHOS = [-0.5, 0.0, 0.6, 0.95, 0.999]
KINDS: list[LabelIs] = ["sum", "mean", "last"]
STEPS = np.array([3, 7, 1, 1, 12, 5, 2, 7, 30, 4, 7, 7, 1, 6], dtype=np.int64)
GROUP = np.array([0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 2, 3, 3, 3], dtype=np.int64)
LABELLED = np.array([0, 1, 1, 0, 1, 1, 1, 0, 0, 1, 1, 1, 1, 0], dtype=bool)  # a gap before, between and after


def dense(rho: float, label_is: LabelIs) -> tuple[np.ndarray, np.ndarray]:
    """Covariance of steps, groups apart [n, n], and C of labelled windows."""
    row_group = np.repeat(GROUP, STEPS)
    return autoregression(len(row_group), rho) * np.equal.outer(row_group, row_group), sums(STEPS, label_is)[LABELLED]


@pytest.mark.parametrize("label_is", KINDS)
@pytest.mark.parametrize("rho", RHOS)
def test_whitening_is_the_inverse_of_the_cholesky_factor(rho: float, label_is: LabelIs) -> None:
    sigma, c = dense(rho, label_is)
    factor = np.linalg.cholesky(c @ sigma @ c.T)
    values = np.random.default_rng(0).normal(size=(len(STEPS), 4))
    values[~LABELLED] = np.nan  # not read
    found = whiten(values, Layout.of(STEPS, GROUP, LABELLED, label_is), rho)
    np.testing.assert_allclose(found.values[LABELLED], np.linalg.solve(factor, values[LABELLED]), rtol=1e-9, atol=1e-10)
    assert (found.values[~LABELLED] == 0).all()
    assert found.logdet == pytest.approx(2 * np.log(np.diag(factor)).sum(), rel=1e-10)


@pytest.mark.parametrize("label_is", KINDS)
@pytest.mark.parametrize("rho", RHOS)
def test_errors_of_steps_are_their_conditional_expectation(rho: float, label_is: LabelIs) -> None:
    sigma, c = dense(rho, label_is)
    residual = np.random.default_rng(1).normal(size=len(STEPS)) * 10
    wanted = sigma @ c.T @ np.linalg.solve(c @ sigma @ c.T, residual[LABELLED])
    residual[~LABELLED] = np.nan
    found = errors(residual, Layout.of(STEPS, GROUP, LABELLED, label_is), rho)
    np.testing.assert_allclose(found.rows(), wanted, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(c @ found.rows(), residual[LABELLED], rtol=1e-9)


def test_errors_are_unfolded_part_by_part_as_at_once() -> None:
    residual = np.random.default_rng(2).normal(size=len(STEPS))
    found = errors(residual, Layout.of(STEPS, GROUP, LABELLED), 0.7)
    parts = [found.rows(slice(first, first + 3)) for first in range(0, len(STEPS), 3)]  # a part begins within a group
    np.testing.assert_array_equal(np.concatenate(parts), found.rows())


def test_whitening_may_write_where_it_reads() -> None:
    values, layout = np.random.default_rng(3).normal(size=(len(STEPS), 2)), Layout.of(STEPS, GROUP, LABELLED)
    wanted = whiten(values.copy(), layout, 0.6).values
    np.testing.assert_array_equal(whiten(values, layout, 0.6, out=values).values, wanted)
    np.testing.assert_array_equal(values, wanted)


def test_groups_and_single_rows_by_hand() -> None:
    """Two rows with a label each, ρ = .5: u_1 has variance 4/3, of which .5 u_1 is expected in the second."""
    layout = Layout.of(np.array([1, 1, 1]), np.array([0, 0, 1]), np.array([True, True, True]))
    found = whiten(np.array([[1.0], [2.0], [3.0]]), layout, 0.5)
    np.testing.assert_allclose(found.values[:, 0], [np.sqrt(0.75), 1.5, 3 * np.sqrt(0.75)], rtol=1e-14)
    assert found.logdet == pytest.approx(2 * np.log(4 / 3))
    np.testing.assert_allclose(errors(np.array([1.0, 2, 3]), layout, 0.5).rows(), [1, 2, 3], rtol=1e-14)


def test_without_correlation_a_residual_is_shared_alike() -> None:
    layout = Layout.of(np.array([2, 4, 3]), np.zeros(3, dtype=int), np.array([True, False, True]))
    found = errors(np.array([6.0, np.nan, 1.5]), layout, 0.0).rows()
    np.testing.assert_allclose(found, [3, 3, 0, 0, 0, 0, 0.5, 0.5, 0.5], atol=1e-15)


@pytest.mark.parametrize("label_is", KINDS)
@pytest.mark.parametrize("rho", [0.0, 0.3, 0.8, 0.99])
def test_one_group_without_ridge_is_chow_lin(rho: float, label_is: LabelIs) -> None:
    random = np.random.default_rng(4)
    steps = random.integers(5, 10, 30)
    n, group = int(steps.sum()), np.zeros(30, dtype=np.int64)
    x = np.column_stack([np.ones(n), random.normal(size=n), random.uniform(0, 50, n)])
    label = sums(steps, label_is) @ (x @ [1.0, 2, 0.3] + np.cumsum(random.normal(size=n)) / 3)
    label[[3, 20, 29]] = np.nan
    wanted = chow_lin(label, x, steps, rho, label_is)

    layout = Layout.of(steps, group, np.isfinite(label), label_is)
    design = sums(steps, label_is) @ x
    white, left = whiten(design, layout, rho).values, whiten(label[:, None], layout, rho).values[:, 0]
    theta = solved(white.T @ white, white.T @ left)
    shares = errors(label - design @ theta, layout, rho).rows()
    found = balanced(x @ theta, label, steps, label_is, errors=shares)
    np.testing.assert_allclose(found, wanted, rtol=1e-8, atol=1e-8 * np.abs(wanted).max())


@pytest.mark.parametrize("rho", [1.0, -1.0, 1.5, np.nan])
def test_a_correlation_out_of_range_is_refused(rho: float) -> None:
    layout = Layout.of(np.array([1, 1]), np.array([0, 0]), np.array([True, True]))
    with pytest.raises(UserError, match="above −1 and below 1"):
        whiten(np.ones((2, 1)), layout, rho)


def test_bits_have_nothing_left_for_steps() -> None:
    with pytest.raises(UserError, match=r"data\.label_is=binary.*allowed"):
        Layout.of(np.array([1]), np.array([0]), np.array([True]), "binary")


def test_a_long_window_and_no_window() -> None:
    layout = Layout.of(np.array([100_000]), np.array([0]), np.array([True]))
    found = errors(np.array([1e6]), layout, 0.999).rows()
    assert found.sum() == pytest.approx(1e6, rel=1e-9)
    np.testing.assert_allclose(found, found[::-1], rtol=1e-9)
    none = Layout.of(np.zeros(0, dtype=int), np.zeros(0, dtype=int), np.zeros(0, dtype=bool))
    assert whiten(np.zeros((0, 2)), none, 0.5).values.shape == (0, 2)
    assert errors(np.zeros(0), none, 0.5).rows().shape == (0,)
