"""Ridge on steps against the normal equations row by row."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from credit.core.errors import RunError, UserError
from credit.core.problem import Problem
from credit.core.seams import FeatureMap
from credit.core.steps import Steps
from credit.core.windows import Windows
from credit.recovery.features.motion import Motion
from credit.recovery.models.linear import LinearModel
from credit.recovery.uncertainty.bootstrap import Analytic

from ..fits import Experience, Given, first, poisson

MakeWalks = Callable[..., tuple[Problem, Windows]]


class Quarters(FeatureMap):
    """One-hot quarter of the square."""

    def start(self, problem: Problem) -> None:
        """Nothing."""

    def __call__(self, steps: Steps) -> Tensor:
        return torch.nn.functional.one_hot((steps.states > 0).long() @ torch.tensor([2, 1]), 4).float()


def box(features: FeatureMap, penalty: float = 1.0, unit: float = 1.0) -> LinearModel:
    return LinearModel("box", features, Analytic(None), penalty, unit=unit)


def rows_of(walks: Windows, replica: int) -> Iterator[tuple[int, int]]:
    """Number of the window and number of the row, of every row of a replica."""
    row = 0
    for number, length in enumerate(walks.lengths[replica].tolist()):
        for _ in range(length):
            yield number, row
            row += 1


def sums_of(walks: Windows, phi: Tensor, replica: int, unit: float) -> np.ndarray:
    """X [K, d], row by row."""
    x = np.zeros((walks.labels.shape[1], phi.shape[-1]))
    for number, row in rows_of(walks, replica):
        x[number] += phi[replica, row].double().numpy() / unit
    return x


@pytest.mark.parametrize("features", [Quarters(), Motion()])
@pytest.mark.parametrize("penalty", [0.1, 1.0])
@pytest.mark.parametrize("pieces", [(15,), (1, 2, 3, 15)], ids=["at once", "in pieces"])
def test_it_is_the_ridge_solution(
    make_walks: MakeWalks, features: FeatureMap, penalty: float, pieces: tuple[int, ...]
) -> None:
    problem, walks = make_walks((3, 4), 15)
    model = box(features, penalty, unit=5.0)
    experience = Experience(problem, model)
    for before, stop in zip((0, *pieces), pieces, strict=False):
        experience.see(later(walks, before, stop))
    estimate, phi = model.estimate(), features(walks)
    assert estimate.mean.dtype == estimate.variance.dtype == torch.float64
    size = phi.shape[-1]
    for replica in range(2):
        x, y = sums_of(walks, phi, replica, 5.0), walks.labels[replica].numpy()
        theta = np.linalg.solve(x.T @ x + penalty * np.eye(size), x.T @ y)
        residual = np.mean((y - x @ theta) ** 2)
        np.testing.assert_allclose(model.theta[replica], theta, atol=1e-10)
        for _, row in list(rows_of(walks, replica))[::17]:
            one = phi[replica, row].double().numpy() / 5
            spread = residual * one @ np.linalg.inv(x.T @ x + penalty * np.eye(size)) @ one
            assert estimate.mean[replica, row].item() == pytest.approx(one @ theta, abs=1e-9)
            assert estimate.variance[replica, row].item() == pytest.approx(spread, rel=1e-8)


def later(walks: Windows, start: int, stop: int) -> Windows:
    """Windows from the start-th to the stop-th of each replica."""
    assert walks.last is not None
    skip = walks.last[:, start - 1] + 1 if start else torch.zeros(len(walks.last), dtype=torch.int64)
    cut = first(walks, stop)
    assert cut.last is not None
    count = cut.last[:, -1] + 1 - skip
    most = int(count.max())

    def moved(column: Tensor | None) -> Tensor | None:
        if column is None:
            return None
        block = column.new_zeros(len(column), most, *column.shape[2:])
        for own, source, begin, rows in zip(block, column, skip.tolist(), count.tolist(), strict=True):
            own[:rows] = source[begin : begin + rows]
        return block

    names = ("states", "actions", "next_states", "step", "ended", "terminated")
    columns = {name: moved(getattr(cut, name)) for name in names}
    labels, last = cut.labels[:, start:], cut.last[:, start:] - skip.unsqueeze(1)
    return replace(cut, **columns, labels=labels, last=last, count=count)


def test_more_fits_than_one_are_weighted_ridge(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((3, 4), 15)
    weights = poisson(walks, 2)
    model = LinearModel("box", Motion(), Given(2), 0.3, unit=5.0)
    Experience(problem, model).see(walks, weights)
    estimate, phi = model.estimate(), model.features(walks)
    assert estimate.draws is not None
    for replica in range(2):
        x, y = sums_of(walks, phi, replica, 5.0), walks.labels[replica].numpy()
        rows = [row for _, row in rows_of(walks, replica)]
        for fit in range(3):
            w = weights[replica, :, fit].numpy()
            theta = np.linalg.solve((x.T * w) @ x + 0.3 * np.eye(3), (x.T * w) @ y)
            found = estimate.draws[replica, fit - 1] if fit else estimate.mean[replica]
            np.testing.assert_allclose(found[rows], phi[replica, rows].double() @ theta / 5, atol=1e-9)


def test_a_box_that_was_never_entered_has_no_reward_and_the_largest_variance(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((3,), 15)
    left = walks.states.clone()
    left[..., 0] = -left[..., 0].abs()
    model = box(Quarters())
    Experience(problem, model).see(replace(walks, states=left))
    places = torch.tensor([[-0.5, -0.5], [-0.5, 0.5], [0.5, -0.5]])
    found = model.believe(Steps(places, places[:, :1], places))
    assert found.mean[0, 2] == 0
    assert (found.mean[0, :2] != 0).all()
    assert found.variance[0, 2] > found.variance[0, :2].max()


def test_a_replica_is_fitted_alone_as_in_a_batch(make_walks: MakeWalks) -> None:
    seeds = (3, 8, 5)
    problem, walks = make_walks(seeds, 12)
    model = box(Motion())
    Experience(problem, model).see(walks)
    whole = model.estimate()
    for replica, seed in enumerate(seeds):
        alone_problem, alone_walks = make_walks((seed,), 12)
        Experience(alone_problem, model).see(alone_walks)
        alone, rows = model.estimate(), len(alone_walks)
        torch.testing.assert_close(whole.mean[replica, :rows], alone.mean[0])
        torch.testing.assert_close(whole.variance[replica, :rows], alone.variance[0])


def test_nothing_is_known_before_a_label(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((3,), 5)
    model = box(Quarters())
    Experience(problem, model).see(first(walks, 0))
    found = model.believe(Steps(walks.states[0], walks.actions[0], walks.next_states[0]))
    assert torch.equal(found.mean, torch.zeros(1, len(walks), dtype=torch.float64))
    assert torch.equal(found.variance, torch.zeros(1, len(walks), dtype=torch.float64))


def test_some_places_are_predicted_as_all_are(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((3, 4), 12)
    model = box(Motion())
    Experience(problem, model).see(walks)
    at = torch.tensor([[5, 5, 0], [17, 2, 90]])
    whole, some = model.estimate(), model.estimate(at)
    torch.testing.assert_close(some.mean, whole.mean.gather(1, at))
    torch.testing.assert_close(some.variance, whole.variance.gather(1, at))


def test_leverage_and_perturbation_of_steps(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((3,), 12)
    model = LinearModel("box", Motion(), Given(), 0.3, unit=5.0)
    Experience(problem, model).see(walks)
    x, phi = sums_of(walks, model.features(walks), 0, 5.0), model.features(walks)[0].double().numpy() / 5
    covariance = phi @ np.linalg.inv(x.T @ x + 0.3 * np.eye(3)) @ phi.T
    units = torch.eye(3, dtype=torch.float64)
    columns = torch.stack([model.perturbation(unit.expand(1, -1))[0] for unit in units], -1).numpy()
    np.testing.assert_allclose(model.leverage()[0], covariance.diagonal(), rtol=1e-8)
    np.testing.assert_allclose(columns @ columns.T, covariance, atol=1e-10)  # cov(ΦLz) = (ΦL)(ΦL)ᵀ
    some = Steps(walks.states[0, 5:9], walks.actions[0, 5:9], walks.next_states[0, 5:9])
    torch.testing.assert_close(model.leverage(some), model.leverage()[:, 5:9])
    torch.testing.assert_close(model.perturbation(units[:1], some), model.perturbation(units[:1])[:, 5:9])


def test_what_is_not_finite_is_refused_by_name(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((3, 8), 5)
    labels = walks.labels.clone()
    labels[1, 0] = torch.inf
    experience = Experience(problem, box(Quarters()))
    experience.store.append(replace(walks, labels=labels), checked=True)
    experience.places.extend(experience.store)
    with pytest.raises(RunError, match=r"'box'.*seed 8 is not finite after 5 windows"):
        experience.models[0].observe(experience.store)


def test_credit_to_the_last_step_needs_a_table(make_walks: MakeWalks) -> None:
    model = LinearModel("box", Quarters(), Given(), credit="last_step")
    with pytest.raises(UserError, match="'box': credit=last_step needs states and actions that are numbers"):
        Experience(make_walks((3,), 5)[0], model)


def test_an_uncertainty_that_needs_no_leverage_costs_none(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((0, 1), 4)
    model = LinearModel("box", Quarters(), Given(2))
    Experience(problem, model).see(walks, poisson(walks, 2))
    expected = model.estimate()
    del model._inverse  # which leverage is made of, and predictions are not
    for part in ("mean", "variance", "draws"):
        assert torch.equal(getattr(model.estimate(), part), getattr(expected, part))
