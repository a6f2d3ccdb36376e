"""Equations (7), (9), (10): bootstrap and analytic uncertainty."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch import Tensor

from credit.core.belief import Estimate
from credit.core.problem import FLOAT, Problem
from credit.core.store import Store, Windows
from credit.recovery.features.tabular import Bilinear, Identity, Threshold
from credit.recovery.models.linear import LinearModel
from credit.recovery.proxies import gap, mse_proxies, spread
from credit.recovery.uncertainty.bootstrap import Analytic, Bootstrap, FitUncertainty, Weights, deviation

from ..fits import Experience, part

Make = Callable[..., Problem]
MakeWindows = Callable[..., Windows]


def tensor(values: Any) -> Tensor:
    return torch.tensor(values, dtype=FLOAT)


def estimate(mean: list[float], draws: list[list[float]]) -> Estimate:
    return Estimate(tensor([mean]), tensor([[0.0] * len(mean)]), tensor([draws]))


def shown(bootstrap: Bootstrap, problem: Problem, *pieces: Windows) -> list[Weights]:
    """The weights of every round."""
    store, found = Store(problem), []
    bootstrap.start(problem)
    for piece in pieces:
        store.append(piece)
        found.append(bootstrap.weights(store))
        assert bootstrap.weights(store).values is found[-1].values  # for every model that asks
    return found


def unused() -> Tensor:
    raise NotImplementedError


def test_variance_by_hand() -> None:
    # draws 1, 3, 5: mean 3, squares 4 + 0 + 4 = 8; over B = 3, or over B − 1 = 2
    draws = tensor([[[1.0], [3.0], [5.0]]])
    torch.testing.assert_close(Bootstrap(3).variance(draws, unused, unused), tensor([[8 / 3]]))
    torch.testing.assert_close(Bootstrap(3, ddof=1).variance(draws, unused, unused), tensor([[4.0]]))
    assert draws.flatten().tolist() == [1, 3, 5]  # left as it was
    with pytest.raises(ValueError, match=r"draws \[3, 1\]; they must be draws \[..., R, B, N\]"):
        spread(draws[0])


def test_disagreement_is_the_mean_squared_gap_of_the_draws() -> None:
    # (9): ((1−2)² + (3−2)² + (5−3)²)/3 = 2, whatever the point fits are
    reference, surrogate = estimate([7.0], [[1.0], [3.0], [5.0]]), estimate([7.0], [[2.0], [2.0], [3.0]])
    torch.testing.assert_close(gap(reference, surrogate), tensor([[2.0]]))


@pytest.mark.parametrize("draws", [None, torch.zeros(1, 0, 1, dtype=FLOAT)])
def test_without_draws_disagreement_is_the_squared_gap_of_the_fits(draws: Tensor | None) -> None:
    # (7): (7 − 4)² = 9
    zero = tensor([[0.0]])
    torch.testing.assert_close(gap(Estimate(tensor([[7.0]]), zero, draws), Estimate(tensor([[4.0]]), zero)), zero + 9)


def test_draws_that_are_not_common_are_refused() -> None:
    one, two = estimate([7.0], [[1.0], [3.0]]), estimate([7.0], [[1.0]])
    with pytest.raises(ValueError, match=r"reference \[1, 2, 1\], surrogate \[1, 1, 1\]"):
        gap(one, two)
    with pytest.raises(ValueError, match=r"reference \[1, 1\], surrogate \[1, 2\]"):
        gap(one, estimate([7.0, 1.0], [[1.0, 0.0], [3.0, 0.0]]))


def test_proxies_by_hand() -> None:
    # (10): the reference's variance; (11): Var̂ + Δ̂² of each surrogate
    variance, gaps = tensor([[1.0, 2.0], [0.5, 0.25]]), tensor([[3.0, 4.0]])
    assert mse_proxies(variance, gaps).tolist() == [[1, 2], [3.5, 4.25]]
    with pytest.raises(ValueError, match=r"variance \[2, 2\], disagreement \[2, 2\]; .* disagreement \[..., M-1, N\]"):
        mse_proxies(variance, variance)


def test_prior_by_hand() -> None:
    # τ²n₀/(n₀ + N) = .5·2/(2 + (0, 2, 8)) = .5, .25, .1
    prior = Bootstrap(prior_variance=0.5, prior_count=2.0).prior(tensor([[0.0, 2.0, 8.0]]))
    torch.testing.assert_close(prior, tensor([[0.5, 0.25, 0.1]]))
    assert (Bootstrap().prior(tensor([[0.0, 2.0]])) == 0).all()


def test_poisson_shows_new_windows_once_and_exact_shows_all(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0, 1))
    windows = make_windows(problem, 3)
    online = shown(Bootstrap(5), problem, windows, windows)
    assert [(found.anew, found.values.shape) for found in online] == [(False, (2, 3, 6))] * 2
    assert not torch.equal(online[0].values, online[1].values)
    exact = shown(Bootstrap(5, resample="exact"), problem, windows, windows)
    assert [(found.anew, found.values.shape) for found in exact] == [(True, (2, 3, 6)), (True, (2, 6, 6))]


@pytest.mark.parametrize("resample", ["poisson", "exact"])
def test_weights(make_problem: Make, make_windows: MakeWindows, resample: Any) -> None:
    problem = make_problem((0, 1))
    ((weights, _),) = shown(Bootstrap(400, resample=resample), problem, make_windows(problem, 20))
    assert weights.shape == (2, 20, 401)
    assert (weights[..., 0] == 1).all()  # the point fit sees every window once
    draws = weights[..., 1:]
    assert torch.equal(draws, draws.round())
    assert not torch.equal(draws[0], draws[1])
    # 16,000 draws of mean 1 and variance at most 1: a standard error of .008
    assert abs(float(draws.mean()) - 1) < 0.04
    if resample == "exact":
        assert (draws.sum(1) == 20).all()
    else:  # a Poisson(1) number is 0 with probability 1/e; the standard error is .0038
        assert abs(float((draws == 0).double().mean()) - 0.36788) < 0.019


@pytest.mark.parametrize("resample", ["poisson", "exact"])
def test_weights_depend_on_the_seed_alone(make_problem: Make, make_windows: MakeWindows, resample: Any) -> None:
    def weights(seeds: tuple[int, ...]) -> Tensor:
        problem = make_problem(seeds)
        pieces = [make_windows(problem, 4)] * 3
        return torch.cat([found.values for found in shown(Bootstrap(6, resample=resample), problem, *pieces)], dim=1)

    batch = weights((5, 6, 7))
    assert torch.equal(batch[1], weights((6,))[0])
    assert torch.equal(batch, weights((5, 6, 7)))
    assert not torch.equal(batch[0], batch[1])


@pytest.mark.parametrize("resample", ["poisson", "exact"])
def test_models_see_the_same_weights_from_one_bootstrap_or_from_several(
    make_problem: Make, make_windows: MakeWindows, resample: Any
) -> None:
    # Δ̂² compares draw b of two models, which must have been fitted to the same resampled windows (9)
    problem = make_problem((0, 1))
    shared, own = Bootstrap(4, resample=resample), Bootstrap(4, resample=resample)
    models = [LinearModel(name, Bilinear(), one) for name, one in (("a", shared), ("b", shared), ("c", own))]
    experience = Experience(problem, *models)
    for seed in range(3):
        experience.see(make_windows(problem, 6, seed=seed))
    first, *others = (model.estimate() for model in models)
    for other in others:
        assert torch.equal(first.draws, other.draws)  # type: ignore[arg-type]
    assert first.variance.min() > 0


@pytest.mark.parametrize("resample", ["poisson", "exact"])
def test_a_round_without_windows_draws_none(make_problem: Make, make_windows: MakeWindows, resample: Any) -> None:
    problem = make_problem((0, 1))
    windows = make_windows(problem, 3)
    none = part(windows, slice(0))
    found = shown(Bootstrap(5, resample=resample), problem, none, windows, none, none, windows)
    sizes = [3, 3, 3, 6] if resample == "exact" else [3, 0, 0, 3]
    assert [weights.values.shape for weights in found] == [(2, 0, 6), *((2, size, 6) for size in sizes)]
    if resample == "poisson":  # nothing is drawn for nobody
        plain = shown(Bootstrap(5), problem, windows, windows)
        assert torch.equal(found[1].values, plain[0].values)
        assert torch.equal(found[4].values, plain[1].values)
    analytic = Analytic()
    analytic.start(problem)
    store = Store(problem)
    store.append(none)
    assert analytic.weights(store).values.shape == (2, 0, 1)


def test_poisson_and_exact_resampling_agree_in_the_limit(make_problem: Make, make_windows: MakeWindows) -> None:
    # 3,000 draws each: a variance has a relative standard error of √(2/3000) = 2.6%, a ratio of two 3.7%. With 500
    # windows the two schemes differ by O(1/500). 15% is four standard errors.
    problem = make_problem((0,))
    windows = make_windows(problem, 500, seed=7)
    variances, gaps = [], []
    for resample in ("poisson", "exact"):
        bootstrap = Bootstrap(3000, resample=resample)  # type: ignore[arg-type]
        models = LinearModel("cells", Threshold(), bootstrap), LinearModel("linear", Bilinear(), bootstrap)
        Experience(problem, *models).see(windows)
        cells, linear = (model.estimate() for model in models)
        assert cells.draws is not None
        variances.append(cells.variance)
        gaps.append(gap(cells, linear))
        # the draws scatter around the point fit: their mean is within five standard errors of it
        error = (cells.draws.mean(1) - cells.mean).abs() / (variances[-1] / 3000).sqrt()
        assert error.max() < 5
    ratio = variances[0] / variances[1]
    assert (ratio - 1).abs().max() < 0.15, ratio
    assert (gaps[0] / gaps[1] - 1).abs().max() < 0.15


def test_models_that_are_the_same_never_disagree(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0, 1))
    bootstrap = Bootstrap(8)
    models = [LinearModel(name, Identity(), bootstrap) for name in "ab"]
    Experience(problem, *models).see(make_windows(problem, 40))
    first, second = (model.estimate() for model in models)
    assert (gap(first, second) == 0).all()
    assert (first.variance > 0).all()


def test_analytic_variance_and_point_gap(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0, 1))
    windows = make_windows(problem, 25)
    analytic = Analytic(noise=0.3)
    ridge, linear = LinearModel("ridge", Identity(), analytic), LinearModel("linear", Bilinear(), analytic)
    Experience(problem, ridge, linear).see(windows)
    first, second = ridge.estimate(), linear.estimate()
    assert first.draws is not None
    assert first.draws.shape == (2, 0, 30)
    x = windows.sums(ridge.features(windows))[1]
    inverse = torch.linalg.inv(x.mT @ x + 0.1 * torch.eye(30))
    torch.testing.assert_close(first.variance[1], 0.09 * inverse.diagonal())
    torch.testing.assert_close(gap(first, second), (first.mean - second.mean) ** 2)
    assert analytic.prior(torch.ones(2, 30)) == 0


@pytest.mark.parametrize("pieces", [(25,), (1, 3, 25)], ids=["at once", "in pieces"])
def test_without_a_given_noise_it_is_that_of_the_labels(
    make_problem: Make, make_windows: MakeWindows, pieces: tuple[int, ...]
) -> None:
    problem = make_problem((0, 1))
    windows = make_windows(problem, 25)
    model = LinearModel("linear", Bilinear(), Analytic(None), 0.7)
    experience = Experience(problem, model)
    assert (model.estimate().variance == 0).all()
    for start, stop in zip((0, *pieces), pieces, strict=False):
        experience.see(part(windows, slice(start, stop)))
    phi = model.features(problem.cells.steps(problem.device))
    for replica in range(2):
        x, y = windows.sums(model.features(windows))[replica], windows.labels[replica]
        inverse = torch.linalg.inv(x.mT @ x + 0.7 * torch.eye(4))
        noise = (y - x @ inverse @ x.mT @ y).square().mean()
        expected = noise * ((phi @ inverse) * phi).sum(-1)
        torch.testing.assert_close(model.estimate().variance[replica], expected)


def test_the_deviation_of_labels_is_one_where_there_is_none() -> None:
    labels = tensor([[1.0, 3.0], [0.1, 0.1], [0.0, 0.0], [1e9, 1e9 + 1e-3]])
    assert deviation(labels).tolist() == [1, 1, 1, 1]
    assert deviation(10 * labels).tolist() == [10, 1, 1, 1]


def test_a_component_of_ones_own_need_not_hold_labels_out() -> None:
    class Mine(FitUncertainty):
        draws = 0

        def weights(self, store: Store) -> Weights:
            raise NotImplementedError

        def variance(self, draws: Tensor, leverage: Callable[[], Tensor], residual: Callable[[], Tensor]) -> Tensor:
            return leverage()

    assert Mine().prior(tensor([[1.0]])) == 0
    assert not Mine().sees_residuals
    with pytest.raises(NotImplementedError, match="Mine holds no labels out"):
        Mine().label_errors([], Store(Problem.finite(1, 1, 1, (0,))), None)
