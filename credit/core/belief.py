"""What is believed about the reward: the predictions of one model, and what a recovery makes of several."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from credit.core.cells import Cells


@dataclass(frozen=True)
class Estimate:
    """What one reward model predicts of N places.

    Attributes:
        mean: r̂ [R, N], from all data. variance: Var̂ r̂ [R, N].
        draws: B predictions [R, B, N] whose spread the variance is, where there are some.
        intercepts: of these draws [R, B], where sums of rewards are log-odds of a label but for them.
    """

    mean: Tensor
    variance: Tensor
    draws: Tensor | None = None
    intercepts: Tensor | None = None


@dataclass(frozen=True)
class Belief:
    """What is believed about the reward of N places, equations (9)–(19), reference first among the models.

    Places are the cells of a table, or the steps that were taken, or steps to look at.

    Attributes:
        models: M names. mean: [R, M, N] fitted r̂_j. draws: [R, B, N] of each model, or None.
        mse: [R, M, N] proxies (10), (11). disagreement: [R, M−1, N] Δ̂² of each surrogate (9). weights: [R, M, N] (14).
        best: [R, N] index of the locally best model (16). mixed: [R, N] (15).
        bonus: name → [R, N]. plan: [R, N] mixed + bonuses, in units of reward: what an agent is given, unless a scaler
            scales the mixed part for it.
        visits: counts N(s, a) [R, N]. cells: what the N are; both where they are the cells of a table.
        column: where the draws have each cell [R, N], if only some that stand for all are kept.
        valid: which places count [R, N], where replicas have different numbers of them; None for all.
    """

    models: tuple[str, ...]
    mean: Tensor
    draws: tuple[Tensor | None, ...]
    mse: Tensor
    disagreement: Tensor
    weights: Tensor
    best: Tensor
    mixed: Tensor
    bonus: dict[str, Tensor]
    plan: Tensor
    visits: Tensor | None = None
    cells: Cells | None = None
    column: Tensor | None = None
    valid: Tensor | None = None
