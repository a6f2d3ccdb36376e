"""Started learners with a replay."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import pytest

from credit.agents.sac.learner import Learner
from credit.core.problem import Problem
from credit.core.store import Windows
from credit.data.replay import Replay


@pytest.fixture(scope="session")
def make_learner(make_trajectories: Callable[..., Windows]) -> Callable[..., tuple[Learner, Replay]]:
    """A started learner of some seeds with its replay; what a seed's replay holds depends on the seed alone."""

    def make(seeds: Sequence[int], **keys: Any) -> tuple[Learner, Replay]:
        sac = Learner(**({"width": 16, "batch": 8, "n_step": 3} | keys))
        sac.make(observations=4, actions=2, seeds=seeds)
        labels = [[1.0, 0.0, 1.0 - seed % 2] for seed in seeds]
        windows = make_trajectories([[5 + seed, 9, 4] for seed in seeds], labels, seeds)
        replay = sac.replay(Problem.vectors(4, 2, 20, tuple(seeds)))
        replay.relabel(windows, windows.states[..., 1])
        return sac, replay

    return make
