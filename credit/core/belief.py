"""What is believed about the reward: the predictions of one model, and what a recovery makes of several."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from credit.core.cells import Cells


@dataclass(frozen=True)
class Estimate:
    """What one reward model predicts: mean [R, N] from all data, draws [R, B, N] whose spread is its variance."""

    mean: Tensor
    draws: Tensor


@dataclass(frozen=True)
class Belief:
    """What the learner believes about the reward of N places, equations (9)–(19), reference first among the models.

    Attributes:
        models: M names. mean: [R, M, N] fitted r̂_j. draws: [R, B, N] of each model. mse: [R, M, N] proxies (10), (11).
        disagreement: [R, M−1, N] Δ̂² of each surrogate (9). weights: [R, M, N] (14).
        best: [R, N] index of the locally best model (16). mixed: [R, N] (15).
        bonus: name → [R, N]. plan: [R, N] mixed + bonuses (17), (19).
        valid: which places count [R, N], where the N are steps and replicas have different numbers; None for all.
    """

    models: tuple[str, ...]
    mean: Tensor
    draws: tuple[Tensor, ...]
    mse: Tensor
    disagreement: Tensor
    weights: Tensor
    best: Tensor
    mixed: Tensor
    bonus: dict[str, Tensor]
    plan: Tensor
    valid: Tensor | None = None


@dataclass(frozen=True)
class Recovery(Belief):
    """What is believed of a table of rewards.

    Attributes:
        visits: [R, N] counts N(s, a). cells: what the N are.
        column: where the draws have each cell [R, N], if only some that stand for all are kept.
    """

    visits: Tensor = None  # type: ignore[assignment] - a dataclass wants defaults behind a default
    cells: Cells = None  # type: ignore[assignment]
    column: Tensor | None = None
