"""Equations (7), (9), (10): bootstrap and analytic uncertainty."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch

from credit.core.dataset import Dataset
from credit.core.tables import CellModel
from credit.core.types import Estimate, Problem, Windows
from credit.recovery.features.tabular import Bilinear, Identity, Threshold
from credit.recovery.models.linear import LinearModel
from credit.recovery.uncertainty.bootstrap import Analytic, Bootstrap

Make = Callable[..., Problem]
MakeWindows = Callable[..., Windows]


def tensor(values: Any) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


class Spy(CellModel):
    """Remembers the weights that it is shown."""

    def __init__(self) -> None:
        self.name = "spy"
        self.calls: list[tuple[str, torch.Tensor, torch.Tensor]] = []

    def start(self, problem: Problem, draws: int) -> None: ...

    def observe(self, windows: Windows, weights: torch.Tensor) -> None:
        self.calls.append(("observe", windows.labels, weights))

    def refit(self, windows: Windows, weights: torch.Tensor) -> None:
        self.calls.append(("refit", windows.labels, weights))

    def estimate(self, cells: torch.Tensor | None = None) -> Estimate:
        raise NotImplementedError


def shown(bootstrap: Bootstrap, problem: Problem, windows: Windows, rounds: int = 1, spies: int = 1) -> list[Spy]:
    dataset = Dataset(problem, 4)
    models = [Spy() for _ in range(spies)]
    bootstrap.start(problem)
    for _ in range(rounds):
        dataset.append(windows)
        bootstrap.observe(list(models), dataset)
    return models


def test_variance_by_hand() -> None:
    # draws 1, 3, 5: mean 3, squares 4 + 0 + 4 = 8; over B = 3, or over B − 1 = 2
    estimate = Estimate(tensor([[9.0]]), tensor([[[1.0], [3.0], [5.0]]]))
    torch.testing.assert_close(Bootstrap(3).variance(Spy(), estimate), tensor([[8 / 3]]))
    torch.testing.assert_close(Bootstrap(3, ddof=1).variance(Spy(), estimate), tensor([[4.0]]))
    assert estimate.draws.flatten().tolist() == [1, 3, 5]  # left as it was


def test_disagreement_is_the_mean_squared_gap_of_the_draws() -> None:
    # (9): ((1−2)² + (3−2)² + (5−3)²)/3 = 2, whatever the point fits are
    reference = Estimate(tensor([[7.0]]), tensor([[[1.0], [3.0], [5.0]]]))
    surrogate = Estimate(tensor([[7.0]]), tensor([[[2.0], [2.0], [3.0]]]))
    torch.testing.assert_close(Bootstrap(3).disagreement(reference, surrogate), tensor([[2.0]]))


def test_prior_by_hand() -> None:
    # τ²n₀/(n₀ + N) = .5·2/(2 + (0, 2, 8)) = .5, .25, .1
    prior = Bootstrap(prior_variance=0.5, prior_count=2.0).prior(tensor([[0.0, 2.0, 8.0]]))
    torch.testing.assert_close(prior, tensor([[0.5, 0.25, 0.1]]))
    assert (Bootstrap().prior(tensor([[0.0, 2.0]])) == 0).all()


def test_poisson_shows_new_windows_once_and_exact_shows_all(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0, 1))
    windows = make_windows(problem, 3)
    online = shown(Bootstrap(5), problem, windows, rounds=2)[0].calls
    assert [(name, labels.shape[1]) for name, labels, _ in online] == [("observe", 3), ("observe", 3)]
    exact = shown(Bootstrap(5, resample="exact"), problem, windows, rounds=2)[0].calls
    assert [(name, labels.shape[1]) for name, labels, _ in exact] == [("refit", 3), ("refit", 6)]


@pytest.mark.parametrize("resample", ["poisson", "exact"])
def test_weights(make_problem: Make, make_windows: MakeWindows, resample: Any) -> None:
    problem = make_problem((0, 1))
    first, second = shown(Bootstrap(400, resample=resample), problem, make_windows(problem, 20), spies=2)
    _, _, weights = first.calls[0]
    assert weights.shape == (2, 20, 401)
    assert (weights[..., 0] == 1).all()  # the point fit sees every window once
    draws = weights[..., 1:]
    assert torch.equal(draws, draws.round())
    assert torch.equal(weights, second.calls[0][2])  # the same for every model
    assert not torch.equal(draws[0], draws[1])
    # 16,000 draws of mean 1 and variance at most 1: a standard error of .008
    assert abs(float(draws.mean()) - 1) < 0.04
    if resample == "exact":
        assert (draws.sum(1) == 20).all()
    else:  # a Poisson(1) number is 0 with probability 1/e; the standard error is .0038
        assert abs(float((draws == 0).double().mean()) - 0.36788) < 0.019


@pytest.mark.parametrize("resample", ["poisson", "exact"])
def test_weights_depend_on_the_seed_alone(make_problem: Make, make_windows: MakeWindows, resample: Any) -> None:
    def weights(seeds: tuple[int, ...]) -> torch.Tensor:
        problem = make_problem(seeds)
        spy = shown(Bootstrap(6, resample=resample), problem, make_windows(problem, 4), rounds=3)[0]
        return torch.cat([w for _, _, w in spy.calls], dim=1)

    batch = weights((5, 6, 7))
    assert torch.equal(batch[1], weights((6,))[0])
    assert torch.equal(batch, weights((5, 6, 7)))
    assert not torch.equal(batch[0], batch[1])


def test_poisson_and_exact_resampling_agree_in_distribution(make_problem: Make, make_windows: MakeWindows) -> None:
    # 3,000 draws each: a variance has a relative standard error of √(2/3000) = 2.6%, a ratio of two 3.7%. With 500
    # windows the two schemes differ by O(1/500). 15% is four standard errors.
    problem = make_problem((0,))
    dataset = Dataset(problem, 500)
    dataset.append(make_windows(problem, 500, seed=7))
    variances, gaps = [], []
    for resample in ("poisson", "exact"):
        bootstrap = Bootstrap(3000, resample=resample)  # type: ignore[arg-type]
        bootstrap.start(problem)
        models: list[CellModel] = [LinearModel("cells", Threshold(), 0.1), LinearModel("linear", Bilinear(), 0.1)]
        for model in models:
            model.start(problem, 3000)
        bootstrap.observe(models, dataset)
        cells, linear = (model.estimate() for model in models)
        variances.append(bootstrap.variance(models[0], cells))
        gaps.append(bootstrap.disagreement(cells, linear))
        # the draws scatter around the point fit: their mean is within five standard errors of it
        error = (cells.draws.mean(1) - cells.mean).abs() / (variances[-1] / 3000).sqrt()
        assert error.max() < 5
    ratio = variances[0] / variances[1]
    assert (ratio - 1).abs().max() < 0.15, ratio
    assert (gaps[0] / gaps[1] - 1).abs().max() < 0.15


def test_models_that_are_the_same_never_disagree(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0, 1))
    dataset = Dataset(problem, 4)
    dataset.append(make_windows(problem, 40))
    models: list[CellModel] = [LinearModel("a", Identity(), 0.1), LinearModel("b", Identity(), 0.1)]
    bootstrap = Bootstrap(8)
    bootstrap.start(problem)
    for model in models:
        model.start(problem, 8)
    bootstrap.observe(models, dataset)
    first, second = (model.estimate() for model in models)
    assert (bootstrap.disagreement(first, second) == 0).all()
    assert (bootstrap.variance(models[0], first) > 0).all()


def test_analytic_variance_and_point_gap(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0, 1))
    dataset = Dataset(problem, 4)
    dataset.append(make_windows(problem, 25))
    analytic = Analytic(noise=0.3)
    analytic.start(problem)
    ridge, linear = LinearModel("ridge", Identity(), 0.1), LinearModel("linear", Bilinear(), 0.1)
    for model in (ridge, linear):
        model.start(problem, analytic.draws)
    analytic.observe([ridge, linear], dataset)
    first, second = ridge.estimate(), linear.estimate()
    assert first.draws.shape == (2, 0, 30)
    x = ridge.window_features(dataset.windows)[1]
    inverse = torch.linalg.inv(x.mT @ x + 0.1 * torch.eye(30))
    torch.testing.assert_close(analytic.variance(ridge, first)[1], 0.09 * inverse.diagonal())
    torch.testing.assert_close(analytic.disagreement(first, second), (first.mean - second.mean) ** 2)
    assert (analytic.prior(torch.ones(2, 30)) == 0).all()
