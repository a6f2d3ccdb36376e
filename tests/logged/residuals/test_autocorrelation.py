"""The estimate of ρ against a grid of the likelihood by dense matrices, and where there is nothing to tell it."""

from __future__ import annotations

import numpy as np
import pytest

from credit.core.errors import UserError
from credit.logged.panel import LabelIs
from credit.logged.residuals.autocorrelation import Autocorrelation, estimated_rho, solved
from credit.logged.residuals.whitening import Layout, whiten

from .peers import autoregression, generalised, sums


def series(rho: float, windows: int, seed: int, groups: int = 1) -> tuple[np.ndarray, ...]:
    """Steps, groups, features of windows [W, 2], and labels, of errors AR(ρ)."""
    random = np.random.default_rng(seed)
    steps = random.integers(3, 8, windows * groups)
    n, group = int(steps.sum()), np.repeat(np.arange(groups), windows)
    noise, u = random.normal(size=n), np.zeros(n)
    fresh = np.flatnonzero(np.diff(np.repeat(group, steps), prepend=-1))
    u[0] = noise[0]
    for t in range(1, n):
        u[t] = noise[t] / np.sqrt(1 - rho**2) if t in fresh else rho * u[t - 1] + noise[t]
    x = np.column_stack([np.ones(n), random.normal(size=n)])
    c = sums(steps)
    return steps, group, c @ x, c @ (x @ [2.0, 1] + u)


def found(steps: np.ndarray, group: np.ndarray, x: np.ndarray, y: np.ndarray, **how: object) -> Autocorrelation:
    return estimated_rho(x, y, Layout.of(steps, group, np.isfinite(y)), **how)  # type: ignore[arg-type]


@pytest.mark.parametrize("criterion", ["likelihood", "rss"])
@pytest.mark.parametrize("label_is", ["sum", "mean"])
def test_it_is_the_top_of_the_likelihood_by_dense_matrices(criterion: str, label_is: LabelIs) -> None:
    steps, group, x, y = series(0.6, 36, seed=0)
    scale = steps if label_is == "mean" else np.ones(len(steps))
    x, y = x / scale[:, None], y / scale
    y[[5, 6, 20]] = np.nan
    known = np.isfinite(y)
    got = estimated_rho(x, y, Layout.of(steps, group, known, label_is), criterion=criterion)  # type: ignore[arg-type]
    c = sums(steps, label_is)[known]

    def dense(rho: float) -> tuple[float, float, np.ndarray]:
        v = c @ autoregression(c.shape[1], rho) @ c.T
        _, theta, likelihood = generalised(y[known], x[known], np.eye(known.sum()), v)
        left = y[known] - x[known] @ theta
        return likelihood, float(left @ np.linalg.solve(v, left)), theta

    likelihood, cost, theta = dense(got.rho)
    assert got.likelihood == pytest.approx(likelihood, rel=1e-10)
    assert got.variance == pytest.approx(cost / known.sum(), rel=1e-9)
    np.testing.assert_allclose(got.theta, theta, rtol=1e-8)
    best = {"likelihood": lambda rho: -dense(rho)[0], "rss": lambda rho: dense(rho)[1]}[criterion]
    assert best(got.rho) <= min(best(rho) for rho in np.arange(0, 1, 0.1)) + 1e-6


@pytest.mark.parametrize("rho", [0.0, 0.6, 0.95])
def test_many_windows_tell_it(rho: float) -> None:
    got = found(*series(rho, 150, seed=1, groups=10))
    assert got.rho == pytest.approx(rho, abs=0.08)
    assert f"{got.rho}".rstrip("0").rstrip(".") in got.said
    assert "1500 labels" in got.said


def test_it_does_not_depend_on_units() -> None:
    steps, group, x, y = series(0.6, 60, seed=2)
    assert found(steps, group, x, y).rho == found(steps, group, x * [1, 1e-6], y * 1e6).rho


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_a_grid_of_what_one_theta_leaves_ends_at_the_same(rho: float, monkeypatch: pytest.MonkeyPatch) -> None:
    data = series(rho, 40, seed=8)
    wanted = found(*data)
    monkeypatch.setattr("credit.logged.residuals.autocorrelation.MANY", 10)
    assert found(*data).rho == pytest.approx(wanted.rho, abs=2e-4)
    monkeypatch.setattr("credit.logged.residuals.autocorrelation.GRID", (0.98, 0.99))  # begins beside the right place
    assert found(*data).rho == pytest.approx(wanted.rho, abs=2e-4)


def test_bounds_are_kept_and_said() -> None:
    data = series(-0.8, 80, seed=3)
    at_zero = found(*data)
    assert at_zero.rho == 0
    assert "at its bound" in at_zero.said
    assert found(*data, low=-0.9).rho < -0.3
    assert found(*data, low=0.4, high=0.4).rho == 0.4


@pytest.mark.parametrize(("low", "high"), [(0.5, 0.4), (-1.0, 0.5), (0.0, 1.0), (np.nan, 0.5)])
def test_bounds_that_are_none_are_refused(low: float, high: float) -> None:
    with pytest.raises(UserError, match="low ≤ high"):
        found(*series(0.5, 10, seed=3), low=low, high=high)


def test_a_penalty_holds_back_and_counts() -> None:
    steps, group, x, y = series(0.6, 60, seed=4)
    penalty = np.diag([0.0, 1e9])
    got = found(steps, group, x, y, penalty=penalty)
    layout = Layout.of(steps, group, np.isfinite(y))
    white, left = whiten(x, layout, got.rho).values, whiten(y[:, None], layout, got.rho).values[:, 0]
    np.testing.assert_allclose(got.theta, np.linalg.solve(white.T @ white + penalty, white.T @ left), rtol=1e-9)
    assert abs(got.theta[1]) < 1e-6
    assert got.rho == pytest.approx(found(steps, group, x[:, :1], y).rho, abs=2e-4)


def test_without_columns_it_is_that_of_residuals() -> None:
    steps, group, x, y = series(0.6, 60, seed=5)
    got = found(steps, group, x[:, :0], y - x @ [2.0, 1])
    assert got.theta.shape == (0,)
    assert got.rho == pytest.approx(0.6, abs=0.25)


def test_nothing_left_and_too_few_labels_tell_nothing() -> None:
    steps, group, x, y = series(0.6, 60, seed=6)
    exact = found(steps, group, x, x @ [3.0, 1])
    assert (exact.rho, "nothing left" in exact.said) == (0, True)
    np.testing.assert_allclose(exact.theta, [3, 1], rtol=1e-9)
    y[4:] = np.nan
    few = found(steps, group, x, y)
    assert (few.rho, "4 labels for 2 columns" in few.said) == (0, True)


def test_columns_that_are_not_told_apart_share() -> None:
    x = np.random.default_rng(7).normal(size=(20, 1)) * [1, 2, 0]
    theta = solved(x.T @ x, x.T @ (4 * x[:, 0]))
    np.testing.assert_allclose(theta, [2, 1, 0], rtol=1e-9)
