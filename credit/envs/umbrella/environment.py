"""The umbrella chain (Osband et al. 2019): whether to take it is decided first, and pays last."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Annotated

import numpy as np
from annotated_types import Interval

from credit.core.ranges import NonNegative, PositiveInt
from credit.envs.exact.outcomes import Outcome, OutcomeEnvironment


class Umbrella(OutcomeEnvironment):
    """The umbrella chain: the first action takes an umbrella (1) or leaves it (0); no other action has an effect.

    The last step gives 1 if the umbrella is there where it is needed and not there where it is not, else −1; all steps
    before give +noise or −noise, each with probability 1/2. So the best return is 1 in expectation, that of random
    actions 0 (Osband et al. 2019, "Behaviour suite for reinforcement learning", umbrella_length and umbrella_distract;
    there 20 distractors with chains of 1 to 100 steps, and 1 to 100 distractors with a chain of 20). A state has the
    digits time (0 … horizon), needed (2), there (2; drawn, until the first action), distractors (2 each, drawn anew in
    every step). Tables grow with 4^distractors: hence at most 6.

    Args:
        horizon: n, length of the chain.
        distractors: bits of the state that mean nothing.
        noise: size of the rewards that mean nothing.
    """

    def __init__(
        self,
        horizon: PositiveInt = 20,
        distractors: Annotated[int, Interval(ge=0, le=6)] = 2,
        noise: NonNegative = 1.0,
    ) -> None:
        self.horizon = horizon
        self.digits = (horizon + 1, 2, 2, 2**distractors)
        self.sizes = (int(np.prod(self.digits)), 2)
        self.noise = noise

    def first(self) -> dict[int, float]:
        """Everything is drawn but the time."""
        count = self.sizes[0] // (self.horizon + 1)
        return dict.fromkeys(range(count), 1 / count)

    def outcomes(self, state: int, action: int) -> Sequence[Outcome]:
        """Other distractors, and a reward that means something in the last step alone."""
        time, needed, there, _ = (int(digit) for digit in np.unravel_index(state, self.digits))
        if time == self.horizon:
            return []
        there = action if time == 0 else there
        last = time == self.horizon - 1
        rewards = [1.0 if there == needed else -1.0] if last else [self.noise, -self.noise]
        bits = self.digits[-1]
        begin = int(np.ravel_multi_index((time + 1, needed, there, 0), self.digits))
        return [(1 / bits / len(rewards), begin + bit, reward) for bit, reward in product(range(bits), rewards)]
