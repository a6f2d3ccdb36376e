"""The P of environments that offer it, as lists: what an exact judge needs, and no learner sees."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import torch
from scipy.sparse import csr_array
from torch import Tensor

from credit.core.cells import Cells
from credit.core.problem import FLOAT
from credit.core.truth import EpisodicTruth
from credit.envs.exact.episodic import expected
from credit.planning.horizon import backward, worth


@dataclass(frozen=True)
class Listed:
    """P[s][a] = [(probability, s', r(s, a, s'), whether the episode ends)], as Gymnasium's toy texts have it.

    Attributes:
        goes_on: Σ of the probability that leads to s' and goes on [S·A, S]. reward: Σ P(s'|s, a) r(s, a, s') [S, A].
        initial: [S].
    """

    goes_on: csr_array
    reward: Tensor
    initial: Tensor

    @classmethod
    def of(cls, env: Any) -> Listed | None:
        """That of an environment, None where it offers none, or no start distribution."""
        table, initial = getattr(env, "P", None), getattr(env, "initial_state_distrib", None)
        if table is None or initial is None:
            return None
        states, actions = len(table), len(table[0])
        reward, goes_on = np.zeros(states * actions), list[tuple[float, int, int]]()
        for s in range(states):
            for a in range(actions):
                for probability, then, r, ends in table[s][a]:
                    reward[s * actions + a] += probability * r
                    if not ends:
                        goes_on.append((probability, s * actions + a, int(then)))
        values, rows, columns = (np.array(part) for part in zip(*goes_on, strict=True))
        ahead = csr_array((values, (rows, columns)), shape=(states * actions, states))
        return cls(ahead, torch.from_numpy(reward).view(states, actions), torch.as_tensor(initial, dtype=FLOAT))

    def ahead(self, values: Tensor) -> Tensor:
        """r(s, a) + Σ P(s'|s, a) v(s') [..., S, A] of values [..., S], 0 behind an end."""
        return self.reward + expected(self.goes_on, values)

    def truth(self, horizon: int) -> EpisodicTruth:
        """V* and the value of policies over a named horizon: a time limit stands outside of P."""
        nothing = torch.zeros_like(self.initial)
        values, _ = backward(self.ahead, nothing, horizon)
        evaluate = partial(worth, self.ahead, nothing, self.initial)
        states, actions = self.reward.shape
        uniform = torch.full((1, horizon, states, actions), 1 / actions, dtype=FLOAT)

        def table(cells: Cells) -> Tensor:
            return cells.known(self.reward)

        return EpisodicTruth(float(values[0] @ self.initial), float(evaluate(uniform)), table, evaluate)
