"""Equations (4) and (6): the recursive fits are the ridge solution."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from credit.core.errors import UserError
from credit.core.problem import FLOAT, Problem
from credit.core.seams import FeatureMap
from credit.core.store import Windows
from credit.recovery.features.tabular import Bilinear, Identity, Threshold
from credit.recovery.models import linear
from credit.recovery.models.linear import LinearModel
from credit.recovery.uncertainty.bootstrap import Analytic

from ..fits import Experience, Given, part, poisson

Make = Callable[..., Problem]
MakeWindows = Callable[..., Windows]


def one_hot_counts(windows: Windows, replica: int, pairs: int = 30) -> np.ndarray:
    """X of (3): how often each pair occurs in each window [K, N]."""
    index = windows.grid(windows.states * 3 + windows.actions)[replica].numpy()
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
    weights = poisson(windows, 2)
    model = LinearModel("ridge", Identity(), Given(2), penalty)
    experience = Experience(problem, model)
    for which in (slice(1), slice(1, 500), slice(500, 2000)):  # in pieces of several sizes
        experience.see(part(windows, which), weights[:, which])
    estimate = model.estimate()
    assert estimate.mean.shape == (2, 30)
    assert estimate.draws is not None
    assert estimate.draws.shape == (2, 2, 30)
    for replica in range(2):
        x, y = one_hot_counts(windows, replica), windows.labels[replica].numpy()
        fits = [estimate.mean[replica], *estimate.draws[replica]]
        for fit, weight in zip(fits, weights[replica].T.numpy(), strict=True):
            np.testing.assert_allclose(fit.numpy(), ridge(x, y, weight, penalty), atol=1e-9, rtol=0)


@pytest.mark.parametrize("features", [Identity(), Bilinear(), Threshold()])
def test_fitting_anew_equals_window_by_window(
    make_problem: Make, make_windows: MakeWindows, features: FeatureMap
) -> None:
    problem = make_problem((0, 1, 2))
    windows = make_windows(problem, 60)
    weights = torch.rand(3, 60, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(2))
    online, direct = LinearModel("a", features, Given(3), 0.1), LinearModel("b", features, Given(3), 0.1)
    Experience(problem, online).see(windows, weights)
    Experience(problem, direct).see(make_windows(problem, 10, seed=9)).anew(windows, weights)  # forgets the ten before
    torch.testing.assert_close(online.estimate().mean, direct.estimate().mean, atol=1e-10, rtol=0)
    torch.testing.assert_close(online.estimate().draws, direct.estimate().draws, atol=1e-10, rtol=0)
    torch.testing.assert_close(online.leverage(), direct.leverage(), atol=1e-10, rtol=0)


def test_a_window_of_weight_zero_changes_nothing(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0,))
    model = LinearModel("ridge", Identity(), Given(1), 0.1)
    Experience(problem, model).see(make_windows(problem, 5), torch.tensor([1.0, 0.0], dtype=FLOAT).expand(1, 5, 2))
    estimate = model.estimate()
    assert estimate.mean.abs().max() > 0
    assert (estimate.draws == 0).all()


def test_one_window_by_hand(make_problem: Make) -> None:
    # Pairs 1, 1, 2 of S = 2, A = 2: x = (0, 2, 1, 0), Y = 3, λ = 1: θ = xY/(λ + xᵀx) = x·3/6 = (0, 1, .5, 0)
    problem = make_problem((0,), states=2, actions=2, window=3)
    windows = Windows.of_grid(
        torch.tensor([[[0, 0, 1]]]),
        torch.tensor([[[1, 1, 0]]]),
        torch.tensor([[[0, 1, 1]]]),
        torch.tensor([[3.0]], dtype=torch.float64),
    )
    model = LinearModel("ridge", Identity(), Given(), 1.0)
    Experience(problem, model).see(windows)
    assert windows.sums(model.features(windows)).tolist() == [[[0, 2, 1, 0]]]
    torch.testing.assert_close(model.theta, torch.tensor([[0, 1, 0.5, 0]], dtype=torch.float64))
    # V = I + xxᵀ: V⁻¹ = I − xxᵀ/6, so the leverages are 1 − (0, 4, 1, 0)/6
    torch.testing.assert_close(model.leverage(), torch.tensor([[1, 1 / 3, 5 / 6, 1]], dtype=torch.float64))


@pytest.mark.parametrize("features", [Identity(), Bilinear(), Threshold()])
def test_without_data_nothing_is_predicted(make_problem: Make, features: FeatureMap) -> None:
    problem = make_problem((0, 1))
    model = LinearModel("any", features, Given(2), 0.25)
    Experience(problem, model)
    estimate = model.estimate()
    assert estimate.draws is not None
    assert (estimate.mean == 0).all()
    assert (estimate.draws == 0).all()
    table = features(problem.cells.steps(problem.device))
    torch.testing.assert_close(model.leverage(), (table.square().sum(-1) / 0.25).expand(2, -1))


@pytest.mark.parametrize("features", [Identity(), Bilinear(), Threshold()])
def test_leverage_and_perturbation_against_the_covariance(
    make_problem: Make, make_windows: MakeWindows, features: FeatureMap
) -> None:
    problem = make_problem((0, 1))
    windows = make_windows(problem, 80)
    model = LinearModel("any", features, Given(), 0.2)
    Experience(problem, model).see(windows)
    size = model.theta.shape[1]
    columns = torch.stack([model.perturbation(unit.expand(2, -1)) for unit in torch.eye(size, dtype=torch.float64)], -1)
    phi = features(problem.cells.steps(problem.device)).numpy()
    for replica in range(2):
        x = one_hot_counts(windows, replica) @ phi
        covariance = phi @ np.linalg.inv(x.T @ x + 0.2 * np.eye(size)) @ phi.T
        np.testing.assert_allclose(model.leverage()[replica], covariance.diagonal(), atol=1e-9)
        # cov(ΦLz) = (ΦL)(ΦL)ᵀ, and perturbation is linear in z
        np.testing.assert_allclose(columns[replica] @ columns[replica].T, covariance, atol=1e-9)


def test_starting_again_forgets(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0,))
    model = LinearModel("ridge", Identity(), Given(), 0.1)
    Experience(problem, model).see(make_windows(problem, 20))
    Experience(problem, model)
    assert (model.estimate().mean == 0).all()


def test_some_cells_are_predicted_as_all_are(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0, 1))
    model = LinearModel("any", Bilinear(), Given(2), 0.1)
    windows = make_windows(problem, 20)
    Experience(problem, model).see(windows, poisson(windows, 2))
    at = torch.tensor([[3, 3, 29], [0, 7, 11]])
    whole, some = model.estimate(), model.estimate(at)
    assert whole.draws is not None
    assert some.draws is not None
    torch.testing.assert_close(some.mean, whole.mean.gather(1, at))
    torch.testing.assert_close(some.variance, whole.variance.gather(1, at))
    torch.testing.assert_close(some.draws, whole.draws.gather(2, at.unsqueeze(1).expand(2, 2, 3)))
    cells = problem.cells.steps(problem.device)
    torch.testing.assert_close(model.believe(cells).mean, whole.mean)


@pytest.mark.parametrize("at_once", [True, False])
def test_the_unit_only_sets_where_the_penalty_acts(
    make_problem: Make, make_windows: MakeWindows, at_once: bool
) -> None:
    # features of ten steps instead of one, and a penalty that is a hundredth: the same fit
    problem = make_problem((0, 1))
    windows = make_windows(problem, 40)
    ten, one = (LinearModel("any", Bilinear(), Analytic(None), *keys) for keys in ((0.01, "every_step", 10.0), (1.0,)))
    for model in (ten, one):
        experience = Experience(problem, model)
        for piece in [windows] if at_once else [part(windows, slice(k, k + 1)) for k in range(40)]:
            experience.see(piece)
    torch.testing.assert_close(ten.estimate().mean, one.estimate().mean)
    torch.testing.assert_close(ten.estimate().variance, one.estimate().variance)
    torch.testing.assert_close(ten.theta, 10 * one.theta)


def test_more_numbers_than_fit_are_refused_before_they_are_made(
    make_problem: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(linear, "LARGEST", 30 * 30 * 3 * 2 - 1)
    with pytest.raises(UserError, match=r"'ridge': 30 features, 3 fits and 2 seeds need 5\.4e\+03 numbers"):
        Experience(make_problem((0, 1)), LinearModel("ridge", Identity(), Given(2)))
