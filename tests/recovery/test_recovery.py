"""Equations (9)–(19) put together, with two models whose predictions are given."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

from credit.bench import naive
from credit.core.dataset import Dataset
from credit.core.errors import UserError
from credit.core.tables import CellModel
from credit.core.types import Estimate, Problem, Windows
from credit.recovery.bonuses import Count, Disagreement, LocalMSE
from credit.recovery.features.tabular import Bilinear, Identity, Threshold
from credit.recovery.mixers import RelativeMSE
from credit.recovery.models.linear import LinearModel
from credit.recovery.recovery import RewardRecovery
from credit.recovery.uncertainty.bootstrap import Bootstrap

Make = Callable[..., Problem]
MakeWindows = Callable[..., Windows]


def tensor(values: Any) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


class Fixed(CellModel):
    """Predicts what it is told, whatever it sees."""

    def __init__(self, name: str, mean: list[float], draws: list[list[float]]) -> None:
        self.name = name
        self._estimate = Estimate(tensor([mean]), tensor([draws]))

    def start(self, problem: Problem, draws: int) -> None: ...

    def observe(self, windows: Windows, weights: torch.Tensor) -> None: ...

    def refit(self, windows: Windows, weights: torch.Tensor) -> None: ...

    def estimate(self, cells: torch.Tensor | None = None) -> Estimate:
        return self._estimate


def recover(problem: Problem, bonus: Any, **bootstrap: Any) -> RewardRecovery:
    """One state, two actions; three visits to action 0."""
    reference = Fixed("ridge", [2.5, 1.0], [[1.0, 0.0], [3.0, 2.0]])
    surrogate = Fixed("linear", [1.5, 3.0], [[2.0, 0.0], [2.0, 1.0]])
    recovery = RewardRecovery(
        reference, {"linear": surrogate}, Bootstrap(2, **bootstrap), RelativeMSE(alpha=0.5), bonus
    )
    recovery.start(problem)
    dataset = Dataset(problem, 1)
    dataset.append(Windows(*(torch.zeros(1, 1, 3, dtype=torch.int64) for _ in range(3)), tensor([[1.0]])))
    recovery.observe(dataset)
    return recovery


def test_every_equation_by_hand(make_problem: Make) -> None:
    problem = make_problem((0,), states=1, actions=2, window=3)
    both = {"count": Count(0.35, 1.0), "local_mse": LocalMSE(1.0, 1.0), "disagreement": Disagreement(1.0, 1.0)}
    found = recover(problem, both).recovery()
    # Pair 0: reference draws 1, 3: variance 1. Surrogate draws 2, 2: variance 0, Δ̂² = (1 + 1)/2 = 1, MSE 0 + 1 = 1.
    # Pair 1: reference draws 0, 2: variance 1. Surrogate draws 0, 1: variance .25, Δ̂² = (0 + 1)/2, MSE .25 + .5 = .75.
    torch.testing.assert_close(found.disagreement, tensor([[[1.0, 0.5]]]))
    torch.testing.assert_close(found.mse, tensor([[[1.0, 1.0], [1.0, 0.75]]]))
    # Pair 0 is a tie, which the reference wins (16), and the weights are equal. Pair 1: the surrogate is best;
    # scale (1 + .75)/2 = .875, δ = .25/.875 = 2/7, exponent (2/7)/.5 = 4/7.
    assert found.best.tolist() == [[0, 1]]
    weight = math.exp(-4 / 7) / (1 + math.exp(-4 / 7))
    torch.testing.assert_close(found.weights, tensor([[[0.5, weight], [0.5, 1 - weight]]]))
    mixed = [0.5 * 2.5 + 0.5 * 1.5, weight * 1.0 + (1 - weight) * 3.0]
    torch.testing.assert_close(found.mixed, tensor([mixed]))
    # N = (3, 0), λ = 1: decay 1/2, 1
    assert found.visits.tolist() == [[3, 0]]
    torch.testing.assert_close(found.bonus["count"], tensor([[0.175, 0.35]]))
    torch.testing.assert_close(found.bonus["local_mse"], tensor([[1 / 2, math.sqrt(0.75)]]))
    torch.testing.assert_close(found.bonus["disagreement"], tensor([[1 / 2, math.sqrt(0.5)]]))
    plan = [mixed[0] + 0.175 + 0.5 + 0.5, mixed[1] + 0.35 + math.sqrt(0.75) + math.sqrt(0.5)]
    torch.testing.assert_close(found.plan, tensor([plan]))
    assert found.models == ("ridge", "linear")


def test_without_bonuses_the_plan_is_the_mixed_reward(make_problem: Make) -> None:
    found = recover(make_problem((0,), states=1, actions=2, window=3), {}).recovery()
    assert torch.equal(found.plan, found.mixed)
    assert found.bonus == {}


def test_the_prior_variance_is_the_references_alone(make_problem: Make) -> None:
    problem = make_problem((0,), states=1, actions=2, window=3)
    plain = recover(problem, {}).recovery()
    prior = recover(problem, {}, prior_variance=0.5, prior_count=1.0).recovery()
    torch.testing.assert_close(prior.mse[:, 0] - plain.mse[:, 0], tensor([[0.5 / 4, 0.5]]))
    assert torch.equal(prior.mse[:, 1], plain.mse[:, 1])


def test_rewards_are_the_plan_at_every_step(make_problem: Make) -> None:
    problem = make_problem((0,), states=1, actions=2, window=3)
    recovery = recover(problem, {"count": Count()})
    zeros = torch.zeros(1, 1, 3, dtype=torch.int64)
    rewards = recovery.rewards(Windows(zeros, torch.tensor([[[1, 0, 1]]]), zeros, tensor([[0.0]])))
    plan = recovery.recovery().plan[0].tolist()
    assert rewards.tolist() == [[[plan[1], plan[0], plan[1]]]]


def test_models_of_one_name_are_refused() -> None:
    twice = [Fixed("ridge", [0.0], [[0.0]]) for _ in range(2)]
    with pytest.raises(UserError, match=r"different names.*'ridge'.*'ridge'"):
        RewardRecovery(twice[0], {"other": twice[1]}, Bootstrap(1), RelativeMSE(), {})


def full(draws: int, **bootstrap: Any) -> RewardRecovery:
    return RewardRecovery(
        LinearModel("ridge", Identity(), 0.1),
        {"linear": LinearModel("linear", Bilinear(), 0.1), "threshold": LinearModel("threshold", Threshold(), 0.1)},
        Bootstrap(draws, **bootstrap),
        RelativeMSE(0.5),
        {"count": Count(), "disagreement": Disagreement()},
    )


def test_before_any_window_all_is_zero_but_the_count_bonus(make_problem: Make) -> None:
    recovery = full(4)
    recovery.start(make_problem((0, 1)))
    found = recovery.recovery()
    assert (found.mse == 0).all()
    assert (found.best == 0).all()
    torch.testing.assert_close(found.weights, torch.full_like(found.weights, 1 / 3))
    torch.testing.assert_close(found.plan, torch.full_like(found.plan, 0.35))


def test_a_recovery_stays_as_it_was(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0,))
    recovery, dataset = full(3), Dataset(problem, 2)
    recovery.start(problem)
    before = recovery.recovery()
    dataset.append(make_windows(problem, 2))
    recovery.observe(dataset)
    assert (before.visits == 0).all()
    assert (before.mixed == 0).all()


def test_visits_count_every_step_once(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0, 1))
    recovery, dataset = full(2), Dataset(problem, 2)
    recovery.start(problem)
    for seed in range(3):
        dataset.append(make_windows(problem, 2, seed=seed))
        recovery.observe(dataset)
    pairs = dataset.windows.pairs(3).flatten(1)
    expected = torch.stack([row.bincount(minlength=30) for row in pairs]).double()
    assert torch.equal(recovery.recovery().visits, expected)
    assert expected.sum() == 2 * 6 * 7


def test_fits_and_weights_equal_the_second_implementation(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0,))
    recovery, dataset = full(20), Dataset(problem, 2)
    recovery.start(problem)
    dataset.append(make_windows(problem, 60, seed=5))
    recovery.observe(dataset)
    found, windows = recovery.recovery(), dataset.windows
    states, actions, labels = (part[0].numpy() for part in (windows.states, windows.actions, windows.labels))
    fitted, _, _ = naive.proxies(states, actions, labels, 1, np.random.default_rng(0))
    for index, name in enumerate(found.models):
        np.testing.assert_allclose(found.mean[0, index].view(10, 3), fitted[name], atol=1e-9)
    weights = naive.weights({name: found.mse[0, j].numpy() for j, name in enumerate(found.models)})
    np.testing.assert_allclose(found.weights[0], np.stack(list(weights.values())), atol=1e-12)


@pytest.mark.parametrize("resample", ["poisson", "exact"])
def test_proxies_agree_with_the_second_implementation(
    make_problem: Make, make_windows: MakeWindows, resample: str
) -> None:
    # 1,000 draws each: a ratio of variances has a standard error of √(4/1000) = 6.3% a pair. Poisson weights scatter a
    # little more, by O(1/K), K = 400. The 30 pairs share draws, so their median ratio is allowed the error of one pair.
    problem = make_problem((0,))
    recovery, dataset = full(1000, resample=resample), Dataset(problem, 2)
    recovery.start(problem)
    dataset.append(make_windows(problem, 400, seed=6))
    recovery.observe(dataset)
    found, windows = recovery.recovery(), dataset.windows
    states, actions, labels = (part[0].numpy() for part in (windows.states, windows.actions, windows.labels))
    _, mse, gaps = naive.proxies(states, actions, labels, 1000, np.random.default_rng(1), cache=True)
    for index, name in enumerate(found.models):
        ratio = found.mse[0, index].view(10, 3).numpy() / mse[name]
        assert abs(np.median(ratio) - 1) < 0.13, (name, np.median(ratio))
        assert abs(ratio - 1).max() < 0.4
        if index:
            ratio = found.disagreement[0, index - 1].view(10, 3).numpy() / gaps[name]
            assert abs(np.median(ratio) - 1) < 0.13, (name, np.median(ratio))
