"""The P of environments that offer it, as lists or as tables: what an exact judge needs, and no learner sees."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from scipy.sparse import csr_array

from credit.core.problem import FLOAT
from credit.envs.exact.pairs import PairMDP

TABLES = ("tx_mat", "r_mat", "d_0")  # P [S, A, S], r(s, a, s') [S, A, S] and the start [S] of ICU-Sepsis


class Listed(PairMDP):
    """The exact MDP of an environment that shows it."""

    @classmethod
    def of(cls, env: Any) -> Listed | None:
        """That of an environment without its wrappers, None where it offers none, or no start distribution."""
        lists, initial = getattr(env, "P", None), getattr(env, "initial_state_distrib", None)
        if lists is not None and initial is not None:
            return cls._of_lists(lists, initial)
        dynamics = getattr(env, "dynamics", None)
        if isinstance(dynamics, Mapping) and all(name in dynamics for name in TABLES):
            # Inadmissible actions lead where the admissible ones do on average, as the table has it; in its other modes
            # they end the episode or raise, and the table is not what happens.
            same = getattr(env, "_inadmissible_action_strategy", "mean") == "mean"
            return cls._of_tables(*(dynamics[name] for name in TABLES)) if same else None
        return None

    @classmethod
    def _of_lists(cls, table: Any, initial: Any) -> Listed:
        """P[s][a] = [(probability, s', r(s, a, s'), whether the episode ends)], as Gymnasium's toy texts have it."""
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

    @classmethod
    def _of_tables(cls, transition: np.ndarray, reward: np.ndarray, initial: np.ndarray) -> Listed:
        """P and r written out, where ends lead to a state that gives nothing and is never left."""
        expected = torch.from_numpy(np.einsum("sat,sat->sa", transition, reward))
        rows = transition.reshape(-1, transition.shape[-1])
        return cls(csr_array(rows), expected, torch.as_tensor(initial, dtype=FLOAT))
