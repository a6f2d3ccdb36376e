"""Trajectories for replay, and started learners."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import pytest
import torch
from tensordict import TensorDict

from credit.agents.sac.learner import Learner
from credit.data.trajectory_replay import Replay


def trajectories(lengths: Sequence[int], won: Sequence[bool], seed: int = 0, first_id: int = 0) -> TensorDict:
    """Flat rows as a round collector gives them, of 4 observed numbers and 2 actions."""
    generator = torch.Generator().manual_seed(seed)
    parts = []
    for number, (length, success) in enumerate(zip(lengths, won, strict=True)):
        path = torch.randn(length + 1, 4, generator=generator)
        last = torch.zeros(length, 1, dtype=torch.bool)
        last[-1] = True
        ends = {
            "done": last,
            "success": last & success,
            "terminated": last & success,
            "truncated": last & (not success),
        }
        rewards = torch.randn(length, 1, generator=generator)
        rows = {
            "observation": path[:-1],
            "action": torch.rand(length, 2, generator=generator) * 2 - 1,
            "collector": {"traj_ids": torch.full((length,), first_id + number)},
            "next": {"observation": path[1:], "reward": rewards, **ends},
        }
        parts.append(TensorDict(rows, [length]))
    return torch.cat(parts)


@pytest.fixture(scope="session")
def make_rows() -> Callable[..., TensorDict]:
    """`make_rows(lengths, won, seed)`: flat rows [sum of lengths]."""
    return trajectories


@pytest.fixture(scope="session")
def make_learner() -> Callable[..., tuple[Learner, Replay]]:
    """A started learner of some seeds with its replay; what a seed's replay holds depends on the seed alone."""

    def make(seeds: Sequence[int], **keys: Any) -> tuple[Learner, Replay]:
        sac = Learner(**({"width": 16, "batch": 8, "n_step": 3} | keys))
        sac.make(observations=4, actions=2, seeds=seeds)
        replay = sac.replay(capacity=1000)
        for r, seed in enumerate(seeds):
            rows = trajectories([5 + seed, 9, 4], [True, False, seed % 2 == 0], seed)
            replay.extend(rows, torch.full((len(rows),), r))
        return sac, replay

    return make
