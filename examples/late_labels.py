"""Your Gymnasium environment, told late: its rewards are kept, and every 5 steps a label comes in their place.

Run:  python examples/late_labels.py
"""

from __future__ import annotations

import gymnasium

from credit.envs import DelayedReward
from credit.envs.feedback import BlockSum


def main() -> None:
    """One episode of a pole that falls, with random pushes; each step is worth 1."""
    env = DelayedReward(gymnasium.make("CartPole-v1"), BlockSum(window=5, noise=0.1, cut="drop"))
    env.action_space.seed(0)
    env.reset(seed=0)
    over, step = False, 0
    while not over:
        _, reward, terminated, truncated, info = env.step(env.action_space.sample())
        step, over = step + 1, terminated or truncated
        if "label" in info:  # an agent sees the same as its reward
            print(f"step {step:2d}: label {info['label']:.2f}, reward {reward:.2f}")
        elif info["censored"]:  # the episode's end cut a window short, and cut="drop" gives such a one no label
            print(f"step {step:2d}: a window ends without a label")


if __name__ == "__main__":
    main()
