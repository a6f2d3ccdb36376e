"""Stacked weights against a general optimizer, and out-of-bag errors of labels against loops."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from scipy.optimize import minimize

from credit.core.cells import Axis
from credit.core.dataset import Dataset
from credit.core.tables import CellModel
from credit.core.types import FLOAT, Estimate, Problem, Windows
from credit.recovery.features.tabular import Bilinear, Identity, Threshold
from credit.recovery.mixers import Stacking, stacked_weights
from credit.recovery.models.linear import LinearModel
from credit.recovery.uncertainty.bootstrap import Analytic, Bootstrap

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
    weights = Stacking().weights(mse, errors)
    assert weights.shape == (2, 3, 7)
    assert torch.equal(weights, stacked_weights(errors).unsqueeze(-1).repeat(1, 1, 7))


class Spy(CellModel):
    """Remembers the weights that it is shown."""

    def __init__(self) -> None:
        self.name = "spy"
        self.shown: list[torch.Tensor] = []

    def start(self, problem: Problem, draws: int) -> None: ...

    def observe(self, windows: Windows, weights: torch.Tensor) -> None:
        self.shown.append(weights)

    def refit(self, windows: Windows, weights: torch.Tensor) -> None:
        self.shown = [weights]

    def estimate(self) -> Estimate:
        raise NotImplementedError


ARRIVALS: tuple[Axis, ...] = ("step", "next_state")


@pytest.mark.parametrize("resample", ["poisson", "exact"])
@pytest.mark.parametrize("axes", [("state", "action"), ARRIVALS], ids="-".join)
def test_errors_out_of_bag_against_loops(
    make_problem: Make, make_windows: MakeWindows, resample: Any, axes: tuple[Axis, ...]
) -> None:
    plain = make_problem((5, 6))
    problem = Problem(10, 3, 7, plain.seeds, plain.device, episodic=True, axes=axes)
    if axes == ARRIVALS:
        models = [
            LinearModel(str(axes), Identity(axes)),
            LinearModel("last", Identity(("next_state",)), 1, "last_step"),
        ]
    else:
        models = [
            LinearModel("ridge", Identity()),
            LinearModel("linear", Bilinear()),
            LinearModel("cells", Threshold()),
        ]
    bootstrap, dataset, spy, draws = Bootstrap(3, resample=resample), Dataset(problem, 2), Spy(), 3
    bootstrap.start(problem)
    for model in models:
        model.start(problem, draws)
    for count in (1, 5, 18):  # the windows of every round are remembered
        dataset.append(make_windows(problem, count, seed=count))
        bootstrap.observe([*models, spy], dataset)
    estimates, windows = [model.estimate() for model in models], dataset.windows
    found = bootstrap.label_errors(estimates, dataset, problem.cells.index(dataset.windows))
    assert found.shape == (2, len(models), len(models))
    weights = torch.cat(spy.shown, dim=1)
    assert weights.shape == (2, 24, 1 + draws)
    counted = set()
    for replica in range(2):
        errors = np.zeros((len(models), 24))
        for k in range(24):
            blind = [b for b in range(draws) if weights[replica, k, 1 + b] == 0]
            counted.add(len(blind))
            if not blind:
                continue  # all draws have seen it: it tells nothing
            for j, estimate in enumerate(estimates):
                predictions = []
                for b in blind:
                    total = 0.0
                    for t in range(7):
                        s, a, then = (int(part[replica, k, t]) for part in steps(windows))
                        total += float(estimate.draws[replica, b, t * 10 + then if axes == ARRIVALS else s * 3 + a])
                    predictions.append(total)
                errors[j, k] = np.mean(predictions) - float(windows.labels[replica, k])
        np.testing.assert_allclose(found[replica], np.eye(len(models)) + errors @ errors.T, atol=1e-9)
    assert {0, 1, 2} <= counted  # among them windows that every draw has seen


def steps(windows: Windows) -> tuple[torch.Tensor, ...]:
    return windows.states, windows.actions, windows.next_states


def test_before_the_first_window_all_weights_are_equal(make_problem: Make) -> None:
    problem = make_problem((0, 1))
    bootstrap = Bootstrap(3)
    bootstrap.start(problem)
    nothing = Estimate(problem.zeros(30), problem.zeros(3, 30))
    errors = bootstrap.label_errors([nothing] * 4, Dataset(problem, 0), torch.zeros(1, 0, 7, dtype=torch.int64))
    assert torch.equal(errors, torch.eye(4, dtype=FLOAT).repeat(2, 1, 1))
    torch.testing.assert_close(stacked_weights(errors), torch.full((2, 4), 0.25, dtype=FLOAT))


def test_an_uncertainty_without_resampling_holds_nothing_out(make_problem: Make) -> None:
    problem = make_problem((0,))
    with pytest.raises(NotImplementedError, match="Analytic holds no labels out"):
        Analytic().label_errors([], Dataset(problem, 0), torch.zeros(1, 0, 7))
