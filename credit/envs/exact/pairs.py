"""Exact episodic MDPs with a reward r(s, a), whose episodes may end before the horizon: what an exact judge needs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import torch
from scipy.sparse import csr_array
from torch import Tensor

from credit.core.cells import Cells
from credit.core.problem import FLOAT
from credit.core.truth import EpisodicTruth
from credit.envs.exact.episodic import expected
from credit.planning.horizon import backward, worth


@dataclass(frozen=True)
class PairMDP:
    """Where every pair (s, a) leads, and what it gives in expectation: the truth, which no learner sees.

    Attributes:
        goes_on: Σ of the probability that leads to s' and goes on [S·A, S]; what a row leaves to 1 is the end.
        reward: Σ P(s'|s, a) r(s, a, s') [S, A]. initial: [S].
    """

    goes_on: csr_array
    reward: Tensor
    initial: Tensor

    def ahead(self, values: Tensor) -> Tensor:
        """r(s, a) + Σ P(s'|s, a) v(s') [..., S, A] of values [..., S], 0 behind an end."""
        return self.reward + expected(self.goes_on, values)

    def truth(self, horizon: int) -> EpisodicTruth:
        """V* and the value of policies, for the sum of rewards over a named horizon: a time limit stands outside P."""
        nothing = torch.zeros_like(self.initial)
        values, _ = backward(self.ahead, nothing, horizon)
        evaluate = partial(worth, self.ahead, nothing, self.initial)
        states, actions = self.reward.shape
        uniform = torch.full((states, actions), 1 / actions, dtype=FLOAT).expand(1, horizon, -1, -1)

        def table(cells: Cells) -> Tensor:
            return cells.known(self.reward)

        return EpisodicTruth(float(values[0] @ self.initial), float(evaluate(uniform)), table, evaluate)
