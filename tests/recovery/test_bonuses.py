"""Equations (17)–(19), (30)–(34), (38) of the bonuses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import torch

from credit.core.belief import Belief
from credit.core.cells import PAIRS, Cells
from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.store import Windows
from credit.recovery.bonuses import (
    Count,
    Disagreement,
    Elliptical,
    LocalMSE,
    Thompson,
    best_error,
    disagreement_signal,
    shrink,
)
from credit.recovery.features.tabular import Bilinear, Identity
from credit.recovery.mixers import best_model
from credit.recovery.models.linear import LinearModel

from .fits import Experience, Given


def tensor(values: Any) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


# Three models on three pairs. Best: the reference (.04), the linear one (.09), the threshold one (.01).
MSE = tensor([[[0.04, 0.25, 0.36], [0.05, 0.09, 0.16], [0.06, 0.10, 0.01]]])
CELLS = Cells(PAIRS, (3, 1))
GAPS = tensor([[[0.02, 0.0625, 0.15], [0.03, 0.09, 0.0049]]])
VISITS = tensor([[3.0, 0.0, 8.0]])  # with λ = 1 the decay is 1/2, 1, 1/3


@pytest.fixture
def belief() -> Belief:
    empty = torch.zeros_like(VISITS)
    return Belief(
        ("ridge", "linear", "threshold"), MSE, (), MSE, GAPS, MSE, best_model(MSE), empty, {}, empty, VISITS, CELLS
    )


@pytest.fixture
def of_rows(belief: Belief) -> Belief:
    """The same of steps, which nobody counts."""
    return replace(belief, visits=None, cells=None)


@pytest.fixture
def fitted(make_problem: Callable[..., Problem], make_windows: Callable[..., Any]) -> LinearModel:
    problem = make_problem((4, 5))
    model = LinearModel("ridge", Identity(), Given(), 0.3)
    Experience(problem, model).see(make_windows(problem, 50))
    return model


def test_decay_by_hand() -> None:
    torch.testing.assert_close(shrink(VISITS, 1.0), tensor([[1 / 2, 1, 1 / 3]]))
    torch.testing.assert_close(shrink(tensor([0.0]), 4.0), tensor([0.5]))


def test_count_bonus_by_hand(belief: Belief, fitted: LinearModel) -> None:
    expected = tensor([[0.35 / 2, 0.35, 0.35 / 3]])
    torch.testing.assert_close(Count(scale=0.35, lambda_visits=1.0)(belief, fitted), expected)


def test_error_of_the_best_model_by_hand() -> None:
    torch.testing.assert_close(best_error(MSE, best_model(MSE)), tensor([[0.2, 0.3, 0.1]]))


def test_local_mse_bonus_by_hand(belief: Belief, fitted: LinearModel) -> None:
    # (17): √.04/2, √.09/1, √.01/3, times c = 2
    torch.testing.assert_close(LocalMSE(scale=2.0)(belief, fitted), tensor([[0.2, 0.6, 0.2 / 3]]))


def test_local_mse_of_the_reference_alone_is_the_ridge_bonus(belief: Belief, fitted: LinearModel) -> None:
    # (30): c·√Var/√(λ + N) with λ = 1: .2/2, .5/1, .6/3
    mse = MSE[:, :1]
    alone = Belief(("ridge",), mse, (), mse, mse[:, :0], mse, best_model(mse), VISITS, {}, VISITS, VISITS, CELLS)
    torch.testing.assert_close(LocalMSE(scale=1.0)(alone, fitted), tensor([[0.1, 0.5, 0.2]]))
    torch.testing.assert_close(Disagreement(scale=1.0)(alone, fitted), tensor([[0.1, 0.5, 0.2]]))


def test_disagreement_signal_by_hand() -> None:
    # (18): the reference's √.04, then √Δ̂² of the best surrogate: √.0625 (linear), √.0049 (threshold)
    signal = disagreement_signal(MSE, GAPS, best_model(MSE))
    torch.testing.assert_close(signal, tensor([[0.2, 0.25, 0.07]]))


def test_disagreement_bonus_by_hand(belief: Belief, fitted: LinearModel) -> None:
    expected = tensor([[3 * 0.2 / 2, 3 * 0.25, 3 * 0.07 / 3]])
    torch.testing.assert_close(Disagreement(scale=3.0)(belief, fitted), expected)


def test_signals_take_any_leading_dimensions() -> None:
    mse, gaps = MSE.expand(2, 4, 3, 3), GAPS.expand(2, 4, 2, 3)
    best = best_model(mse)
    assert disagreement_signal(mse, gaps, best).shape == (2, 4, 3)
    torch.testing.assert_close(disagreement_signal(mse[0, 0], gaps[0, 0], best[0, 0]), tensor([0.2, 0.25, 0.07]))
    torch.testing.assert_close(best_error(mse, best)[1, 3], tensor([0.2, 0.3, 0.1]))


def test_without_lambda_bonuses_do_not_decay(belief: Belief, of_rows: Belief, fitted: LinearModel) -> None:
    # (33): c·√MSE of the best; (34): c·e; whatever the visits
    for found in (belief, of_rows):
        torch.testing.assert_close(LocalMSE(2.0, None)(found, fitted), tensor([[0.4, 0.6, 0.2]]))
        torch.testing.assert_close(Disagreement(3.0, None)(found, fitted), tensor([[0.6, 0.75, 0.21]]))


def test_shapes_that_do_not_fit_are_refused() -> None:
    best = best_model(MSE)
    with pytest.raises(ValueError, match=r"mse \[1, 3, 3\], best \[3\]"):
        best_error(MSE, best[0])
    with pytest.raises(ValueError, match=r"disagreement \[1, 3, 3\].* must be .* disagreement \[..., M-1, N\]"):
        disagreement_signal(MSE, MSE, best)


@pytest.mark.parametrize("kind", [Count, LocalMSE, Disagreement])
def test_where_no_visits_can_be_counted_a_bonus_cannot_decay_with_them(
    make_continuous: Callable[..., Problem], make_problem: Callable[..., Problem], kind: type[Count]
) -> None:
    problem = make_continuous()
    with pytest.raises(UserError, match=rf"{kind.__name__} with scale=0\.5 decays with visits.*set its scale to 0"):
        kind(0.5, 2.0).start(problem)
    kind(0.5, 2.0).start(make_problem())
    kind(0.0, 2.0).start(problem)
    if kind is not Count:
        kind(0.5, None).start(problem)


def test_a_count_bonus_of_scale_zero_adds_nothing(belief: Belief, of_rows: Belief, fitted: LinearModel) -> None:
    for found in (belief, of_rows):
        assert Count(0.0)(found, fitted).tolist() == [[0, 0, 0]]


def test_elliptical_bonus_is_the_width_of_the_confidence_set(belief: Belief, fitted: LinearModel) -> None:
    expected = 1.5 * 0.2 * fitted.leverage().sqrt()
    torch.testing.assert_close(Elliptical(scale=1.5, noise=0.2)(belief, fitted), expected)


def test_thompson_draws_a_reward_from_the_posterior(
    belief: Belief, make_problem: Callable[..., Problem], make_windows: Callable[..., Any]
) -> None:
    # 6,000 replicas of the same fit on 4 features: the covariance of the draws is v²·ΦV⁻¹Φᵀ. An entry's standard
    # error is √((c_ij² + c_ii·c_jj)/6000) ≤ 1.9% of √(c_ii·c_jj); 8% is over four of them.
    problem = make_problem(range(6000))
    alone = make_problem((0,))
    windows = make_windows(alone, 30)
    model = LinearModel("linear", Bilinear(), Given(), 0.5)
    columns = (windows.states, windows.actions, windows.next_states)
    many = Windows(*(x.expand(6000, -1) for x in columns), labels=windows.labels.expand(6000, -1), length=7)
    Experience(problem, model).see(many)
    bonus = Thompson(scale=0.7)
    bonus.start(problem)
    draws = bonus(belief, model)
    phi, x = model.features(alone.cells.steps(alone.device)), windows.sums(model.features(windows))[0]
    covariance = 0.49 * phi @ torch.linalg.inv(x.mT @ x + 0.5 * torch.eye(4)) @ phi.mT
    size = covariance.diagonal().sqrt()
    assert ((draws.T.cov() - covariance).abs() / (size.unsqueeze(0) * size.unsqueeze(1))).max() < 0.08
    assert (draws.mean(0).abs() / size).max() < 5 / 6000**0.5
    assert not torch.equal(bonus(belief, model), draws)


def test_thompson_draws_depend_on_the_seed_alone(belief: Belief, make_problem: Callable[..., Problem]) -> None:
    def draw(seeds: tuple[int, ...]) -> torch.Tensor:
        model, bonus = LinearModel("ridge", Identity(), Given()), Thompson()
        Experience(make_problem(seeds), model)
        bonus.start(make_problem(seeds))
        return bonus(belief, model)

    both = draw((8, 9))
    torch.testing.assert_close(both[1], draw((9,))[0], rtol=1e-12, atol=0)
    assert not torch.equal(both[0], both[1])
