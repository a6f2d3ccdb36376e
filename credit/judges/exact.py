"""What a learner is worth, judged by the truth it never saw. The README's glossary gives each equation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import ClassVar

import torch
from torch import Tensor

from credit.core.belief import Belief
from credit.core.cells import Cells
from credit.core.policy import Policy, tabulate
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Agent, Judge
from credit.core.store import Windows
from credit.core.truth import ContinuingTruth, EpisodicTruth


def policy_error(policy: Tensor, optimal: Tensor, weight: Tensor | None = None) -> Tensor:
    """Share of states [R] where a policy [R, S] differs from π* [S], each state weighted equally or by `weight` [S]."""
    wrong = (policy != optimal).to(FLOAT)
    return wrong.mean(-1) if weight is None else (wrong * weight).sum(-1)


def rank_correlation(first: Tensor, second: Tensor) -> Tensor:
    """Spearman's ρ over the last dimension, ties by order of index; nan where one side is constant or nan."""
    ranks = [_ranks(values) for values in (first, second)]
    a, b = (r - r.mean(-1, keepdim=True) for r in ranks)
    rho = (a * b).sum(-1) / (a.square().sum(-1) * b.square().sum(-1)).sqrt()
    unknown = [(x.amax(-1) == x.amin(-1)) | x.isnan().any(-1) for x in (first, second)]
    return rho.masked_fill(unknown[0] | unknown[1], torch.nan)


def _ranks(values: Tensor) -> Tensor:
    order = values.argsort(dim=-1, stable=True)
    places = torch.arange(values.shape[-1], dtype=FLOAT, device=values.device).expand(values.shape)
    return torch.zeros(values.shape, dtype=FLOAT, device=values.device).scatter_(-1, order, places)


def recovery_metrics(belief: Belief | None, truth: Callable[[Cells], Tensor]) -> dict[str, Tensor]:
    """How well the reward was recovered, and how far each model is trusted; nothing where nothing is recovered."""
    if belief is None or belief.cells is None:
        return {}
    true = truth(belief.cells)
    values = {
        "reward/mse": (belief.mixed - true).square().mean(-1),
        "reward/rank_correlation": rank_correlation(belief.mixed, true.expand_as(belief.mixed)),
    }
    return values | trust_metrics(belief)


def trust_metrics(belief: Belief) -> dict[str, Tensor]:
    """Mean weight of each model, and the share of places where it is locally best."""
    values = {}
    for index, name in enumerate(belief.models):
        values[f"weight/{name}"] = _mean(belief.weights[:, index], belief.valid)
        values[f"best/{name}"] = _mean((belief.best == index).to(FLOAT), belief.valid)
    return values


def _mean(values: Tensor, valid: Tensor | None) -> Tensor:
    """Means [R] of values [R, N] at the places that count."""
    return (
        values.mean(-1) if valid is None else torch.stack([v[own].mean() for v, own in zip(values, valid, strict=True)])
    )


