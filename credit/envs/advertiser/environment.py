"""The toy advertiser of section 6.1: a shopper population, three intensities of advertising."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch

from credit.core.errors import UserError
from credit.core.knowledge import KnownTransitions
from credit.core.problem import FLOAT
from credit.core.ranges import PositiveInt, Probability
from credit.envs.exact.continuing import TabularEnvironment, TabularGymEnv, TabularMDP


@dataclass(frozen=True)
class LineKnowledge(KnownTransitions):
    """That states lie on a line, and a step moves by one at most and stays where it would leave the line."""


class Advertiser(TabularEnvironment):
    """Toy advertiser: the population moves by the intensity, profit is a concave function of both (6.1, eq. 23).

    r(s, a) = gain·s − crowding·s² − cost·a − convexity·a² + interaction[a]·s. Action 0 moves the population down, the
    last one up, any between both ways; boundaries reflect (stay), the remaining probability is to stay.

    Args:
        states: number of populations S (≥ 2).
        p_down: probability that action 0 moves down.
        p_up: probability that the last action moves up.
        p_mid_down: probability that an action between moves down.
        p_mid_up: probability that an action between moves up.
        gain: linear value of one unit of population, per step.
        crowding: quadratic loss of population, per step.
        cost: linear cost of advertising.
        convexity: quadratic cost of advertising.
        interaction: φ(a), value of a unit of population under each action; its length is the number of actions.
        initial_state: where every run starts.
    """

    def __init__(
        self,
        states: PositiveInt = 10,
        p_down: Probability = 0.6,
        p_up: Probability = 0.6,
        p_mid_down: Probability = 0.3,
        p_mid_up: Probability = 0.3,
        gain: float = 0.05,
        crowding: float = 0.005,
        cost: float = 0.05,
        convexity: float = 0.12,
        interaction: Sequence[float] = (0.0, 0.02, 0.05),
        initial_state: int = 0,
    ) -> None:
        if states < 2:
            raise UserError(f"env.states={states}: at least 2 are needed")
        if len(interaction) < 2:
            raise UserError(f"env.interaction={list(interaction)}: one number an action, at least 2 actions")
        if p_mid_down + p_mid_up > 1:
            raise UserError(f"env.p_mid_down + env.p_mid_up = {p_mid_down + p_mid_up:g}: at most 1 is allowed")
        if not 0 <= initial_state < states:
            raise UserError(f"env.initial_state={initial_state}: allowed are 0 to {states - 1}")
        self.states = states
        self.moves = [(p_down, 0.0), *[(p_mid_down, p_mid_up)] * (len(interaction) - 2), (0.0, p_up)]
        self.coefficients = (gain, crowding, cost, convexity)
        self.interaction = tuple(interaction)
        self.initial_state = initial_state

    @cached_property
    def mdp(self) -> TabularMDP:
        """P, r and everything that follows from them."""
        gain, crowding, cost, convexity = self.coefficients
        s = torch.arange(self.states, dtype=FLOAT).unsqueeze(1)
        a = torch.arange(len(self.interaction), dtype=FLOAT).unsqueeze(0)
        phi = torch.tensor(self.interaction, dtype=FLOAT)
        reward = gain * s - crowding * s**2 - cost * a - convexity * a**2 + phi * s
        transition = torch.zeros(self.states, len(self.moves), self.states, dtype=FLOAT)
        for state in range(self.states):
            for action, (down, up) in enumerate(self.moves):
                transition[state, action, max(state - 1, 0)] += down
                transition[state, action, min(state + 1, self.states - 1)] += up
                transition[state, action, state] += 1 - down - up
        initial = torch.zeros(self.states, dtype=FLOAT)
        initial[self.initial_state] = 1
        return TabularMDP(transition, reward, initial)

    def knowledge(self) -> LineKnowledge:
        """That populations lie on a line; and P, for oracles."""
        return LineKnowledge(self.mdp.transitions.backup)


class AdvertiserEnv(TabularGymEnv):
    """`credit/Advertiser-v0`: one advertiser as a Gymnasium environment; keyword arguments as in `Advertiser`."""

    def __init__(self, render_mode: str | None = None, **parameters: Any) -> None:
        super().__init__(Advertiser(**parameters).mdp, render_mode)
