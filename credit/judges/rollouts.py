"""What a policy is worth by trial: how often it succeeds, in episodes that are never learned from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import torch
from torch import Tensor

from credit.core.belief import Belief
from credit.core.policy import Policy
from credit.core.problem import Problem
from credit.core.seams import Agent, Environment, Judge
from credit.core.store import Windows
from credit.judges.exact import trust_metrics

SUMMARY = ("auc", "final", "learned", "lost")
GOOD, BAD, LAST = 0.9, 0.6, 4  # a seed has learned at GOOD; below BAD it has lost it again; the end is LAST rounds


class Rollouts(Judge):
    """Success of each policy in episodes of its own: now, on average over the rounds, at the end, and lost again.

    Args:
        problem: sizes.
        env: where policies are evaluated.
    """

    metric: ClassVar = "eval/success"
    higher_is_better: ClassVar = True
    keeps: ClassVar = ("_labels", "_windows", "_rounds", "_collected", "_taken")

    def __init__(self, problem: Problem, env: Environment) -> None:
        self._env, self._taken = env, problem.zeros()
        self._labels, self._windows = problem.zeros(), 0
        self._rounds: dict[str, list[Tensor]] = {}  # success of each policy after each round
        self._collected = False

    def update(self, windows: Windows, primitive: Tensor, agent: Agent, complete: bool = True) -> None:
        """Count episodes and their steps."""
        self._taken = self._taken + windows.lengths.sum(1)
        if complete:
            self._labels, self._windows = self._labels + windows.labels.sum(1), self._windows + windows.labels.shape[1]
            self._collected = True

    def measure(self, policies: Mapping[str, Policy], belief: Belief | None) -> dict[str, Tensor]:
        """Metric → [R]; each call evaluates every policy anew. `return/label` is the mean since the last call."""
        unknown = torch.full_like(self._labels, torch.nan)
        values = {"collect/steps": self._taken.clone()}
        values["return/label"] = self._labels / self._windows if self._windows else unknown
        self._labels, self._windows = torch.zeros_like(self._labels), 0
        for name, policy in policies.items():
            after = "" if name == "behaviour" else f"_{name}"
            found = self._env.evaluate(name, policy)
            success, length = (part.to(self._labels).mean(1) for part in (found.success, found.lengths))
            values[f"eval/success{after}"], values[f"eval/length{after}"] = success, length
            rounds = self._rounds.setdefault(name, [])
            if self._collected:
                rounds.append(success)
            summary = of_rounds(torch.stack(rounds)) if rounds else dict.fromkeys(SUMMARY, unknown)
            values |= {f"eval/{what}{after}": value for what, value in summary.items()}
        return values if belief is None else values | trust_metrics(belief)


def of_rounds(success: Tensor) -> dict[str, Tensor]:
    """What the success rates [K, R] of K rounds come to, [R] each.

    `auc`: mean over the rounds. `final`: over the last four. `learned`: rounds after the first with .9. `lost`: how
    many of those are below .6.
    """
    reached = (success >= GOOD - 1e-9).cummax(0).values
    after = torch.cat([torch.zeros_like(reached[:1]), reached[:-1]])
    learned, lost = after.sum(0), (after & (success < BAD)).sum(0)
    columns = (success.mean(0), success[-LAST:].mean(0), learned.to(success.dtype), lost.to(success.dtype))
    return dict(zip(SUMMARY, columns, strict=True))
