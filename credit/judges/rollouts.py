"""What a policy is worth where nobody knows P and r: what it gets in episodes that are never learned from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from credit.core.belief import Belief
from credit.core.policy import Policy
from credit.core.problem import Problem
from credit.core.seams import Agent, Evaluated, Evaluation, Judge
from credit.core.windows import Windows
from credit.judges.exact import TRUST, trust_metrics

RETURNS, SUCCESSES = ("auc", "final"), ("auc", "final", "learned", "lost")
GOOD, BAD, LAST = 0.9, 0.6, 4  # a seed has learned at GOOD; below BAD it has lost it again; the end is LAST rounds


class Rollouts(Judge):
    """Return, length and, where there is such a thing, success of each policy: now, over the rounds, at the end.

    Rounds are summed up by success where an episode may be one, else by return.

    Args:
        problem: sizes.
        evaluation: a policy → episodes of their own.
        success: whether a positive reward is a success, where the environment does not say which episodes are.
    """

    metric: ClassVar = "eval/auc"
    higher_is_better: ClassVar = True
    rates: ClassVar = {"eval/success": "", "eval/auc": "eval/success", "eval/final": "eval/success", **TRUST}
    keeps: ClassVar = ("_evaluation", "_labels", "_windows", "_taken", "_rounds", "_collected")

    def __init__(self, problem: Problem, evaluation: Evaluation, success: bool = False) -> None:
        self._problem, self._evaluation, self._success = problem, evaluation, success
        self._labels = problem.zeros()
        self._windows: int | Tensor = 0
        self._taken = problem.zeros()  # steps
        self._rounds: dict[str, list[Tensor]] = {}  # score of each policy after each round
        self._collected = False
        self._last: Evaluated | None = None

    def update(self, windows: Windows, primitive: Tensor, agent: Agent, complete: bool = True) -> None:
        """Count windows and their steps."""
        self._taken = self._taken + windows.lengths.sum(1)
        if complete:
            self._labels, self._windows = self._labels + windows.labels.sum(1), self._windows + windows.known
            self._collected = True

    def measure(self, policies: Mapping[str, Policy], belief: Belief | None) -> dict[str, Tensor]:
        """Metric → [R]; each call evaluates every policy anew. `return/label` is the mean since the last call."""
        unknown = torch.full_like(self._labels, torch.nan)
        values = {"collect/steps": self._taken}
        values["return/label"] = self._labels / self._windows
        self._labels, self._windows = torch.zeros_like(self._labels), 0
        for name, policy in policies.items():
            after = "" if name == "behaviour" else f"_{name}"
            found = self._evaluation(policy)
            if name == "behaviour":
                self._last = found
            reached, returns = self._reached(found), found.windows.labels.mean(1)
            values[f"eval/return{after}"] = returns
            values[f"eval/length{after}"] = found.windows.lengths.to(returns).mean(1)
            if reached is not None:
                values[f"eval/success{after}"] = reached.to(returns).mean(1)
            rounds = self._rounds.setdefault(name, [])
            if self._collected:
                rounds.append(values.get(f"eval/success{after}", returns))
            names = RETURNS if reached is None else SUCCESSES
            summary = of_rounds(torch.stack(rounds)) if rounds else dict.fromkeys(names, unknown)
            values |= {f"eval/{what}{after}": summary[what] for what in names}
        return values if belief is None else values | trust_metrics(belief)

    def picture(self, replica: int) -> dict[str, np.ndarray]:
        """The last evaluation of the behaviour policy.

        `evaluation/states` [n, O], episode after episode; `evaluation/lengths` and `evaluation/labels` [K] (success, or
        the return); and what else the environment said of each episode, like `evaluation/goals`.
        """
        if self._last is None:
            return {}
        windows, reached = self._last.windows, self._reached(self._last)
        lengths = windows.lengths[replica]
        labels = windows.labels if reached is None else reached.to(windows.labels)
        parts = {
            "states": windows.states[replica, : int(lengths.sum())],
            "lengths": lengths,
            "labels": labels[replica],
            **{name: values[replica] for name, values in self._last.facts.items() if name != "success"},
        }
        return {f"evaluation/{name}": values.cpu().numpy() for name, values in parts.items()}

    def _reached(self, found: Evaluated) -> Tensor | None:
        """Which episodes were a success [R, K], where there is such a thing."""
        if "success" in found.facts:
            return found.facts["success"]
        return found.windows.sums((found.primitive > 0).long()) > 0 if self._success else None


def of_rounds(score: Tensor) -> dict[str, Tensor]:
    """What the scores [K, R] of K rounds, success rates or returns, come to, [R] each.

    `auc`: mean over the rounds. `final`: over the last four. `learned`: rounds after the first with .9. `lost`: how
    many of those are below .6.
    """
    reached = (score >= GOOD - 1e-9).cummax(0).values
    after = torch.cat([torch.zeros_like(reached[:1]), reached[:-1]])
    learned, lost = after.sum(0), (after & (score < BAD)).sum(0)
    columns = (score.mean(0), score[-LAST:].mean(0), learned.to(score.dtype), lost.to(score.dtype))
    return dict(zip(SUCCESSES, columns, strict=True))
