"""Stacked weights against a general optimizer, and out-of-bag errors of labels against loops."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from scipy.optimize import minimize

from credit.core.belief import Estimate
from credit.core.cells import Axis
from credit.core.problem import FLOAT, Problem
from credit.core.store import Store
from credit.core.windows import Windows
from credit.recovery.features.tabular import Bilinear, Identity, Threshold
from credit.recovery.mixers import Stacking, stacked_weights
from credit.recovery.models.linear import LinearModel
from credit.recovery.uncertainty.bootstrap import Analytic, Bootstrap

from .fits import Experience, cells_of

Make = Callable[..., Problem]
MakeWindows = Callable[..., Windows]


def products(models: int, seed: int) -> np.ndarray:
    """G = I + EEᵀ of a problem in which some models are close to each other, and some are biased."""
    random = np.random.default_rng(seed)
    common = random.normal(size=(1, 40))
    errors = random.uniform(0, 2, (models, 1)) * common + random.uniform(0.1, 1, (models, 1)) * random.normal(
        size=(models, 40)
    )
    return np.eye(models) + errors @ errors.T


@pytest.mark.parametrize("models", [2, 3, 4, 5])
def test_weights_equal_those_of_a_general_optimizer(models: int) -> None:
    problems = np.stack([products(models, seed) for seed in range(8)])
    found = stacked_weights(torch.from_numpy(problems)).numpy()
    assert found.shape == (8, models)
    assert (found >= 0).all()
    np.testing.assert_allclose(found.sum(-1), 1, atol=1e-12)
    assert (found == 0).any()  # the bounds matter
    for matrix, weights in zip(problems, found, strict=True):
        scale = matrix.max()
        best = minimize(
            lambda w, g=matrix / scale: w @ g @ w,
            np.full(models, 1 / models),
            jac=lambda w, g=matrix / scale: 2 * g @ w,
            bounds=[(0, None)] * models,
            constraints={"type": "eq", "fun": lambda w: w.sum() - 1, "jac": np.ones_like},
            method="SLSQP",
            options={"ftol": 1e-15, "maxiter": 1000},
        )
        assert weights @ matrix @ weights <= best.x @ matrix @ best.x + 1e-9 * scale
        np.testing.assert_allclose(weights, best.x, atol=1e-5)


def test_two_models_by_hand() -> None:
    # w₀ = (c − b)/(a + c − 2b) for G = (a b; b c), within [0, 1]
    matrices = torch.tensor([[[4, 1], [1, 2]], [[5, 3], [3, 4]], [[9, 4], [4, 3]]], dtype=FLOAT)
    expected = torch.tensor([[1 / 4, 3 / 4], [1 / 3, 2 / 3], [0, 1]], dtype=FLOAT)
    torch.testing.assert_close(stacked_weights(matrices), expected)


@pytest.mark.parametrize("models", [1, 2, 5])
def test_models_that_err_alike_share_the_weight(models: int) -> None:
    for size in (0.0, 1.0, 1e4):
        matrix = torch.eye(models, dtype=FLOAT) + size * torch.ones(models, models, dtype=FLOAT)
        torch.testing.assert_close(stacked_weights(matrix), torch.full((models,), 1 / models, dtype=FLOAT))


def test_two_equal_models_share_what_one_of_them_would_have() -> None:
    # errors (1, 1, .5) in 10,000 windows, independent: the pair weighs .2, the third .8, up to the identity
    matrix = torch.eye(3, dtype=FLOAT) + 1e4 * torch.tensor([[1, 1, 0], [1, 1, 0], [0, 0, 0.25]], dtype=FLOAT)
    torch.testing.assert_close(stacked_weights(matrix), torch.tensor([0.1, 0.1, 0.8]).double(), atol=1e-3, rtol=0)


def test_leading_dimensions_are_independent_problems() -> None:
    problems = torch.from_numpy(np.stack([products(3, seed) for seed in range(6)]))
    together = stacked_weights(problems.view(2, 3, 3, 3))
    assert together.shape == (2, 3, 3)
    for one, weights in zip(problems, together.view(6, 3), strict=True):
        assert torch.equal(stacked_weights(one), weights)


def test_every_cell_has_the_same_weights_whatever_the_proxies_are() -> None:
    errors = torch.from_numpy(np.stack([products(3, seed) for seed in range(2)]))
    mse = torch.rand(2, 3, 7, dtype=FLOAT, generator=torch.Generator().manual_seed(0))
    weights = Stacking(0.5).weights(mse, errors)
    assert weights.shape == (2, 3, 7)
    expected = stacked_weights(errors + 0.5 * torch.eye(3, dtype=FLOAT))
    assert torch.equal(weights, expected.unsqueeze(-1).repeat(1, 1, 7))
    assert Stacking(0.5).weights(mse.float(), errors).dtype == torch.float32
    with pytest.raises(ValueError, match=r"mse \[2, 2, 7\], label_errors \[2, 3, 3\]"):
        Stacking().weights(mse[:, 1:], errors)
    with pytest.raises(ValueError, match=r"errors \[3, 2\]; they must be errors \[..., M, M\]"):
        stacked_weights(errors[0, :, :2])


def test_the_prior_counts_as_so_many_labels() -> None:
    # Of 10 labels of deviation 1 the first model misses each by 1, the second none: G = diag(10 + τ, τ), and the
    # weights are as 1/(10 + τ) to 1/τ.
    errors, mse = torch.tensor([[10.0, 0], [0, 0]], dtype=FLOAT), torch.zeros(2, 1, dtype=FLOAT)
    for prior in (0.1, 1.0, 30.0):
        first = prior / (10 + 2 * prior)
        expected = torch.tensor([[first], [1 - first]], dtype=FLOAT)
        torch.testing.assert_close(Stacking(prior).weights(mse, errors), expected)


def test_without_labels_all_weights_are_equal_however_small_the_prior_is() -> None:
    mse = torch.zeros(4, 3, dtype=FLOAT)
    for prior in (1e-300, 1e-3, 1e3):
        found = Stacking(prior).weights(mse, torch.zeros(4, 4, dtype=FLOAT))
        torch.testing.assert_close(found, torch.full((4, 3), 0.25, dtype=FLOAT))


@pytest.mark.parametrize("unit", [1e-4, 1e4])
def test_the_unit_of_the_labels_does_not_matter(make_problem: Make, make_windows: MakeWindows, unit: float) -> None:
    problem, found = make_problem((5, 6)), []
    for scale in (1.0, unit):
        bootstrap = Bootstrap(5)
        models = [LinearModel(name, features, bootstrap) for name, features in (("r", Identity()), ("l", Bilinear()))]
        windows = make_windows(problem, 30)
        experience = Experience(problem, *models).see(replace(windows, labels=scale * windows.labels))
        index = problem.cells.index(experience.store.windows)
        errors = bootstrap.label_errors([model.estimate() for model in models], experience.store, index)
        found.append(Stacking().weights(problem.zeros(2, 1), errors))
    torch.testing.assert_close(*found, rtol=1e-6, atol=1e-9)
    assert (found[0] - 0.5).abs().max() > 0.1


def test_matrices_that_are_all_but_singular_have_weights() -> None:
    # two models that err alike by a thousand million deviations
    errors = 1e18 * torch.tensor([[1, 1, 1], [1, 1, 1], [1, 1, 4]], dtype=FLOAT)
    found = Stacking().weights(torch.zeros(3, 1, dtype=FLOAT), errors)[:, 0]
    torch.testing.assert_close(found, torch.tensor([0.5, 0.5, 0], dtype=FLOAT), atol=1e-3, rtol=0)


ARRIVALS: tuple[Axis, ...] = ("step", "next_state")


@pytest.mark.parametrize("resample", ["poisson", "exact"])
@pytest.mark.parametrize("axes", [("state", "action"), ARRIVALS], ids="-".join)
def test_errors_out_of_bag_against_loops(
    make_problem: Make, make_windows: MakeWindows, resample: Any, axes: tuple[Axis, ...]
) -> None:
    problem = replace(make_problem((5, 6)), episodic=True)
    bootstrap, draws = Bootstrap(3, resample=resample), 3
    if axes == ARRIVALS:
        models = [
            LinearModel("-".join(axes), Identity(axes), bootstrap),
            LinearModel("last", Identity(("next_state",)), bootstrap, 1, "last_step"),
        ]
    else:
        models = [
            LinearModel("ridge", Identity(), bootstrap),
            LinearModel("linear", Bilinear(), bootstrap),
            LinearModel("cells", Threshold(), bootstrap),
        ]
    experience, shown = Experience(problem, *models), []
    for count in (1, 5, 0, 18):  # the windows of every round are remembered
        experience.see(make_windows(problem, count, seed=count))
        shown.append(bootstrap.weights(experience.store).values)
    estimates, windows = [model.estimate() for model in models], experience.store.windows
    found = bootstrap.label_errors(estimates, experience.store, cells_of(problem, models).index(windows))
    assert found.shape == (2, len(models), len(models))
    weights = shown[-1] if resample == "exact" else torch.cat(shown, dim=1)
    assert weights.shape == (2, 24, 1 + draws)
    taken = [windows.grid(column) for column in (windows.states, windows.actions, windows.next_states)]
    counted = set()
    for replica in range(2):
        errors = np.zeros((len(models), 24))
        for k in range(24):
            blind = [b for b in range(draws) if weights[replica, k, 1 + b] == 0]
            counted.add(len(blind))
            if not blind:
                continue  # all draws have seen it: it tells nothing
            for j, estimate in enumerate(estimates):
                assert estimate.draws is not None
                predictions = []
                for b in blind:
                    total = 0.0
                    for t in range(7):
                        s, a, then = (int(part[replica, k, t]) for part in taken)
                        total += float(estimate.draws[replica, b, t * 10 + then if axes == ARRIVALS else s * 3 + a])
                    predictions.append(total)
                errors[j, k] = np.mean(predictions) - float(windows.labels[replica, k])
        np.testing.assert_allclose(found[replica], errors @ errors.T / windows.labels[replica].numpy().var(), rtol=1e-9)
    assert {0, 1, 2} <= counted  # among them windows that every draw has seen


def test_before_the_first_window_all_weights_are_equal(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0, 1))
    bootstrap, store = Bootstrap(3), Store(problem)
    bootstrap.start(problem)
    nothing = Estimate(problem.zeros(30), problem.zeros(30), problem.zeros(3, 30))
    for empty in (store, Store(problem)):
        if empty is store:  # a round that brought none
            empty.append(make_windows(problem, 0))
            bootstrap.weights(empty)
        errors = bootstrap.label_errors([nothing] * 4, empty, None)
        assert torch.equal(errors, problem.zeros(4, 4))
        found = Stacking().weights(problem.zeros(4, 30), errors)
        torch.testing.assert_close(found, torch.full((2, 4, 30), 0.25, dtype=FLOAT))


def test_an_uncertainty_without_resampling_holds_nothing_out(make_problem: Make) -> None:
    with pytest.raises(NotImplementedError, match="Analytic holds no labels out"):
        Analytic().label_errors([], Store(make_problem((0,))), None)
