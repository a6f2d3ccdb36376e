"""Policy iteration as a loop: what `solve.policy_iteration` does, one replica after the other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from credit.core.compiled import Loop

Numbers = NDArray[np.float64]


@Loop
def improve(
    transition: Numbers, reward: Numbers, policy: NDArray[np.int64], discount: float, tie: float, sweeps: int
) -> None:
    """Howard's policy iteration for discounts γ < 1, in place.

    Args:
        transition: P [R, S, A, S]. reward: r [R, S, A]. policy: where to start, and what comes out [R, S].
        discount: γ. tie: of action values, in units of 1 + the largest |h|. sweeps: most evaluations.
    """
    replicas, states, actions = reward.shape
    matrix, target = np.empty((states, states)), np.empty(states)
    common, values = np.empty((states, actions)), np.empty(actions)
    for r in range(replicas):
        for s in range(states):
            for a in range(actions):
                common[s, a] = (1 - discount * transition[r, s, a].sum()) / (1 - discount)
        for _ in range(sweeps):
            for s in range(states):
                a = policy[r, s]
                for t in range(states):
                    matrix[s, t] = (s == t) - discount * transition[r, s, a, t]
                matrix[s, 0] = common[s, a]
                target[s] = reward[r, s, a]
            bias = np.linalg.solve(matrix, target)
            gain, largest = bias[0], 0.0
            bias[0] = 0
            for s in range(states):
                largest = max(largest, abs(bias[s]))
            same = True
            for s in range(states):
                best = -np.inf
                for a in range(actions):
                    ahead = 0.0
                    for t in range(states):
                        ahead += transition[r, s, a, t] * bias[t]
                    values[a] = reward[r, s, a] + discount * ahead - gain * common[s, a]
                    best = max(best, values[a])
                if best > values[policy[r, s]] + tie * (1 + largest):
                    same = False
                    policy[r, s] = 0
                    while values[policy[r, s]] < best - tie * (1 + largest):
                        policy[r, s] += 1
            if same:
                break
