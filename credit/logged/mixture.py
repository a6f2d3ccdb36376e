"""The paper's mixture on rows of a table: proxies, weights and disagreement (9)–(18), and the mixture of every draw.

A draw b of the mixture is what a mixture of its own fits would be: with its own gap, (r̂₀ᵇ − r̂_jᵇ)², about which draws of
its own would spread as those of the fits do, so that Δ̂²_j of draw b is that square plus the variance of the gap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from credit.logged.panel import Floats

if TYPE_CHECKING:
    from credit.core.seams import Mixer

CACHED = 2_000_000  # numbers that are looked at together


@dataclass(frozen=True)
class Mixed:
    """What is believed of n rows.

    Attributes:
        credit: r̃ of the point fit [n]. deviation: its standard deviation over the draws [n]; 0 without draws.
        each: r̂ of each model [M, n]. weights: [M, n], they sum to one. disagreement: the signal (18) [n].
        draws: of r̃ [B, n], where they were asked for.
    """

    credit: Floats
    deviation: Floats
    each: Floats
    weights: Floats
    disagreement: Floats
    draws: Floats | None = None


def mixed(designs: Sequence[Floats], thetas: Sequence[Floats], mixer: Mixer, keep: bool = False) -> Mixed:
    """Mix the models' predictions of rows, a few rows at a time.

    Args:
        designs: φ of each model [n, d]. thetas: its coefficients, the point fit first [1 + B, d]. mixer: of proxies.
        keep: whether all draws of the mixture are returned.
    """
    count, draws = len(designs[0]), len(thetas[0]) - 1
    at_once = max(1, CACHED // ((1 + draws) * len(designs)))
    parts = [
        _mixed(
            [design[first : first + at_once] @ theta.T for design, theta in zip(designs, thetas, strict=True)], mixer
        )
        for first in range(0, count, at_once)
    ]
    return Mixed(
        np.concatenate([part.credit for part in parts]),
        np.concatenate([part.deviation for part in parts]),
        np.concatenate([part.each for part in parts], axis=1),
        np.concatenate([part.weights for part in parts], axis=1),
        np.concatenate([part.disagreement for part in parts]),
        np.concatenate([part.draws for part in parts if part.draws is not None], axis=1) if keep else None,
    )


def _mixed(predictions: Sequence[Floats], mixer: Mixer) -> Mixed:
    """Of predictions [n, 1 + B] of each model."""
    import torch

    from credit.recovery.bonuses import disagreement_signal
    from credit.recovery.mixers import best_model, mix

    if len(predictions) == 1:
        own = predictions[0]
        deviation = own[:, 1:].std(1) if own.shape[1] > 1 else np.zeros(len(own))
        return Mixed(own[:, 0], deviation, own[None, :, 0], np.ones((1, len(own))), deviation, own[:, 1:].T)
    every = torch.from_numpy(np.stack(predictions))  # [M, n, 1 + B]
    point, others = every[..., 0], every[..., 1:]
    if not others.shape[-1]:
        others = every
    variance = others.var(-1, correction=0)
    gaps = others[:1] - others[1:]
    between = gaps.square().mean(-1)
    mse = torch.cat([variance[:1], variance[1:] + between])
    weights = mixer.weights(mse)
    credit = mix(weights, point)
    # Var of a gap, which its mean square holds, is what draws of a draw would add to the square of its own
    own = variance.unsqueeze(-1).repeat(1, 1, others.shape[-1])
    own[1:] += gaps.square() + gaps.var(-1, correction=0).unsqueeze(-1)
    draws = mix(mixer.weights(own.flatten(1)), others.flatten(1)).view(others.shape[1:])
    signal = disagreement_signal(mse, between, best_model(mse))
    return Mixed(
        credit.numpy(),
        draws.std(-1, correction=0).numpy(),
        point.numpy(),
        weights.numpy(),
        signal.numpy(),
        draws.T.numpy(),
    )