class AverageReward(Judge):
    """Of a continuing tabular problem: regret against g* (21), policy error, reward error.

    Args:
        problem: sizes. truth: what is best.
    """

    metric: ClassVar = "regret/cumulative"
    higher_is_better: ClassVar = False
    keeps: ClassVar = ("_regret", "_area", "_labels", "_windows")

    def __init__(self, problem: Problem, truth: ContinuingTruth) -> None:
        self._problem, self._gain = problem, truth.gain
        self._policy, self._occupancy = truth.policy.to(problem.device), truth.occupancy.to(problem.device)
        self._reward = truth.reward.to(problem.device)
        self._regret = problem.zeros()
        self._area = problem.zeros()
        self._labels = problem.zeros()
        self._windows = 0

    def truth(self, cells: Cells) -> Tensor:
        """r(s, a), where the cells are pairs."""
        return cells.known(self._reward)

    def update(self, windows: Windows, primitive: Tensor, agent: Agent | None = None, complete: bool = True) -> None:
        """Count windows with rewards r [R, n]; one that was cut short has regret, and no label."""
        regret = windows.grid(self._gain - primitive).sum(-1)
        path = self._regret.unsqueeze(1) + regret.cumsum(1)
        self._regret = path[:, -1]
        self._area = self._area + path.sum(1)
        if complete:
            self._labels = self._labels + windows.labels.sum(1)
            self._windows += windows.labels.shape[1]

    def measure(self, policies: Mapping[str, Policy], belief: Belief | None) -> dict[str, Tensor]:
        """Metric → [R]. `return/label` is the mean label since the last call."""
        values = {
            "regret/cumulative": self._regret,
            "regret/auc": self._area,
            "return/label": self._labels / max(self._windows, 1),
        }
        self._labels, self._windows = torch.zeros_like(self._labels), 0
        for name, after in (("behaviour", ("", "_occupancy")), ("greedy", ("_greedy",))):
            table = _decided(policies.get(name), self._problem)
            if table is None:
                continue
            for ending in after:
                weight = self._occupancy if ending == "_occupancy" else None
                values[f"policy/error{ending}"] = policy_error(table, self._policy, weight)
        return values | recovery_metrics(belief, self.truth)


class FiniteHorizon(Judge):
    """Of an episodic problem: regret of the executed policies, evaluated exactly under the start distribution.

    Args:
        problem: sizes. truth: values for the objective that the labels show.
    """

    metric: ClassVar = "regret/cumulative"
    higher_is_better: ClassVar = False
    keeps: ClassVar = ("_value", "_regret", "_area", "_labels", "_windows", "_all")

    def __init__(self, problem: Problem, truth: EpisodicTruth) -> None:
        self._problem, self._known = problem, truth
        self._value = problem.zeros()
        self._regret = problem.zeros()
        self._area = problem.zeros()
        self._labels = problem.zeros()
        self._windows = 0
        self._all = 0

    def truth(self, cells: Cells) -> Tensor:
        """r(s, a) or r(s'), by step where the cells are; a label that shows the last reward alone has no other."""
        return self._known.reward(cells).to(self._problem.device)

    def update(self, windows: Windows, primitive: Tensor, agent: Agent, complete: bool = True) -> None:
        """Count episodes under the policy that was executed; one cut short has no regret."""
        if not complete:
            return
        labels = windows.labels
        self._value = self._evaluate(agent.executed())
        count, gap = labels.shape[1], self._known.best - self._value
        self._area = self._area + count * self._regret + gap * (count * (count + 1) / 2)
        self._regret = self._regret + count * gap
        self._labels = self._labels + labels.sum(1)
        self._windows += count
        self._all += count

    def measure(self, policies: Mapping[str, Policy], belief: Belief | None) -> dict[str, Tensor]:
        """Metric → [R]. `return/label` is the mean label since the last call."""
        values = {
            "regret/cumulative": self._regret,
            "regret/share": self._regret / (max(self._all, 1) * (self._known.best - self._known.random)),
            "regret/auc": self._area,
            "return/policy": self._value,
            "return/label": self._labels / max(self._windows, 1),
        }
        self._labels, self._windows = torch.zeros_like(self._labels), 0
        if "greedy" in policies:
            values["return/greedy"] = self._evaluate(policies["greedy"])
        return values | recovery_metrics(belief, self.truth)

    def _evaluate(self, policy: Policy) -> Tensor:
        table = tabulate(policy, self._problem)
        assert table is not None, f"{type(policy).__name__} cannot be judged exactly: it gives no probabilities"
        if table.dim() == 2:
            table = table.unsqueeze(1).expand(-1, self._problem.window, -1)
        return self._known.evaluate(table).to(self._value.device)


def _decided(policy: Policy | None, problem: Problem) -> Tensor | None:
    """The action [R, S] of a policy that decides for one at every state; None where it draws."""
    if policy is None:
        return None
    table = tabulate(policy, problem)
    if table is not None and table.dim() == 4:
        sure, table = table[:, 0].max(-1)
        return table if bool((sure == 1).all()) else None
    return table
