"""What a policy is worth in a maze: how often it reaches the goal, in episodes that are never learned from."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import torch
from torch import Tensor

from credit.core.cells import Cells
from credit.core.continuous import ContinuousProblem, StepBelief
from credit.core.interfaces import Act, Optimizer
from credit.core.state import Stateful
from credit.core.types import Belief
from credit.envs.pointmaze.rounds import Round
from credit.judges.exact import trust_metrics

SUMMARY = ("auc", "final", "learned", "lost")
GOOD, BAD, LAST = 0.9, 0.6, 4  # a seed has learned at GOOD; below BAD it has lost it again; the end is LAST rounds


class MazeOracle(Stateful):
    """Metrics of a maze: success of each policy, now, on average over the rounds, at the end, and lost again.

    Args:
        problem: sizes.
        evaluate: a policy's name and the policy → a round of episodes.
        taken: steps of each replica so far [R].
    """

    keeps: ClassVar = ("_labels", "_windows", "_rounds", "_collected")

    def __init__(
        self,
        problem: ContinuousProblem,
        evaluate: Callable[[str, Act], Round],
        taken: Callable[[], Tensor],
    ) -> None:
        self._problem, self._evaluate, self._taken = problem, evaluate, taken
        self._labels, self._windows = problem.zeros(), 0
        self._rounds: dict[str, list[Tensor]] = {}  # success of each policy after each round
        self._collected = False

    def truth(self, cells: Cells) -> Tensor:
        """There is no table of true rewards."""
        raise NotImplementedError

    def update(self, primitive: Tensor, labels: Tensor | None, optimizer: Optimizer) -> None:
        """Count trajectories with labels [R, K]."""
        if labels is not None:
            self._labels, self._windows = self._labels + labels.sum(1), self._windows + labels.shape[1]
            self._collected = True

    def metrics(self, policies: dict[str, Any], recovery: Belief | None) -> dict[str, Tensor]:
        """Metric → [R]; each call evaluates every policy anew. `return/label` is the mean since the last call."""
        unknown = torch.full_like(self._labels, torch.nan)
        values = {"collect/steps": self._taken().clone()}
        values["return/label"] = self._labels / self._windows if self._windows else unknown
        self._labels, self._windows = torch.zeros_like(self._labels), 0
        for name, policy in policies.items():
            after = "" if name == "behaviour" else f"_{name}"
            found = self._evaluate(name, policy)
            success, length = (part.to(self._labels).mean(1) for part in (found.success, found.lengths))
            values[f"eval/success{after}"], values[f"eval/length{after}"] = success, length
            rounds = self._rounds.setdefault(name, [])
            if self._collected:
                rounds.append(success)
            summary = of_rounds(torch.stack(rounds)) if rounds else dict.fromkeys(SUMMARY, unknown)
            values |= {f"eval/{what}{after}": value for what, value in summary.items()}
        if isinstance(recovery, StepBelief):
            each = [trust_metrics(recovery.of(replica)) for replica in range(self._problem.replicas)]
            values |= {name: torch.cat([one[name] for one in each]) for name in each[0]}
        return values


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
