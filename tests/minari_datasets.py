"""Datasets in Minari's own store, as others would have recorded them."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np


def written(name: str, episodes: list[dict[str, Any]], env: str | None = None) -> Any:
    """Episodes `{"observations": nested arrays [L + 1, ...], "actions": [L, A]}`, and rewards, if not 0."""
    import minari
    from minari.data_collector import EpisodeBuffer

    def space(values: Any) -> gymnasium.Space[Any]:
        if isinstance(values, dict):
            return gymnasium.spaces.Dict({key: space(inner) for key, inner in values.items()})
        if values.dtype.kind == "i":
            return gymnasium.spaces.Discrete(int(values.max()) + 1)
        return gymnasium.spaces.Box(-np.inf, np.inf, values.shape[1:])

    buffers = []
    for number, episode in enumerate(episodes):
        steps = len(episode["actions"])
        flags = {
            "rewards": [0.0] * steps,
            "terminations": [False] * steps,
            "truncations": [False] * (steps - 1) + [True],
        }
        buffers.append(EpisodeBuffer(id=number, **{**flags, **episode}))
    done = episodes[0]["actions"]
    return minari.create_dataset_from_buffers(
        name,
        buffers,
        env=env,
        action_space=space(done) if done.dtype.kind == "i" else gymnasium.spaces.Box(-1, 1, done.shape[1:]),
        observation_space=space(episodes[0]["observations"]),
        data_format="hdf5",
        description="a test",
        algorithm_name="a test",
        author="a test",
        author_email="a@test",
        code_permalink="a test",
    )
