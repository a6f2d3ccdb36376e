"""Equal cells and flat features, by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Discrete

from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.steps import Steps
from credit.envs.spaces import Vectors
from credit.recovery.features.cells import EqualCells
from credit.recovery.features.coordinates import Coordinates
from credit.recovery.features.flat import Flat

FINITE = Problem.finite(10, 3, 7, (0,))
VECTORS = replace(Problem.vectors(2, 1, 4, (0,)), names=("x", "v"))
MIXED = replace(VECTORS, action_space=Discrete(3), observation_space=Box(-1.0, 1.0, (2,)))
UNIT = {"bounds": {"x": [0, 1]}, "actions": False}


def at(problem: Problem, states: Any, done: Any, *args: Any, **kwargs: Any) -> list[int]:
    features = EqualCells(*args, **kwargs)
    features.start(problem)
    steps = Steps(torch.tensor(states), torch.tensor(done), torch.tensor(states))
    values = features(steps)
    assert (values.sum(-1) == 1).all()
    return values.to(torch.int64).argmax(-1).tolist()


def test_states_that_are_numbers_fall_into_equal_cells() -> None:
    assert at(FINITE, list(range(10)), [0] * 10, {"s": 2}, actions=False) == [0] * 5 + [1] * 5
    assert at(FINITE, [4, 5, 9], [2, 0, 1], {0: 2}) == [2, 3, 4]  # (low, 2), (high, 0), (high, 1)


def test_coordinates_of_vectors_by_name_and_by_place() -> None:
    states, actions = [[0.0, 0.0], [0.24, 9.0], [0.25, 0.0], [1.0, 0.0], [-7.0, 0.0], [7.0, 0.0]], [[0.0]] * 6
    for name in ("x", "s0", 0):
        assert at(VECTORS, states, actions, {name: 4}, **UNIT) == [0, 0, 1, 3, 0, 3]
    assert at(VECTORS, states[:2], [[-1.0], [1.0]], {"x": 4, "a0": 2}, **UNIT) == [0, 1]
    assert at(MIXED, [[-1.0, 1.0], [0.5, -0.5]], [1, 2], 2) == [4, 8]  # (0, 1, 1), (1, 0, 2)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"cells": {"x": 4}, "actions": False}, "bounds=\\{s0: \\[lowest"),
        ({"cells": {"y": 4}}, "no coordinate 'y'"),
        ({"cells": {7: 4}}, "a state has 2"),
        ({"cells": {"x": 4, 0: 4}}, "there twice"),
        ({"cells": {"x": 4}, "bounds": {"x": [1, 1]}}, "lowest, highest"),
        ({"cells": {"x": 4}, "bounds": {"v": [0, 1]}}, "has bounds and no cells"),
        ({"cells": {"x": 4}, "bounds": {"x": [0, 1]}}, "actions are vectors here"),
        ({"cells": {"x": 20_000}, **UNIT}, "at most 10000"),
    ],
)
def test_what_does_not_fit_is_refused(keys: dict[str, Any], said: str) -> None:
    with pytest.raises(UserError, match=said):
        EqualCells(**keys).start(VECTORS)


def test_flat_features_by_hand() -> None:
    def flat(problem: Problem, states: Any, actions: Any) -> list[list[float]]:
        features = Flat()
        features.start(problem)
        return features(Steps(torch.tensor(states), torch.tensor(actions), torch.tensor(states))).tolist()

    assert flat(Problem.finite(2, 3, 7, (0,)), [1], [2]) == [[0, 1, 0, 0, 1]]
    assert flat(MIXED, [[0.5, 2.0]], [1]) == [[0.5, 2, 0, 1, 0]]
    assert flat(VECTORS, [[0.5, 2.0]], [[-1.0]]) == [[0.5, 2, -1]]
    assert flat(replace(VECTORS, observation_space=Discrete(2)), [0], [[-1.0]]) == [[1, 0, -1]]


def test_vectors_keep_the_bounds_of_their_space() -> None:
    box = Vectors(Box(np.array([-1.0, -np.inf]), np.array([2.0, np.inf]), dtype=np.float64)).space
    assert box.low.tolist() == [-1, -np.inf]
    assert box.high.tolist() == [2, np.inf]


def test_a_place_may_be_text_as_keys_are_on_their_way_to_a_worker() -> None:
    coordinates = Coordinates(Problem.vectors(3, 1, window=5, seeds=(0,)))
    assert coordinates.find("2") is coordinates.find(2) is coordinates.find("s2")
    with pytest.raises(UserError, match="there is no coordinate 3 here: a state has 3"):
        coordinates.find("3")
