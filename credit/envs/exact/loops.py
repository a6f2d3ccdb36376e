"""A table of actions followed in a finite MDP: what `ExactEnvironment.step` does, many steps at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from credit.core.compiled import Loop

Numbers = NDArray[np.float64]
Indices = NDArray[np.int64]


@Loop
def follow(table: Indices, states: Indices, cumulative: Numbers, uniform: Numbers) -> Indices:
    """The states that are seen, the actions that are taken there, and the states that they lead to [3, R, n].

    Args:
        table: an action for every state [R, S]. states: the first ones [R, 1]. cumulative: running sums of P [S·A, S].
        uniform: numbers in [0, 1) [R, n].
    """
    replicas, count = uniform.shape
    actions = len(cumulative) // table.shape[1]
    path = np.empty((3, replicas, count), np.int64)
    for r in range(replicas):
        state = states[r, 0]
        for t in range(count):
            action = table[r, state]
            path[0, r, t], path[1, r, t] = state, action
            state = np.searchsorted(cumulative[state * actions + action], uniform[r, t], side="right")
            path[2, r, t] = state
    return path
