"""RUDDER's watch repair (Arjona-Medina et al. 2019): whether a repair pays is known when the watch is delivered."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from credit.core.ranges import PositiveInt
from credit.envs.exact.outcomes import Outcome, OutcomeEnvironment

PRICE = (18.0, 28.0, 31.0, 59.0)  # of each brand, when it is sold
REPAIR = ((1.0, 2.0), (4.0, 2.0), (5.0, 2.0), (24.5, 1.0))  # mean and deviation of its costs
DELIVERY = ((0.5, 1.5), (2.5, 1.5), (4.5, 1.5), (18.0, 1.5))  # … when it is delivered
EVENTS = ((0.1, 0.1), (0.05, 7.0))  # of a traffic jam, of a flat tyre: probability in every step, cost


class WatchRepair(OutcomeEnvironment):
    """Watch repair: the first action decides whether a watch is repaired (0) or not (1); no other has an effect.

    A repair costs at once, then every traffic jam and flat tyre of the delivery does, and in the last step the watch is
    sold: price − brand's delivery cost. Without a repair nothing is gained or lost. In expectation a repair is worth
    price − repair − delivery − horizon·(.1·.1 + .05·7), with 50 steps −1.5, 3.5, 3.5, −1.5 of brands 0 … 3 (the first
    example of the paper, with the numbers of its authors' demonstration, whose "variances" are drawn with as standard
    deviations, as here). Otherwise here: a state shows the events of the last step, which cost when they happen; there
    it shows how many there were, and all costs but the repair's are due at the end. Returns have the same law.
    A state has the digits time (0 … horizon), repaired (2), traffic jam (2), flat tyre (2), brand (4).

    Args:
        horizon: steps of an episode.
    """

    def __init__(self, horizon: PositiveInt = 50) -> None:
        self.horizon = horizon
        self.digits = (horizon + 1, 2, 2, 2, 4)
        self.sizes = (int(np.prod(self.digits)), 2)

    def first(self) -> dict[int, float]:
        """Any brand, not yet repaired."""
        return dict.fromkeys(range(4), 1 / 4)

    def outcomes(self, state: int, action: int) -> Sequence[Outcome]:
        """A jam or not, a flat tyre or not."""
        time, repaired, *_, brand = self._read(state)
        if time == self.horizon:
            return []
        if time == 0:
            repaired = int(action == 0)
        paid = -REPAIR[brand][0] if time == 0 else 0.0
        if time == self.horizon - 1:
            paid += PRICE[brand] - DELIVERY[brand][0]
        found = list[Outcome]()
        for events in product(range(2), repeat=2):
            probability, cost = 1.0, 0.0
            for happens, (chance, price) in zip(events, EVENTS, strict=True):
                probability *= chance if happens else 1 - chance
                cost += price * happens
            then = int(np.ravel_multi_index((time + 1, repaired, *events, brand), self.digits))
            found.append((probability, then, repaired * (paid - cost)))
        return found

    def deviation(self, state: int, action: int) -> float:
        """Of the costs of the repair, and of the brand's delivery."""
        time, repaired, *_, brand = self._read(state)
        repaired = int(action == 0) if time == 0 else repaired
        now = REPAIR[brand][1] * (time == 0), DELIVERY[brand][1] * (time == self.horizon - 1)
        return repaired * float(np.hypot(*now))

    def _read(self, state: int) -> tuple[int, ...]:
        return tuple(int(digit) for digit in np.unravel_index(state, self.digits))
