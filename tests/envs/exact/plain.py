"""A naive second implementation of what an exact judge says: loops over states and outcomes, in NumPy."""

from __future__ import annotations

import numpy as np

from credit.envs.exact.outcomes import OutcomeEnvironment


def value(env: OutcomeEnvironment, steps: int, policy: np.ndarray | None = None) -> float:
    """V* of episodes of some steps, or that of a policy [T, S, A], under the start distribution."""
    states, actions = env.sizes
    values = np.zeros(states)
    for step in reversed(range(steps)):
        found = np.zeros((states, actions))
        for s in range(states):
            for a in range(actions):
                for probability, then, reward in env.outcomes(s, a):
                    found[s, a] += probability * (reward + values[then])
        values = found.max(1) if policy is None else (found * policy[step]).sum(1)
    return float(sum(probability * values[s] for s, probability in env.first().items()))
