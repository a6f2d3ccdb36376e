"""Algorithm B.1 as one would first write it: one seed, NumPy, every model refitted on every resample, every block.

A second implementation that shares no line with the fast one: the benchmark and the tests compare with it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

Features = Callable[[np.ndarray, np.ndarray], np.ndarray]


def identity(states: np.ndarray, actions: np.ndarray) -> np.ndarray:
    """One-hot of the 30 pairs."""
    return np.eye(30)[states * 3 + actions]


def bilinear(states: np.ndarray, actions: np.ndarray) -> np.ndarray:
    """(1, s, a, s·a)."""
    return np.stack([np.ones(states.shape), states, actions, states * actions], axis=-1)


def threshold(states: np.ndarray, actions: np.ndarray) -> np.ndarray:
    """Six cells: low or high state, action."""
    return np.eye(6)[(states > 4) * 3 + actions]


MODELS: dict[str, Features] = {"ridge": identity, "linear": bilinear, "threshold": threshold}


def fit(features: Features, states: np.ndarray, actions: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Ridge regression of labels [K] on summed features of windows [K, T]; the reward table [S, A]."""
    return solve(features, features(states, actions).sum(1), labels)


def solve(features: Features, design: np.ndarray, labels: np.ndarray, ridge: float = 0.1) -> np.ndarray:
    """Ridge regression of labels [K] on a design matrix [K, d]; the reward table [S, A]."""
    theta = np.linalg.solve(design.T @ design + ridge * np.eye(design.shape[1]), design.T @ labels)
    every_state, every_action = np.meshgrid(np.arange(10), np.arange(3), indexing="ij")
    return features(every_state, every_action) @ theta


def proxies(
    states: np.ndarray,
    actions: np.ndarray,
    labels: np.ndarray,
    draws: int,
    rng: np.random.Generator,
    cache: bool = False,
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Fits, MSE proxies (10), (11) and disagreements (9) of all models, by B resamples of the windows.

    With `cache` the design matrices are made once for all resamples: less naive, kept for comparison.
    """
    designs = {name: features(states, actions).sum(1) for name, features in MODELS.items()} if cache else {}
    fitted = {name: fit(features, states, actions, labels) for name, features in MODELS.items()}
    resampled: dict[str, list[np.ndarray]] = {name: [] for name in MODELS}
    for _ in range(draws):
        chosen = rng.integers(len(labels), size=len(labels))
        for name, features in MODELS.items():
            if cache:
                resampled[name].append(solve(features, designs[name][chosen], labels[chosen]))
            else:
                resampled[name].append(fit(features, states[chosen], actions[chosen], labels[chosen]))
    tables = {name: np.stack(drawn) for name, drawn in resampled.items()}
    gaps = {name: ((tables["ridge"] - tables[name]) ** 2).mean(0) for name in MODELS if name != "ridge"}
    mse = {name: table.var(0) + gaps.get(name, 0.0) for name, table in tables.items()}
    return fitted, mse, gaps


def weights(mse: dict[str, np.ndarray], alpha: float = 0.5) -> dict[str, np.ndarray]:
    """Relative-MSE softmax (12)–(14)."""
    stacked = np.stack(list(mse.values()))
    excess = (stacked - stacked.min(0)) / np.maximum(np.median(stacked, axis=0), 1e-12)
    raw = np.exp(-excess / alpha)
    return dict(zip(mse, raw / raw.sum(0), strict=True))


def plan(transition: np.ndarray, reward: np.ndarray, policy: np.ndarray) -> np.ndarray:
    """Average-reward policy iteration on P [S, A, S], r [S, A]."""
    rows = np.arange(len(policy))
    for _ in range(100):
        system = np.eye(len(policy)) - transition[rows, policy]
        system[:, 0] = 1.0
        bias = np.linalg.solve(system, reward[rows, policy])
        bias[0] = 0.0
        values = reward + transition @ bias
        better = np.where(values.max(1) > values[rows, policy] + 1e-9, values.argmax(1), policy)
        if (better == policy).all():
            break
        policy = better
    return policy


@dataclass
class NaiveDisagreement:
    """Disagreement-UCB of one seed; `decide` turns all windows so far into a policy [S]."""

    rng: np.random.Generator
    draws: int = 20
    cache: bool = False
    policy: np.ndarray = field(default_factory=lambda: np.zeros(10, dtype=int))

    def decide(
        self, states: np.ndarray, actions: np.ndarray, next_states: np.ndarray, labels: np.ndarray
    ) -> np.ndarray:
        """One block of algorithm B.1 for windows [K, T] and labels [K]."""
        fitted, mse, gaps = proxies(states, actions, labels, self.draws, self.rng, self.cache)
        weight = weights(mse)
        mixed = sum(weight[name] * fitted[name] for name in MODELS)
        order = list(MODELS)
        best = np.stack([mse[name] for name in order]).argmin(0)
        signal = np.choose(best, [np.sqrt(mse["ridge"]), np.sqrt(gaps["linear"]), np.sqrt(gaps["threshold"])])
        counts = np.zeros((10, 3, 10))
        np.add.at(counts, (states.ravel(), actions.ravel(), next_states.ravel()), 1)
        decay = 1 / np.sqrt(1 + counts.sum(-1))
        prior = np.zeros((10, 10))
        for shift in (-1, 0, 1):
            prior[np.arange(10), np.clip(np.arange(10) + shift, 0, 9)] += 1 / 3
        transition = (counts + prior[:, None]) / (counts.sum(-1, keepdims=True) + 1)
        self.policy = plan(transition, mixed + 0.35 * decay + signal * decay, self.policy)
        return self.policy
