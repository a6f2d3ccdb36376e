"""Which part of a recovery gave a reward that is not finite: planners would turn it into a policy without a word."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from torch import Tensor

from credit.core.belief import Belief
from credit.core.errors import RunError


def require_finite(rewards: Tensor, belief: Belief, seeds: Sequence[int], at: Tensor | None = None) -> None:
    """Refuse rewards that are not finite, at places that count.

    Args:
        rewards: what an agent is to be given [R, N]. belief: what they were made of. seeds: one a replica. at: which
            places those are [R, N], where they are not all.

    Raises:
        RunError: one is not finite; with the part from which that came, its value, the seed and the place.
    """
    if math.isfinite(float(rewards.sum())):  # one number a refit; it may overflow, so that only a doubt comes of it
        return
    for part, values in (*_parts(belief), ("what the scaler makes of the mixed reward and the bonuses", rewards)):
        bad = values.isnan() if part.startswith("the MSE proxy") else ~values.isfinite()
        if belief.valid is not None:
            bad &= belief.valid
        if bad.any():
            replica, place = (int(i) for i in bad.nonzero()[0])
            value = float(values[replica, place])
            place = place if at is None else int(at[replica, place])
            where = f"row {place}" if belief.cells is None else f"cell {place} of ({', '.join(belief.cells.axes)})"
            raise RunError(
                f"{part} is {value} at {where} of seed {seeds[replica]}, and rewards must be "
                "finite; are its features, labels and settings finite?"
            )


def _parts(belief: Belief) -> Iterator[tuple[str, Tensor]]:
    """What rewards are made of, in the order in which it is made: what to call it, and its values [R, N]."""
    for place, name in enumerate(belief.models):
        yield f"the prediction of reward model {name!r}", belief.mean[:, place]
    for place, name in enumerate(belief.models):  # it may be infinite where nothing is known
        yield f"the MSE proxy of reward model {name!r}", belief.mse[:, place]
    yield "the mixed reward", belief.mixed
    for name, values in belief.bonus.items():
        yield f"the bonus {name!r}", values
