"""What a learner is worth, judged by the truth it never saw. docs/metrics.md gives each equation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import torch
from torch import Tensor

from credit.core.belief import Belief
from credit.core.cells import Cells
from credit.core.errors import UserError
from credit.core.policy import Policy, tabulate
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Agent, Judge
from credit.core.truth import ContinuingTruth, EpisodicTruth
from credit.core.windows import Windows

TRUST = {"weight": "", "best": ""}  # which of `trust_metrics` are rates: all


def policy_error(policy: Tensor, optimal: Tensor, weight: Tensor | None = None) -> Tensor:
    """Share of states [R] where a policy differs from π* [S], each state weighted equally or by `weight` [S].

    Args:
        policy: actions [R, S] or [R, T, S], or probabilities [R, T, S, A]; the mean over the T steps of a window.
    """
    if policy.dim() == 4:
        wrong = 1 - policy.gather(-1, optimal.view(1, 1, -1, 1).expand(*policy.shape[:3], 1)).squeeze(-1)
    else:
        wrong = (policy != optimal).to(FLOAT)
    share = wrong.mean(-1) if weight is None else (wrong * weight).sum(-1)
    return share if share.dim() == 1 else share.mean(-1)


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


def trust_metrics(belief: Belief) -> dict[str, Tensor]:
    """Mean weight of each model, and the share of places where it is locally best; places that count alone."""
    values, valid = {}, belief.valid

    def mean(of: Tensor) -> Tensor:
        return of.mean(-1) if valid is None else of.where(valid, 0).sum(-1) / valid.sum(-1)

    for index, name in enumerate(belief.models):
        values[f"weight/{name}"] = mean(belief.weights[:, index])
        values[f"best/{name}"] = mean((belief.best == index).to(FLOAT))
    return values


def at_least_one(count: int | Tensor) -> int | Tensor:
    """What may be divided by."""
    return count.clamp(min=1) if isinstance(count, Tensor) else max(count, 1)


class _Exact(Judge):
    """What both kinds of exact judges do: labels, recovered rewards, trust."""

    higher_is_better: ClassVar = False
    rates: ClassVar = {"policy/error": "", **TRUST}

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self._labels = problem.zeros()
        self._windows: int | Tensor = 0

    def truth(self, cells: Cells) -> Tensor:
        """The true reward [N] of cells, NaN where they cannot express it."""
        raise NotImplementedError

    def _count(self, windows: Windows) -> None:
        self._labels = self._labels + windows.labels.sum(1)
        self._windows = self._windows + windows.known

    def _label(self) -> Tensor:
        """The mean label [R] since the last call."""
        mean = self._labels / at_least_one(self._windows)
        self._labels, self._windows = torch.zeros_like(self._labels), 0
        return mean

    def _believed(self, belief: Belief | None) -> dict[str, Tensor]:
        """How well the reward was recovered, where it is a table, and how far each model is trusted."""
        if belief is None:
            return {}
        values = {}
        if belief.cells is not None:
            true = self.truth(belief.cells)
            values["reward/mse"] = (belief.mixed - true).square().mean(-1)
            values["reward/rank_correlation"] = rank_correlation(belief.mixed, true)
        return values | trust_metrics(belief)


class AverageReward(_Exact):
    """Metrics of a continuing problem: regret against g* (21), policy error, reward error.

    Args:
        problem: sizes. truth: g*, π*, its occupancy, r.
    """

    metric: ClassVar = "regret/cumulative"
    keeps: ClassVar = ("_regret", "_area", "_labels", "_windows")

    def __init__(self, problem: Problem, truth: ContinuingTruth) -> None:
        super().__init__(problem)
        self._gain = truth.gain
        self._policy, self._occupancy = truth.policy.to(problem.device), truth.occupancy.to(problem.device)
        self._reward = truth.reward.to(problem.device)
        self._regret = problem.zeros()
        self._area = problem.zeros()

    def truth(self, cells: Cells) -> Tensor:
        """r(s, a), where the cells are pairs."""
        return cells.known(self._reward)

    def update(self, windows: Windows, primitive: Tensor, agent: Agent, complete: bool = True) -> None:
        """Count windows with rewards r [R, n]; one that was cut short has no label."""
        if windows.length is None:
            regret = self._gain * windows.lengths - windows.sums(primitive)
        else:
            regret = (self._gain - windows.grid(primitive)).sum(-1)
        path = self._regret.unsqueeze(1) + regret.cumsum(1)
        self._regret = path[:, -1]
        self._area = self._area + path.sum(1)
        if complete:
            self._count(windows)

    def measure(self, policies: Mapping[str, Policy], belief: Belief | None) -> dict[str, Tensor]:
        """Metric → [R]. `return/label` is the mean label since the last call; what a policy cannot say is NaN."""
        values = {"regret/cumulative": self._regret, "regret/auc": self._area, "return/label": self._label()}
        if "behaviour" in policies:
            behaviour = tabulate(policies["behaviour"], self._problem)
            values["policy/error"] = self._error(behaviour)
            values["policy/error_occupancy"] = self._error(behaviour, self._occupancy)
        if "greedy" in policies:
            values["policy/error_greedy"] = self._error(tabulate(policies["greedy"], self._problem))
        return values | self._believed(belief)

    def _error(self, policy: Tensor | None, weight: Tensor | None = None) -> Tensor:
        unknown = torch.full_like(self._regret, torch.nan)
        return unknown if policy is None else policy_error(policy, self._policy, weight)


class Episodic(_Exact):
    """Metrics of an episodic problem: regret of the executed policies, evaluated exactly under the start distribution.

    Args:
        problem: sizes. truth: V*, V of uniform actions, and how to evaluate, for the objective that the label shows.
    """

    metric: ClassVar = "regret/share"
    keeps: ClassVar = ("_value", "_regret", "_area", "_labels", "_windows", "_all")

    def __init__(self, problem: Problem, truth: EpisodicTruth) -> None:
        super().__init__(problem)
        self._truth = truth
        self._value = torch.full_like(problem.zeros(), torch.nan)  # before any policy was executed
        self._regret = problem.zeros()
        self._area = problem.zeros()
        self._all: int | Tensor = 0  # episodes

    def truth(self, cells: Cells) -> Tensor:
        """r(s, a) or r(s'), by step where the cells are; a label that shows the last reward alone has no other."""
        return self._truth.table(cells).to(self._problem.device)

    def update(self, windows: Windows, primitive: Tensor, agent: Agent, complete: bool = True) -> None:
        """Count episodes with labels [R, K] under the policy that was executed; one cut short has no regret."""
        if not complete:
            return
        self._value = self._worth(agent.executed())
        count, gap = windows.begun, self._truth.best - self._value
        self._area = self._area + count * self._regret + gap * (count * (count + 1) / 2)
        self._regret = self._regret + count * gap
        self._count(windows)
        self._all = self._all + count

    def measure(self, policies: Mapping[str, Policy], belief: Belief | None) -> dict[str, Tensor]:
        """Metric → [R]. `return/label` is the mean label since the last call."""
        values = {
            "regret/cumulative": self._regret,
            "regret/share": self._regret / (at_least_one(self._all) * (self._truth.best - self._truth.random)),
            "regret/auc": self._area,
            "return/policy": self._value,
            "return/label": self._label(),
        }
        if "greedy" in policies:
            values["return/greedy"] = self._worth(policies["greedy"])
        return values | self._believed(belief)

    def _worth(self, policy: Policy) -> Tensor:
        """V [R] of a policy.

        Raises:
            UserError: it does not say its probabilities.
        """
        table = tabulate(policy, self._problem)
        if table is None:
            raise UserError(
                f"{type(policy).__name__} does not say the probabilities of its actions, which exact regret needs; "
                "give it `probabilities`, or judge by rollouts"
            )
        if table.dim() == 2:  # the same in every step
            table = table.unsqueeze(1).expand(-1, self._problem.horizon, -1)
        return self._truth.evaluate(table).to(self._value.device)
