"""Your Stable-Baselines3 agent, your environment, a label every 20 steps: the agent learns from recovered rewards.

Run:  pip install 'credit-rl[sb3]' && python examples/sb3_agent.py
"""

from __future__ import annotations

import sys
from typing import ClassVar

import gymnasium
import numpy as np
import torch
from stable_baselines3 import SAC
from torch import Tensor

from credit.bridges.sb3 import Relabel
from credit.core.problem import Problem
from credit.core.seams import FeatureMap
from credit.core.steps import Steps
from credit.envs import DelayedReward
from credit.envs.feedback import BlockSum
from credit.recovery.models.linear import LinearModel
from credit.recovery.recovery import Recovery
from credit.recovery.uncertainty.bootstrap import Analytic


class Squares(FeatureMap):
    """What a pendulum's reward may look at: all that it sees and does, and products of two."""

    observations: ClassVar = "vector"
    actions: ClassVar = "vector"

    def start(self, problem: Problem) -> None:
        """Nothing to learn."""

    def __call__(self, steps: Steps) -> Tensor:
        """(1, x, x·x) [..., 15]."""
        x = torch.cat([torch.ones_like(steps.actions), steps.states, steps.actions], -1)
        first, second = torch.triu_indices(x.shape[-1], x.shape[-1])
        return (x[..., first] * x[..., second]).double()


def main(steps: int = 1_500) -> float:
    """Learn, and compare what stands in the replay buffer with the rewards that nobody told."""
    env = DelayedReward(gymnasium.make("Pendulum-v1"), BlockSum(window=20, noise=0.5))
    model = SAC("MlpPolicy", env, learning_starts=1_000, policy_kwargs={"net_arch": [64, 64]}, seed=0, device="cpu")
    recovery = Recovery(LinearModel("squares", Squares(), Analytic(noise=None), regularization=0.01))
    model.learn(steps, callback=Relabel(recovery, every=500))

    buffer, known = model.replay_buffer, steps // 500 * 500
    assert buffer is not None
    cos, sin, speed = buffer.observations[:known, 0].T
    true = -(np.arctan2(sin, cos) ** 2 + 0.1 * speed**2 + 0.001 * (2 * buffer.actions[:known, 0, 0]) ** 2)
    correlation = float(np.corrcoef(true, buffer.rewards[:known, 0])[0, 1])
    print(f"{known} steps, {known // 20} labels; correlation with the true rewards {correlation:.2f}")
    return correlation


if __name__ == "__main__":
    torch.set_num_threads(1)  # networks this small are slower on several
    main(*map(int, sys.argv[1:]))
