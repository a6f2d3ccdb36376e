"""Soft actor-critic on transitions that you have: no environment, no run, no recovery.

A point on a line was pushed at random, 40 episodes of 20 pushes. What it should do is to be at 0.
"""

from __future__ import annotations

import torch
from torch import Tensor

from credit.agents.sac.learner import Learner
from credit.core.problem import Problem
from credit.core.windows import Episode, Windows

EPISODES, PUSHES = 40, 20


def logged() -> tuple[list[Episode], Tensor]:
    """Episodes of states [L, 1] and actions [L, 1] in [−1, 1], and a reward for each of their rows [1, n]."""
    generator = torch.Generator().manual_seed(0)
    episodes = []
    for _ in range(EPISODES):
        pushes = torch.rand(PUSHES, 1, generator=generator) * 2 - 1
        start = torch.rand(1, 1, generator=generator) * 2 - 1
        places = torch.cat([start, start + 0.3 * pushes.cumsum(0)])
        episodes.append(Episode(places[:-1], pushes, places[1:]))
    arrived = torch.cat([episode.next_states for episode in episodes])
    return episodes, -arrived.abs().T


def main() -> None:
    """Fit, and ask the learner what it would do."""
    episodes, rewards = logged()
    windows = Windows.of_episodes([episodes], labels=rewards.view(1, EPISODES, PUSHES).sum(-1).double())
    problem = Problem.vectors(observations=1, actions=1, window=PUSHES, seeds=(0,))

    learner = Learner(width=32, batch=64, n_step=1, success_share=0.0, discount=0.9, learning_rate=3e-3)
    learner.make(observations=1, actions=1, seeds=problem.seeds)
    replay = learner.replay(problem)
    replay.relabel(windows, rewards)  # rewards may change later: relabel again, and fit on
    told = learner.fit(replay, updates=600)
    print(f"after {learner.count} updates: loss of the critics {float(told['critic']):.4f}")

    places = torch.tensor([[[-1.0], [-0.5], [0.5], [1.0]]])  # [replicas, copies, numbers in a state]
    pushes = learner.mean(places)
    for place, push in zip(places.flatten().tolist(), pushes.flatten().tolist(), strict=True):
        print(f"at {place:+.1f} it pushes {push:+.2f}")


if __name__ == "__main__":
    main()
