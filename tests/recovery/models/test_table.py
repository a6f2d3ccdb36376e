"""Equation (4) for thousands of pairs: conjugate gradient against the dense weighted ridge solution."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from credit.core.types import FLOAT, Problem, Windows

from credit.recovery.models import table
from credit.recovery.models.table import Design, TableModel

Make = Callable[..., Problem]
STATES, ACTIONS, WINDOW, PAIRS = 60, 4, 5, 240


@pytest.fixture
def problem(make_problem: Make) -> Problem:
    return make_problem((0, 1), states=STATES, actions=ACTIONS, window=WINDOW)


def windows_of(problem: Problem, count: int, seed: int = 0) -> Windows:
    """Windows that prefer low states, so that pairs occur twice in a window and some pairs never."""
    generator = torch.Generator().manual_seed(seed)
    shape = (problem.replicas, count, problem.window)
    states = (torch.rand(shape, generator=generator) ** 6 * problem.states).long()
    actions = torch.randint(problem.actions, shape, generator=generator)
    return Windows(states, actions, states, torch.randn(shape[:2], dtype=FLOAT, generator=generator))


def poisson(problem: Problem, count: int, draws: int, seed: int = 1) -> torch.Tensor:
    """Weights [R, K, 1+B]; those of the point fit are 1."""
    ones = torch.ones(problem.replicas, count, 1 + draws, dtype=FLOAT)
    weights = torch.poisson(ones, generator=torch.Generator().manual_seed(seed))
    weights[..., 0] = 1
    return weights


def part(windows: Windows, rows: slice) -> Windows:
    pieces = (windows.states, windows.actions, windows.next_states, windows.labels)
    return Windows(*(piece[:, rows] for piece in pieces))


def counts(windows: Windows, replica: int) -> np.ndarray:
    """X of (3): how often each pair occurs in each window [K, N]."""
    index = (windows.states * ACTIONS + windows.actions)[replica].numpy()
    return np.stack([np.bincount(row, minlength=PAIRS) for row in index]).astype(float)


def ridge(x: np.ndarray, y: np.ndarray, weight: np.ndarray, penalty: float) -> np.ndarray:
    """The weighted normal equations (XᵀWX + λI) θ = XᵀWy on the visited pairs; 0 elsewhere."""
    visited, theta = x.any(0), np.zeros(x.shape[1])
    x = x[:, visited]
    theta[visited] = np.linalg.solve((x.T * weight) @ x + penalty * np.eye(x.shape[1]), (x.T * weight) @ y)
    return theta


def assert_solved(model: TableModel, windows: Windows, weights: torch.Tensor, error: float) -> None:
    """Every fit of every replica is the dense solution, up to a relative error of its norm, and 0 where unvisited.

    The residual is as small as the tolerance says; the error may be larger by the condition of XᵀWX + λI.
    """
    estimate = model.estimate()
    for replica in range(len(windows.labels)):
        x, y = counts(windows, replica), windows.labels[replica].numpy()
        fits = torch.cat([estimate.mean[replica : replica + 1], estimate.draws[replica]]).numpy()
        for fit, weight in zip(fits, weights[replica].T.numpy(), strict=True):
            expected, target = ridge(x, y, weight, model.regularization), (x.T * weight) @ y
            residual = target - (x.T * weight) @ (x @ fit) - model.regularization * fit
            norm = (x.T @ weight + model.regularization) ** -0.5  # that of the preconditioner
            assert np.linalg.norm(norm * residual) <= 1.01 * model.tolerance * np.linalg.norm(norm * target)
            assert np.linalg.norm(fit - expected) <= error * np.linalg.norm(expected)
            assert (fit[~x.any(0)] == 0).all()


@pytest.mark.parametrize(("tolerance", "error"), [(1e-4, 1e-3), (1e-12, 1e-8)])
@pytest.mark.parametrize("penalty", [10.0, 1.0])
def test_fits_equal_the_dense_solution(problem: Problem, penalty: float, tolerance: float, error: float) -> None:
    windows, weights = windows_of(problem, 600), poisson(problem, 600, 3)
    assert counts(windows, 0).max() > 1  # a pair occurs twice in a window
    assert not counts(windows, 0).any(0).all()  # and some never
    model = TableModel(regularization=penalty, tolerance=tolerance)
    model.start(problem, 3)
    for start, stop in ((0, 1), (1, 11), (11, 300), (300, 600)):  # past the room that is reserved at first
        model.observe(part(windows, slice(start, stop)), weights[:, start:stop])
        assert_solved(model, part(windows, slice(stop)), weights[:, :stop], error)
    estimate = model.estimate()
    assert estimate.mean.shape == (2, PAIRS)
    assert estimate.draws.shape == (2, 3, PAIRS)


@pytest.mark.parametrize(("tolerance", "error"), [(1e-4, 1e-3), (1e-12, 1e-8)])
def test_refit_forgets(problem: Problem, tolerance: float, error: float) -> None:
    windows = windows_of(problem, 80)
    model = TableModel(tolerance=tolerance)
    model.start(problem, 2)
    model.observe(part(windows, slice(60)), poisson(problem, 60, 2))
    again = poisson(problem, 80, 2, seed=5)
    model.refit(windows, again)
    assert_solved(model, windows, again, error)
    model.observe(windows_of(problem, 10, seed=7), poisson(problem, 10, 2, seed=8))  # and what came goes on counting
    both = [torch.cat(pair, 1) for pair in zip(_parts(windows), _parts(windows_of(problem, 10, seed=7)), strict=True)]
    assert_solved(model, Windows(*both), torch.cat([again, poisson(problem, 10, 2, seed=8)], 1), error)


def _parts(windows: Windows) -> tuple[torch.Tensor, ...]:
    return windows.states, windows.actions, windows.next_states, windows.labels


def test_refit_to_labels_without_signal(problem: Problem) -> None:
    # The residual of such a draw cannot be small relative to its target, which is 0.
    windows = windows_of(problem, 30)
    model = TableModel(regularization=0.1)
    model.start(problem, 2)
    model.observe(windows, poisson(problem, 30, 2))
    weights = poisson(problem, 30, 2, seed=3)
    weights[..., 2] = 0
    model.refit(windows, weights)
    estimate = model.estimate()
    assert torch.isfinite(estimate.mean).all()
    assert estimate.draws[:, 0].abs().max() > 0.01
    assert estimate.draws[:, 1].abs().max() < 1e-12
    model.refit(Windows(*_parts(windows)[:3], torch.zeros(2, 30, dtype=FLOAT)), weights)
    assert model.estimate().mean.abs().max() < 1e-12


def test_weights_of_zero_give_zero(problem: Problem) -> None:
    model = TableModel()
    model.start(problem, 1)
    assert (model.estimate().mean == 0).all()
    weights = torch.tensor([1.0, 0.0], dtype=FLOAT).expand(2, 20, 2)
    model.observe(windows_of(problem, 20), weights)
    estimate = model.estimate()
    assert estimate.mean.abs().max() > 0
    assert (estimate.draws == 0).all()
    model.start(problem, 1)
    assert (model.estimate().mean == 0).all()


def test_one_window_by_hand(make_problem: Make) -> None:
    # Pairs 1, 1, 2 of S = 2, A = 2: x = (0, 2, 1, 0), Y = 3, λ = 1: θ = xY/(λ + xᵀx) = x·3/6 = (0, 1, .5, 0)
    problem = make_problem((0,), states=2, actions=2, window=3)
    states, actions = torch.tensor([[[0, 0, 1]]]), torch.tensor([[[1, 1, 0]]])
    model = TableModel(regularization=1.0, tolerance=1e-14)
    model.start(problem, 0)
    model.observe(Windows(states, actions, states, torch.tensor([[3.0]], dtype=FLOAT)), torch.ones(1, 1, 1).double())
    assert model.estimate().mean.tolist() == [pytest.approx([0, 1, 0.5, 0], abs=1e-12)]
    assert model.estimate().draws.shape == (1, 0, 4)


@pytest.mark.parametrize("index", [0, 2])
def test_a_replica_is_fitted_alone_as_in_a_batch(make_problem: Make, index: int) -> None:
    sizes = {"states": STATES, "actions": ACTIONS, "window": WINDOW}
    together, alone = make_problem((4, 5, 6), **sizes), make_problem((4 + index,), **sizes)
    windows, weights = windows_of(together, 300), poisson(together, 300, 4)
    batch, single = TableModel(), TableModel()
    batch.start(together, 4)
    single.start(alone, 4)
    for rows in (slice(10), slice(10, 20), slice(20, 300)):
        batch.observe(part(windows, rows), weights[:, rows])
        mine = Windows(*(piece[index : index + 1] for piece in _parts(part(windows, rows))))
        single.observe(mine, weights[index : index + 1, rows])
        torch.testing.assert_close(single.estimate().mean[0], batch.estimate().mean[index])
        torch.testing.assert_close(single.estimate().draws[0], batch.estimate().draws[index])


class Gathering(Design):
    """A design as it is where there is no SciPy: on a GPU."""

    def __init__(self, index: torch.Tensor, columns: int) -> None:
        super().__init__(index, columns)
        self._sparse = None


def test_products_by_gather_and_scatter_equal_the_sparse_ones(problem: Problem) -> None:
    windows = windows_of(problem, 50)
    index, x = windows.pairs(ACTIONS)[0], torch.from_numpy(counts(windows, 0))
    generator = torch.Generator().manual_seed(3)
    inner, outer = torch.randn(PAIRS, 6, dtype=FLOAT, generator=generator), torch.randn(50, 6, dtype=FLOAT)
    for design in (Design(index, PAIRS), Gathering(index, PAIRS)):
        assert isinstance(design, Gathering) == (design._sparse is None)
        torch.testing.assert_close(design(inner), x @ inner, rtol=1e-12, atol=1e-12)
        torch.testing.assert_close(design.transposed(outer), x.T @ outer, rtol=1e-12, atol=1e-12)


def test_fits_by_gather_and_scatter_equal_the_dense_solution(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table, "Design", Gathering)
    windows, weights = windows_of(problem, 60), poisson(problem, 60, 2)
    model = TableModel(tolerance=1e-12)
    model.start(problem, 2)
    for rows in (slice(20), slice(20, 60)):
        model.observe(part(windows, rows), weights[:, rows])
    assert_solved(model, windows, weights, 1e-8)


def test_a_solve_ends_after_its_iterations(problem: Problem) -> None:
    windows, weights = windows_of(problem, 200), poisson(problem, 200, 1)
    hasty, patient = TableModel(tolerance=1e-12, iterations=1), TableModel(tolerance=1e-12)
    for model in (hasty, patient):
        model.start(problem, 1)
        model.observe(windows, weights)
    assert (hasty.estimate().mean - patient.estimate().mean).abs().max() > 1e-4
    for _ in range(40):  # every solve goes on from the last solution
        hasty.refit(windows, weights)
    np.testing.assert_allclose(hasty.estimate().mean, patient.estimate().mean, atol=1e-6)
