"""Equations (4) and (6): the recursive fits are the ridge solution."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from credit.core.interfaces import FeatureMap
from credit.core.types import Problem, Windows
from credit.recovery.features.tabular import Bilinear, Identity, Threshold
from credit.recovery.models.linear import LinearModel

Make = Callable[..., Problem]
MakeWindows = Callable[..., Windows]


def one_hot_counts(windows: Windows, replica: int, pairs: int = 30) -> np.ndarray:
    """X of (3): how often each pair occurs in each window [K, N]."""
    index = (windows.states * 3 + windows.actions)[replica].numpy()
    return np.stack([np.bincount(row, minlength=pairs) for row in index]).astype(float)


def ridge(x: np.ndarray, y: np.ndarray, weight: np.ndarray, penalty: float) -> np.ndarray:
    """The weighted normal equations (XᵀWX + λI) θ = XᵀWy."""
    return np.linalg.solve((x.T * weight) @ x + penalty * np.eye(x.shape[1]), (x.T * weight) @ y)


@pytest.mark.parametrize("penalty", [1e-3, 0.1, 10.0])
def test_recursive_fits_equal_the_direct_solution(
    make_problem: Make, make_windows: MakeWindows, penalty: float
) -> None:
    problem = make_problem((0, 1))
    windows = make_windows(problem, 2000, seed=3)
    weights = torch.poisson(torch.ones(2, 2000, 3, dtype=torch.float64), generator=torch.Generator().manual_seed(4))
    weights[..., 0] = 1
    model = LinearModel("ridge", Identity(), penalty)
    model.start(problem, 2)
    for start in (0, 1, 500):  # in pieces of several sizes
        stop = {0: 1, 1: 500, 500: 2000}[start]
        piece = Windows(
            *(part[:, start:stop] for part in (windows.states, windows.actions, windows.next_states, windows.labels))
        )
        model.observe(piece, weights[:, start:stop])
    estimate = model.estimate()
    assert estimate.mean.shape == (2, 30)
    assert estimate.draws.shape == (2, 2, 30)
    for replica in range(2):
        x, y = one_hot_counts(windows, replica), windows.labels[replica].numpy()
        fits = [estimate.mean[replica], *estimate.draws[replica]]
        for fit, weight in zip(fits, weights[replica].T.numpy(), strict=True):
            np.testing.assert_allclose(fit.numpy(), ridge(x, y, weight, penalty), atol=1e-9, rtol=0)


@pytest.mark.parametrize("features", [Identity(), Bilinear(), Threshold()])
def test_refit_equals_observe(make_problem: Make, make_windows: MakeWindows, features: FeatureMap) -> None:
    problem = make_problem((0, 1, 2))
    windows = make_windows(problem, 60)
    weights = torch.rand(3, 60, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(2))
    online, direct = LinearModel("a", features, 0.1), LinearModel("b", features, 0.1)
    online.start(problem, 3)
    direct.start(problem, 3)
    online.observe(windows, weights)
    direct.observe(make_windows(problem, 10, seed=9), torch.ones(3, 10, 4, dtype=torch.float64))
    direct.refit(windows, weights)  # forgets the ten windows before
    torch.testing.assert_close(online.estimate().mean, direct.estimate().mean, atol=1e-10, rtol=0)
    torch.testing.assert_close(online.estimate().draws, direct.estimate().draws, atol=1e-10, rtol=0)
    torch.testing.assert_close(online.leverage(), direct.leverage(), atol=1e-10, rtol=0)


def test_a_window_of_weight_zero_changes_nothing(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0,))
    model = LinearModel("ridge", Identity(), 0.1)
    model.start(problem, 1)
    model.observe(make_windows(problem, 5), torch.tensor([1.0, 0.0], dtype=torch.float64).expand(1, 5, 2))
    estimate = model.estimate()
    assert estimate.mean.abs().max() > 0
    assert (estimate.draws == 0).all()


def test_one_window_by_hand(make_problem: Make) -> None:
    # Pairs 1, 1, 2 of S = 2, A = 2: x = (0, 2, 1, 0), Y = 3, λ = 1: θ = xY/(λ + xᵀx) = x·3/6 = (0, 1, .5, 0)
    problem = make_problem((0,), states=2, actions=2, window=3)
    windows = Windows(
        torch.tensor([[[0, 0, 1]]]),
        torch.tensor([[[1, 1, 0]]]),
        torch.tensor([[[0, 1, 1]]]),
        torch.tensor([[3.0]], dtype=torch.float64),
    )
    model = LinearModel("ridge", Identity(), 1.0)
    model.start(problem, 0)
    model.observe(windows, torch.ones(1, 1, 1, dtype=torch.float64))
    assert model.window_features(windows).tolist() == [[[0, 2, 1, 0]]]
    torch.testing.assert_close(model.theta, torch.tensor([[0, 1, 0.5, 0]], dtype=torch.float64))
    # V = I + xxᵀ: V⁻¹ = I − xxᵀ/6, so the leverages are 1 − (0, 4, 1, 0)/6
    torch.testing.assert_close(model.leverage(), torch.tensor([[1, 1 / 3, 5 / 6, 1]], dtype=torch.float64))


@pytest.mark.parametrize("features", [Identity(), Bilinear(), Threshold()])
def test_without_data_nothing_is_predicted(make_problem: Make, features: FeatureMap) -> None:
    problem = make_problem((0, 1))
    model = LinearModel("any", features, 0.25)
    model.start(problem, 2)
    assert (model.estimate().mean == 0).all()
    assert (model.estimate().draws == 0).all()
    torch.testing.assert_close(model.leverage(), (model.table.square().sum(-1) / 0.25).expand(2, -1))


@pytest.mark.parametrize("features", [Identity(), Bilinear(), Threshold()])
def test_leverage_and_perturbation_against_the_covariance(
    make_problem: Make, make_windows: MakeWindows, features: FeatureMap
) -> None:
    problem = make_problem((0, 1))
    windows = make_windows(problem, 80)
    model = LinearModel("any", features, 0.2)
    model.start(problem, 0)
    model.observe(windows, torch.ones(2, 80, 1, dtype=torch.float64))
    size = model.table.shape[1]
    columns = torch.stack([model.perturbation(unit.expand(2, -1)) for unit in torch.eye(size, dtype=torch.float64)], -1)
    phi = features(problem.cells.steps(problem.device)).numpy()
    for replica in range(2):
        x = phi[(windows.states * 3 + windows.actions)[replica].numpy()].sum(1)
        covariance = phi @ np.linalg.inv(x.T @ x + 0.2 * np.eye(size)) @ phi.T
        np.testing.assert_allclose(model.leverage()[replica], covariance.diagonal(), atol=1e-9)
        # cov(ΦLz) = (ΦL)(ΦL)ᵀ, and perturbation is linear in z
        np.testing.assert_allclose(columns[replica] @ columns[replica].T, covariance, atol=1e-9)


def test_starting_again_forgets(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0,))
    model = LinearModel("ridge", Identity(), 0.1)
    model.start(problem, 0)
    model.observe(make_windows(problem, 20), torch.ones(1, 20, 1, dtype=torch.float64))
    model.start(problem, 0)
    assert (model.estimate().mean == 0).all()
