"""Regret (21), its area, policy error and rank correlation, by hand and against SciPy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.stats
import torch

from credit.agents.random import Random
from credit.core.belief import Belief
from credit.core.cells import PAIRS, Cells
from credit.core.policy import Policy, TablePolicy
from credit.core.problem import Problem
from credit.core.truth import ContinuingTruth
from credit.core.windows import Windows
from credit.judges.exact import AverageReward, policy_error, rank_correlation, trust_metrics


def tensor(values: Any) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


def of_two(make_problem: Callable[..., Problem], gain: float = 0.5, seeds: tuple[int, ...] = (0, 1)) -> AverageReward:
    reward = tensor([[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]])
    truth = ContinuingTruth(
        gain,
        torch.tensor([0, 1, 1]),
        tensor([0.5, 0.5, 0.0]),
        reward,
        lambda policies: gain * torch.ones(len(policies)),
    )
    return AverageReward(make_problem(seeds, states=3, actions=2, window=2), truth)


@pytest.fixture
def judge(make_problem: Callable[..., Problem]) -> AverageReward:
    """Two replicas of three states and two actions: g* = .5, π* = 0 1 1, occupied half, half and never."""
    return of_two(make_problem)


def update(judge: AverageReward, rewards: Any, labels: Any = None) -> None:
    """Count rewards [R, K, T] and labels [R, K]; without labels they are of a window that was cut short."""
    grid = tensor(rewards)
    steps = torch.zeros(grid.shape, dtype=torch.int64)
    complete = labels is not None
    windows = Windows.of_grid(steps, steps, steps, tensor(labels) if complete else grid[..., 0])
    judge.update(windows, grid.flatten(1), Random(), complete)


def test_regret_and_area_by_hand(judge: AverageReward) -> None:
    # Windows of 2 steps: regret a window is 1 − Σr. Replica 0: Σr = 0, 3, so regret 1, −2, cumulative 1, −1, area 0.
    # Replica 1: Σr = 1, .5: regret 0, .5, cumulative 0, .5, area .5.
    update(judge, [[[0, 0], [1, 2]], [[1, 0], [0.5, 0]]], [[7.0, 9.0], [1.0, 2.0]])
    values = judge.measure({}, None)
    assert values["regret/cumulative"].tolist() == [-1, 0.5]
    assert values["regret/auc"].tolist() == [0, 0.5]
    assert values["return/label"].tolist() == [8, 1.5]
    # Another window: regret 1 − 2 = −1 and 1 − 0 = 1: cumulative −2, 1.5; areas 0 − 2, .5 + 1.5.
    update(judge, [[[1, 1]], [[0, 0]]], [[3.0], [4.0]])
    values = judge.measure({}, None)
    assert values["regret/cumulative"].tolist() == [-2, 1.5]
    assert values["regret/auc"].tolist() == [-2, 2]
    assert values["return/label"].tolist() == [3, 4]  # since the last call


def test_a_window_cut_short_counts_in_the_regret_and_has_no_label(judge: AverageReward) -> None:
    update(judge, [[[0, 0]], [[1, 1]]], [[5.0], [6.0]])
    update(judge, [[[0.25]], [[0.75]]])
    values = judge.measure({}, None)
    assert values["regret/cumulative"].tolist() == [1.25, -1.25]
    assert values["return/label"].tolist() == [5, 6]


def test_windows_at_once_or_one_by_one_are_the_same(make_problem: Callable[..., Problem]) -> None:
    rewards = torch.rand(1, 20, 2, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    both = []
    for size in (20, 1):
        judge = of_two(make_problem, 0.3, (0,))
        for start in range(0, 20, size):
            part = rewards[:, start : start + size]
            update(judge, part.tolist(), part.sum(-1).tolist())
        both.append(judge.measure({}, None))
    for name in both[0]:
        torch.testing.assert_close(both[0][name], both[1][name])


class Drawing(Policy):
    """Probabilities of actions that are the same in every state, by step [T, A]; or none."""

    def __init__(self, chances: list[list[float]] | None) -> None:
        self.chances = chances

    def act(self, states: torch.Tensor, step: torch.Tensor) -> torch.Tensor:
        raise AssertionError("a judge that knows the truth does not act")

    def probabilities(self, states: torch.Tensor, step: int) -> torch.Tensor | None:
        return None if self.chances is None else tensor(self.chances[step]).expand(2, len(states), -1)


def test_policy_error_by_hand(judge: AverageReward) -> None:
    tables = ([[0, 0, 0], [0, 1, 1]], [[1, 1, 1], [1, 0, 0]])
    behaviour, greedy = (TablePolicy(torch.tensor(table), 2) for table in tables)
    values = judge.measure({"behaviour": behaviour, "greedy": greedy}, None)
    assert values["policy/error"].tolist() == pytest.approx([2 / 3, 0])
    assert values["policy/error_greedy"].tolist() == pytest.approx([1 / 3, 1])
    assert values["policy/error_occupancy"].tolist() == [0.5, 0]  # state 2 is never visited
    assert "policy/error_greedy" not in judge.measure({"behaviour": behaviour}, None)


def test_policies_by_step_and_policies_that_draw_are_judged(judge: AverageReward) -> None:
    # by step: all wrong but one in the first, all right in the second, so 1/3 on average; drawn: 1 − π(π*(s))
    by_step = TablePolicy(torch.tensor([[[0, 0, 0], [0, 1, 1]]] * 2), 2)
    assert judge.measure({"behaviour": by_step}, None)["policy/error"].tolist() == pytest.approx([1 / 3] * 2)
    drawing = Drawing([[0.25, 0.75], [1.0, 0.0]])
    # wrong with .75, .25, .25 in the first step and 0, 1, 1 in the second
    values = judge.measure({"behaviour": drawing}, None)
    assert values["policy/error"].tolist() == pytest.approx([(1.25 / 3 + 2 / 3) / 2] * 2)
    assert values["policy/error_occupancy"].tolist() == pytest.approx([0.5] * 2)
    silent = judge.measure({"behaviour": Drawing(None)}, None)
    assert silent["policy/error"].isnan().all()
    assert silent["regret/cumulative"].tolist() == [0, 0]


def test_policy_error_weights_sum() -> None:
    policy = torch.tensor([[0, 1, 2]])
    optimal = torch.tensor([0, 0, 0])
    assert policy_error(policy, optimal, tensor([0.2, 0.3, 0.5])).tolist() == [0.8]


def test_reward_metrics_by_hand(judge: AverageReward) -> None:
    # truth 0..5; replica 0 is off by 1 at one of six pairs, replica 1 in reverse: Σ(2i − 5)² = 70 over 6
    mixed = tensor([[0, 1, 2, 3, 4, 6], [5, 4, 3, 2, 1, 0]])
    weights = torch.stack([torch.full((2, 6), 0.25), torch.full((2, 6), 0.75)], 1).double()
    best = torch.tensor([[0, 0, 0, 1, 1, 1], [1, 1, 1, 1, 1, 0]])
    cells = Cells(PAIRS, (3, 2))
    belief = Belief(("ridge", "linear"), mixed, (), mixed, mixed, weights, best, mixed, {}, mixed, mixed, cells)
    values = judge.measure({}, belief)
    assert values["reward/mse"].tolist() == pytest.approx([1 / 6, 70 / 6])
    assert values["reward/rank_correlation"].tolist() == pytest.approx([1, -1])
    assert values["weight/ridge"].tolist() == [0.25, 0.25]
    assert values["weight/linear"].tolist() == [0.75, 0.75]
    assert values["best/ridge"].tolist() == pytest.approx([1 / 2, 1 / 6])
    assert values["best/linear"].tolist() == pytest.approx([1 / 2, 5 / 6])


def test_trust_is_over_the_places_that_count() -> None:
    weights = tensor([[[0.2, 0.9, 0.7], [0.8, 0.1, 0.3]], [[0.2, 0.4, 0.9], [0.8, 0.6, 0.1]]])
    best, empty = torch.tensor([[1, 0, 0], [1, 1, 0]]), torch.zeros(2, 3)
    valid = torch.tensor([[True, False, False], [True, True, True]])
    parts = (("dnn", "box"), weights, (), weights, weights[:, :1], weights, best, empty, {}, empty)
    found = trust_metrics(Belief(*parts, valid=valid))
    expected = {"weight/dnn": [0.2, 0.5], "weight/box": [0.8, 0.5], "best/dnn": [0, 1 / 3], "best/box": [1, 2 / 3]}
    assert {name: found[name].tolist() for name in found} == {k: pytest.approx(v) for k, v in expected.items()}
    parts[5][0, :, 1:] = torch.nan  # what stands behind the last row means nothing
    assert trust_metrics(Belief(*parts, valid=valid))["weight/dnn"].tolist() == pytest.approx([0.2, 0.5])


def test_rank_correlation_against_scipy() -> None:
    rng = np.random.default_rng(0)
    first, second = rng.normal(size=(2, 5, 30))
    second = second + first * np.arange(5)[:, None]
    expected = [scipy.stats.spearmanr(a, b).statistic for a, b in zip(first, second, strict=True)]
    found = rank_correlation(torch.from_numpy(first), torch.from_numpy(second))
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_rank_correlation_shares_ranks_among_ties_as_scipy_does() -> None:
    # two disjoint spikes in 1,000 cells have nothing in common
    first, second = torch.zeros(2, 1000, dtype=torch.float64)
    first[3], second[700] = 1, 1
    assert rank_correlation(first, second).item() == pytest.approx(-1 / 999)
    rng = np.random.default_rng(1)
    few = rng.integers(0, 4, size=(2, 6, 200))
    expected = [scipy.stats.spearmanr(a, b).statistic for a, b in zip(*few, strict=True)]
    np.testing.assert_allclose(rank_correlation(*torch.from_numpy(few.astype(float))), expected, atol=1e-12)


def test_rank_correlation_does_not_depend_on_the_order_of_cells() -> None:
    rng = np.random.default_rng(2)
    first, second = torch.from_numpy(rng.integers(0, 3, size=(2, 50)).astype(float))
    order = torch.from_numpy(rng.permutation(50))
    torch.testing.assert_close(rank_correlation(first, second), rank_correlation(first[order], second[order]))


@pytest.mark.filterwarnings("error")
def test_rank_correlation_of_a_constant_is_not_defined() -> None:
    assert rank_correlation(tensor([[1, 1, 1]]), tensor([[1, 2, 3]])).isnan().all()
    assert rank_correlation(tensor([[1, 2, 3]]), tensor([[0, 0, 0]])).isnan().all()


def test_rank_correlation_with_an_unknown_truth_is_not_known() -> None:
    assert rank_correlation(tensor([[3, 1, 2]]), tensor([[torch.nan] * 3])).isnan().all()
