"""RiverSwim (Strehl & Littman 2008): a small reward at hand, a large one against the current."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated

import torch
from annotated_types import Ge

from credit.core.errors import UserError
from credit.core.problem import FLOAT
from credit.core.ranges import Probability
from credit.envs.advertiser.environment import LineKnowledge
from credit.envs.exact.continuing import TabularEnvironment, TabularMDP


class RiverSwim(TabularEnvironment):
    """RiverSwim, which goes on for ever: action 0 swims with the current, action 1 against it.

    Action 0 leads from s to s − 1 with certainty, and in state 0 stays there and gives `near`. Action 1 leads to s + 1
    with `forward` and to s − 1 with `back`; from state 0 it leads to state 1 with `first`; in the last state it gives
    `far`, and stays there with `last`, else it is driven back. All else is to stay (Strehl
    & Littman 2008). It is a continuing task here, judged by the average reward (42). The numbers are those of Osband,
    Russo & Van Roy 2013, who reset it every 20 steps, and of most papers since then; the original ones are forward=.3,
    back=.1, first=.3, last=.3, near=5, and 10000 for staying in the last state (far=3000), begun in state 1 or 2.

    Args:
        states: S, length of the river.
        forward: probability that action 1 leads forward, between the ends.
        back: probability that action 1 is driven back, between the ends.
        first: probability that action 1 leads forward from the first state.
        last: probability that action 1 stays in the last state.
        near: reward of action 0 in the first state.
        far: reward of action 1 in the last state.
    """

    def __init__(
        self,
        states: Annotated[int, Ge(2)] = 6,
        forward: Probability = 0.35,
        back: Probability = 0.05,
        first: Probability = 0.6,
        last: Probability = 0.6,
        near: float = 0.005,
        far: float = 1.0,
    ) -> None:
        if forward + back > 1:
            raise UserError(f"env.forward + env.back = {forward + back:g}: at most 1 is allowed")
        self.states = states
        self.moves = [(0.0, first), *[(back, forward)] * (states - 2), (1 - last, 0.0)]  # of action 1: down, up
        self.near, self.far = near, far

    @cached_property
    def mdp(self) -> TabularMDP:
        """P, r and everything that follows from them."""
        transition = torch.zeros(self.states, 2, self.states, dtype=FLOAT)
        for s, (down, up) in enumerate(self.moves):
            transition[s, 0, max(s - 1, 0)] = 1
            transition[s, 1, max(s - 1, 0)] += down
            transition[s, 1, min(s + 1, self.states - 1)] += up
            transition[s, 1, s] += 1 - down - up
        reward = torch.zeros(self.states, 2, dtype=FLOAT)
        reward[0, 0], reward[-1, 1] = self.near, self.far
        return TabularMDP(transition, reward, torch.eye(self.states, dtype=FLOAT)[0])

    def knowledge(self) -> LineKnowledge:
        """That states lie on a line; and P, for oracles."""
        return LineKnowledge(self.mdp.transitions.backup)
