"""What a learner is worth, judged by the truth it never saw. The README's glossary gives each equation."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import torch
from torch import Tensor

from credit.cells import Cells
from credit.interfaces import Optimizer
from credit.stateful import Stateful
from credit.types import FLOAT, Belief, Problem, Recovery


def policy_error(policy: Tensor, optimal: Tensor, weight: Tensor | None = None) -> Tensor:
    """Share of states [R] where a policy [R, S] differs from π* [S], each state weighted equally or by `weight` [S]."""
    wrong = (policy != optimal).to(FLOAT)
    return wrong.mean(-1) if weight is None else (wrong * weight).sum(-1)


def rank_correlation(first: Tensor, second: Tensor) -> Tensor:
    """Spearman's ρ over the last dimension, as `scipy.stats.spearmanr`; nan where one side is constant or nan.

    Args:
        first: [..., n]. second: [..., n], in any units; their leading dimensions are broadcast.

    Returns:
        [...] Pearson's correlation of the ranks, where ties share the mean of theirs.
    """
    a, b = (ranks - ranks.mean(-1, keepdim=True) for ranks in (_ranks(first), _ranks(second)))
    return (a * b).sum(-1) / (a.square().sum(-1) * b.square().sum(-1)).sqrt()  # 0/0 is nan: a constant


def _ranks(values: Tensor) -> Tensor:
    """Ranks from 0, ties at the mean of theirs; nan throughout where a value is nan."""
    # `scipy.stats.rankdata` less 1, on the values' device and without its import of half a second
    ordered, order = values.sort(-1)
    place = torch.arange(values.shape[-1], dtype=FLOAT, device=values.device).expand(values.shape)
    starts = torch.ones_like(ordered, dtype=torch.bool)
    starts[..., 1:] = ordered[..., 1:] != ordered[..., :-1]
    ends = starts.roll(-1, -1)  # the first place starts a tie, and so the last one ends one
    first = place.masked_fill(~starts, -torch.inf).cummax(-1).values
    last = place.masked_fill(~ends, torch.inf).flip(-1).cummin(-1).values.flip(-1)
    ranks = torch.empty_like(place, memory_format=torch.contiguous_format).scatter_(-1, order, (first + last) / 2)
    return ranks.masked_fill(values.isnan().any(-1, keepdim=True), torch.nan)


def recovery_metrics(recovery: Belief | None, truth: Callable[[Cells], Tensor]) -> dict[str, Tensor]:
    """How well the reward was recovered, and how far each model is trusted; nothing where nothing is recovered."""
    if not isinstance(recovery, Recovery):
        return {}
    true = truth(recovery.cells)
    values = {
        "reward/mse": (recovery.mixed - true).square().mean(-1),
        "reward/rank_correlation": rank_correlation(recovery.mixed, true),
    }
    return values | trust_metrics(recovery)


def trust_metrics(recovery: Belief) -> dict[str, Tensor]:
    """Mean weight of each model, and the share of places where it is locally best."""
    values = {}
    for index, name in enumerate(recovery.models):
        values[f"weight/{name}"] = recovery.weights[:, index].mean(-1)
        values[f"best/{name}"] = (recovery.best == index).to(FLOAT).mean(-1)
    return values


class AverageRewardOracle(Stateful):
    """Metrics of a continuing tabular problem: regret against g* (21), policy error, reward error.

    Args:
        problem: sizes. gain: g*. policy: π* [S]. occupancy: its stationary distribution [S]. reward: r [S, A].
    """

    keeps: ClassVar = ("_regret", "_area", "_labels", "_windows")

    def __init__(self, problem: Problem, gain: float, policy: Tensor, occupancy: Tensor, reward: Tensor) -> None:
        self._gain = gain
        self._policy, self._occupancy = policy.to(problem.device), occupancy.to(problem.device)
        self._reward = reward.to(problem.device)
        self._regret = problem.zeros()
        self._area = problem.zeros()
        self._labels = problem.zeros()
        self._windows = 0

    def truth(self, cells: Cells) -> Tensor:
        """r(s, a), where the cells are pairs."""
        return cells.known(self._reward)

    def update(self, primitive: Tensor, labels: Tensor | None, optimizer: Optimizer | None = None) -> None:
        """Count windows with rewards r [R, K, T] and labels [R, K] (None for a window that was cut short)."""
        regret = (self._gain - primitive).sum(-1)
        path = self._regret.unsqueeze(1) + regret.cumsum(1)
        self._regret = path[:, -1]
        self._area = self._area + path.sum(1)
        if labels is not None:
            self._labels = self._labels + labels.sum(1)
            self._windows += labels.shape[1]

    def metrics(self, policies: dict[str, Tensor], recovery: Belief | None) -> dict[str, Tensor]:
        """Metric → [R]. `return/label` is the mean label since the last call."""
        values = {
            "regret/cumulative": self._regret,
            "regret/auc": self._area,
            "return/label": self._labels / max(self._windows, 1),
        }
        self._labels, self._windows = torch.zeros_like(self._labels), 0
        if "behaviour" in policies:
            values["policy/error"] = policy_error(policies["behaviour"], self._policy)
            values["policy/error_occupancy"] = policy_error(policies["behaviour"], self._policy, self._occupancy)
        if "greedy" in policies:
            values["policy/error_greedy"] = policy_error(policies["greedy"], self._policy)
        return values | recovery_metrics(recovery, self.truth)


class EpisodicOracle(Stateful):
    """Metrics of an episodic problem: regret of the executed policies, evaluated exactly under the start distribution.

    Args:
        problem: sizes. best: V*. random: V of uniform actions. truth: cells → the reward [N] that the label shows.
        evaluate: policies [R, T, S] or [R, T, S, A] → their values [R], for the objective that the label shows.
    """

    keeps: ClassVar = ("_value", "_regret", "_area", "_labels", "_windows", "_all")

    def __init__(
        self,
        problem: Problem,
        best: float,
        random: float,
        truth: Callable[[Cells], Tensor],
        evaluate: Callable[[Tensor], Tensor],
    ) -> None:
        self._best, self._random, self._evaluate = best, random, evaluate
        self._truth, self._device = truth, problem.device
        self._value = problem.zeros()
        self._regret = problem.zeros()
        self._area = problem.zeros()
        self._labels = problem.zeros()
        self._windows = 0
        self._all = 0

    def truth(self, cells: Cells) -> Tensor:
        """r(s, a) or r(s'), by step where the cells are; a label that shows the last reward alone has no other."""
        return self._truth(cells).to(self._device)

    def update(self, primitive: Tensor, labels: Tensor | None, optimizer: Optimizer) -> None:
        """Count episodes with labels [R, K] under the policy that was executed; one cut short has no regret."""
        if labels is None:
            return
        self._value = self._evaluate(optimizer.executed()).to(labels.device)
        count, gap = labels.shape[1], self._best - self._value
        self._area = self._area + count * self._regret + gap * (count * (count + 1) / 2)
        self._regret = self._regret + count * gap
        self._labels = self._labels + labels.sum(1)
        self._windows += count
        self._all += count

    def metrics(self, policies: dict[str, Tensor], recovery: Belief | None) -> dict[str, Tensor]:
        """Metric → [R]. `return/label` is the mean label since the last call."""
        values = {
            "regret/cumulative": self._regret,
            "regret/share": self._regret / (max(self._all, 1) * (self._best - self._random)),
            "regret/auc": self._area,
            "return/policy": self._value,
            "return/label": self._labels / max(self._windows, 1),
        }
        self._labels, self._windows = torch.zeros_like(self._labels), 0
        if "greedy" in policies:
            values["return/greedy"] = self._evaluate(policies["greedy"]).to(self._value.device)
        return values | recovery_metrics(recovery, self.truth)
