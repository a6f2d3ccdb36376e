"""Labels for an environment that you have: its rewards go in, what a learner may be told comes out.

A Gymnasium environment is stepped as always. The last feedback is one of your own.
"""

from __future__ import annotations

import gymnasium
import torch
from torch import Tensor

import credit  # noqa: F401 - registers credit/Sepsis-v0
from credit.core.problem import Problem
from credit.core.seams import Feedback
from credit.envs.feedback import BlockSum, Success, Terminal

PATIENTS, STEPS = 6, 5


class Rounded(Feedback):
    """A verdict by somebody who looks at the whole: better, worse or neither."""

    objective = "sum"

    def __init__(self, window: int) -> None:
        self.window = window

    def start(self, problem: Problem) -> None:
        """There is no noise."""

    def __call__(self, rewards: Tensor) -> Tensor:
        """The sign of the sum [R, K] of rewards [R, K, T]."""
        return rewards.sum(-1).sign()


def rewards_of(patients: int) -> Tensor:
    """Rewards [1, K, T] of some episodes with random treatments: one replica, K windows of T steps."""
    env = gymnasium.make("credit/Sepsis-v0")
    env.action_space.seed(0)
    found = torch.zeros(1, patients, STEPS, dtype=torch.float64)
    for patient in range(patients):
        env.reset(seed=patient)
        for step in range(STEPS):
            _, reward, terminated, truncated, _ = env.step(env.action_space.sample())
            found[0, patient, step] = float(reward)
            if terminated or truncated:
                break  # what lies behind the end of an episode is worth 0
    return found


def main() -> None:
    """The same rewards, told in four ways."""
    rewards = rewards_of(PATIENTS)
    problem = Problem.finite(1296, 8, window=STEPS, seeds=(0,), episodic=True)
    for feedback in (BlockSum(STEPS, noise=0.2), Terminal(STEPS), Success(STEPS), Rounded(STEPS)):
        feedback.start(problem)
        labels = feedback(rewards)[0].tolist()
        print(f"{type(feedback).__name__:<9}", "  ".join(f"{label:+.1f}" for label in labels))


if __name__ == "__main__":
    main()
