"""Equation (4) for thousands of pairs: conjugate gradient against the dense weighted ridge solution."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from credit.core.errors import RunError, UserError
from credit.core.problem import FLOAT, Problem
from credit.core.steps import Steps
from credit.core.windows import Episode, Windows
from credit.recovery.features.tabular import Identity
from credit.recovery.models import table
from credit.recovery.models.conjugate import Design
from credit.recovery.models.linear import LinearModel
from credit.recovery.models.table import TableModel
from credit.recovery.uncertainty.bootstrap import Analytic

from ..fits import Experience, Given, of_replica, part, poisson

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
    labels = torch.randn(shape[:2], dtype=FLOAT, generator=generator)
    return Windows.of_grid(states, actions, states, labels)


def counts(windows: Windows, replica: int) -> np.ndarray:
    """X of (3): how often each pair occurs in each window [K, N]."""
    index = windows.grid(windows.pairs(ACTIONS))[replica].numpy()
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
    assert estimate.draws is not None
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
    windows = windows_of(problem, 600)
    weights = poisson(windows, 3)
    assert counts(windows, 0).max() > 1  # a pair occurs twice in a window
    assert not counts(windows, 0).any(0).all()  # and some never
    model = TableModel(Given(3), regularization=penalty, tolerance=tolerance)
    experience = Experience(problem, model)
    for start, stop in ((0, 1), (1, 11), (11, 300), (300, 600)):  # past the room that is reserved at first
        experience.see(part(windows, slice(start, stop)), weights[:, start:stop])
        assert_solved(model, part(windows, slice(stop)), weights[:, :stop], error)
    estimate = model.estimate()
    assert estimate.mean.shape == (2, PAIRS)
    assert estimate.draws is not None
    assert estimate.draws.shape == (2, 3, PAIRS)


@pytest.mark.parametrize(("tolerance", "error"), [(1e-4, 1e-3), (1e-12, 1e-8)])
def test_fitting_anew_forgets(problem: Problem, tolerance: float, error: float) -> None:
    windows, more = windows_of(problem, 80), windows_of(problem, 10, seed=7)
    model = TableModel(Given(2), tolerance=tolerance)
    experience = Experience(problem, model).see(part(windows, slice(60)), poisson(part(windows, slice(60)), 2))
    again = poisson(windows, 2, seed=5)
    experience.anew(windows, again)
    assert_solved(model, windows, again, error)
    experience.see(more, poisson(more, 2, seed=8))  # and what came goes on counting
    assert_solved(model, experience.store.windows, torch.cat([again, poisson(more, 2, seed=8)], 1), error)


def test_fitting_labels_without_signal_anew(problem: Problem) -> None:
    # The residual of such a draw cannot be small relative to its target, which is 0.
    windows = windows_of(problem, 30)
    model = TableModel(Given(2), regularization=0.1)
    experience = Experience(problem, model).see(windows, poisson(windows, 2))
    weights = poisson(windows, 2, seed=3)
    weights[..., 2] = 0
    experience.anew(windows, weights)
    estimate = model.estimate()
    assert estimate.draws is not None
    assert torch.isfinite(estimate.mean).all()
    assert estimate.draws[:, 0].abs().max() > 0.01
    assert estimate.draws[:, 1].abs().max() < 1e-12
    experience.anew(replace(windows, labels=torch.zeros(2, 30, dtype=FLOAT)), weights)
    assert model.estimate().mean.abs().max() < 1e-12


def test_weights_of_zero_give_zero(problem: Problem) -> None:
    model = TableModel(Given(1))
    experience = Experience(problem, model)
    assert (model.estimate().mean == 0).all()
    experience.see(windows_of(problem, 20), torch.tensor([1.0, 0.0], dtype=FLOAT).expand(2, 20, 2))
    estimate = model.estimate()
    assert estimate.mean.abs().max() > 0
    assert (estimate.draws == 0).all()  # type: ignore[union-attr]
    Experience(problem, model)
    assert (model.estimate().mean == 0).all()


def test_one_window_by_hand(make_problem: Make) -> None:
    # Pairs 1, 1, 2 of S = 2, A = 2: x = (0, 2, 1, 0), Y = 3, λ = 1: θ = xY/(λ + xᵀx) = x·3/6 = (0, 1, .5, 0)
    problem = make_problem((0,), states=2, actions=2, window=3)
    states, actions = torch.tensor([[[0, 0, 1]]]), torch.tensor([[[1, 1, 0]]])
    model = TableModel(Given(), regularization=1.0, tolerance=1e-14)
    Experience(problem, model).see(Windows.of_grid(states, actions, states, torch.tensor([[3.0]], dtype=FLOAT)))
    assert model.estimate().mean.tolist() == [pytest.approx([0, 1, 0.5, 0], abs=1e-12)]
    assert model.estimate().draws.shape == (1, 0, 4)  # type: ignore[union-attr]


def test_some_cells_are_predicted_as_all_are(problem: Problem) -> None:
    windows = windows_of(problem, 50)
    model = TableModel(Given(2))
    Experience(problem, model).see(windows, poisson(windows, 2))
    at = torch.tensor([[3, 3, 239], [0, 7, 11]])
    whole, some = model.estimate(), model.estimate(at)
    assert torch.equal(some.mean, whole.mean.gather(1, at))
    torch.testing.assert_close(some.variance, whole.variance.gather(1, at))


def test_the_variance_of_other_steps_is_theirs(problem: Problem) -> None:
    model = TableModel(Analytic(0.3))
    Experience(problem, model).see(windows_of(problem, 50))
    order = torch.randperm(PAIRS, generator=torch.Generator().manual_seed(0))[:17]
    steps = Steps(order // ACTIONS, order % ACTIONS, order * 0, order * 0)
    torch.testing.assert_close(model.believe(steps).variance, model.estimate().variance[:, order])
    torch.testing.assert_close(model.believe(steps).mean, model.estimate().mean[:, order])
    torch.testing.assert_close(model.leverage(steps), model.leverage()[:, order])
    torch.testing.assert_close(model.estimate().variance, 0.09 * model.leverage())


def test_an_uncertainty_that_asks_for_residuals_is_refused(problem: Problem) -> None:
    with pytest.raises(UserError, match=r"'ridge': a table of many cells keeps no account of its residuals"):
        Experience(problem, TableModel(Analytic(None)))


@pytest.mark.parametrize("index", [0, 2])
def test_a_replica_is_fitted_alone_as_in_a_batch(make_problem: Make, index: int) -> None:
    sizes = {"states": STATES, "actions": ACTIONS, "window": WINDOW}
    together, alone = make_problem((4, 5, 6), **sizes), make_problem((4 + index,), **sizes)
    windows = windows_of(together, 300)
    weights = poisson(windows, 4)
    batch, single = TableModel(Given(4)), TableModel(Given(4))
    many, one = Experience(together, batch), Experience(alone, single)
    for rows in (slice(10), slice(10, 20), slice(20, 300)):
        many.see(part(windows, rows), weights[:, rows])
        one.see(of_replica(part(windows, rows), index), weights[index : index + 1, rows])
        assert single.estimate().draws is not None
        assert batch.estimate().draws is not None
        torch.testing.assert_close(single.estimate().mean[0], batch.estimate().mean[index])
        torch.testing.assert_close(single.estimate().draws[0], batch.estimate().draws[index])


class Gathering(Design):
    """A design as it is where there is no SciPy: on a GPU."""

    def __init__(self, index: torch.Tensor, columns: int, none: int | None = None) -> None:
        super().__init__(index, columns, none)
        self._sparse = None


def test_products_by_gather_and_scatter_equal_the_sparse_ones(problem: Problem) -> None:
    windows = windows_of(problem, 50)
    index, x = windows.grid(windows.pairs(ACTIONS))[0], torch.from_numpy(counts(windows, 0))
    generator = torch.Generator().manual_seed(3)
    inner, outer = torch.randn(PAIRS, 6, dtype=FLOAT, generator=generator), torch.randn(50, 6, dtype=FLOAT)
    for design in (Design(index, PAIRS), Gathering(index, PAIRS)):
        assert isinstance(design, Gathering) == (design._sparse is None)
        torch.testing.assert_close(design(inner), x @ inner, rtol=1e-12, atol=1e-12)
        torch.testing.assert_close(design.transposed(outer), x.T @ outer, rtol=1e-12, atol=1e-12)


def test_fits_by_gather_and_scatter_equal_the_dense_solution(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table, "Design", Gathering)
    windows = windows_of(problem, 60)
    weights = poisson(windows, 2)
    model = TableModel(Given(2), tolerance=1e-12)
    experience = Experience(problem, model)
    for rows in (slice(20), slice(20, 60)):
        experience.see(part(windows, rows), weights[:, rows])
    assert_solved(model, windows, weights, 1e-8)


def test_a_solve_ends_after_its_iterations(problem: Problem) -> None:
    windows = windows_of(problem, 200)
    weights = poisson(windows, 1)
    hasty, patient = (TableModel(Given(1), tolerance=1e-12, iterations=count) for count in (1, 200))
    Experience(problem, patient).see(windows, weights)
    experience = Experience(problem, hasty).see(windows, weights)
    assert (hasty.estimate().mean - patient.estimate().mean).abs().max() > 1e-4
    for _ in range(40):  # every solve goes on from the last solution
        experience.anew(windows, weights)
    np.testing.assert_allclose(hasty.estimate().mean, patient.estimate().mean, atol=1e-6)


@pytest.mark.parametrize("first", [True, False])
def test_a_round_without_windows_changes_nothing(problem: Problem, first: bool) -> None:
    windows, none = windows_of(problem, 30), part(windows_of(problem, 3), slice(0))
    model, other = TableModel(Given(1), tolerance=1e-12), TableModel(Given(1), tolerance=1e-12)
    experience = Experience(problem, model)
    for piece in (none, windows) if first else (windows, none):
        experience.see(piece, poisson(piece, 1))
    Experience(problem, other).see(windows, poisson(windows, 1))
    torch.testing.assert_close(model.estimate().mean, other.estimate().mean, atol=1e-9, rtol=0)
    assert model.estimate().mean.abs().max() > 0.01


def test_windows_that_may_end_early_are_refused(problem: Problem) -> None:
    timed = replace(problem, episodic=True)
    windows = Windows(*torch.zeros(3, 2, 3).long(), labels=torch.zeros(2, 1), last=torch.full((2, 1), 2))
    windows = replace(windows, step=torch.arange(3).expand(2, 3))
    for model in (
        TableModel(Given(1), credit="last_step"),
        LinearModel("last", Identity(), Given(1), credit="last_step"),
    ):
        with pytest.raises(RunError, match=r"needs windows that all have as many steps"):
            Experience(timed, model).see(windows)


@pytest.mark.parametrize("pieces", [(12,), (1, 4, 12)])
def test_windows_of_different_lengths(problem: Problem, pieces: tuple[int, ...]) -> None:
    """Against dense ridge on the steps that there were; a window without a label counts nothing."""
    grid, count = windows_of(problem, 12), 12
    lengths = torch.tensor([[5, 3, 1, 4, 5, 2, 2, 5, 1, 3, 4, 5], [1, 5, 5, 2, 4, 4, 3, 1, 5, 5, 2, 3]])
    labelled = torch.ones(2, count, dtype=torch.bool)
    labelled[0, 3] = labelled[1, 7] = False
    model = TableModel(Given(0), regularization=0.3, tolerance=1e-10)
    experience = Experience(problem, model)
    for before, stop in zip((0, *pieces), pieces, strict=False):
        own = [
            [
                Episode(
                    *(
                        column[r, k, : lengths[r, k]]
                        for column in map(grid.grid, (grid.states, grid.actions, grid.states))
                    )
                )
                for k in range(before, stop)
            ]
            for r in range(2)
        ]
        piece = Windows.of_episodes(own, grid.labels[:, before:stop])
        held = labelled[:, before:stop]
        experience.see(replace(piece, labelled=held), held.double().unsqueeze(-1))
    found = model.estimate().mean
    for replica in range(2):
        pairs = grid.grid(grid.pairs(ACTIONS))[replica]
        rows = [pairs[k, : lengths[replica, k]].numpy() for k in range(count)]
        x = np.stack([np.bincount(row, minlength=PAIRS) for row in rows]).astype(float)
        weight = labelled[replica].double().numpy()
        theta = np.linalg.solve((x.T * weight) @ x + 0.3 * np.eye(PAIRS), (x.T * weight) @ grid.labels[replica].numpy())
        np.testing.assert_allclose(found[replica].numpy(), theta, atol=1e-7)
    assert model.leverage().shape == (2, PAIRS)
