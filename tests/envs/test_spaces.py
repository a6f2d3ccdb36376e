"""Encoders against Gymnasium's own `flatten`, one sample at a time."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
import torch
from gymnasium.spaces import (
    Box,
    Dict,
    Discrete,
    MultiBinary,
    MultiDiscrete,
    Sequence,
    Space,
    Text,
    Tuple,
    flatdim,
    flatten,
    flatten_space,
)
from gymnasium.vector.utils import concatenate, create_empty_array

from credit.core.errors import UserError
from credit.envs.spaces import LARGEST, Choices, Numbers, Scaled, Vectors, actions, observations, outside, problem

R, K = 2, 5
FINITE = [
    Discrete(7),
    Discrete(4, start=-2),
    MultiDiscrete([3, 4, 2]),
    MultiDiscrete([[3, 2], [2, 5]]),
    MultiDiscrete([3, 2], start=[5, -1]),
    MultiBinary(4),
    MultiBinary([2, 3]),
]
SPACES: list[Space[Any]] = [
    *FINITE,
    Box(-3, 5, (4,)),
    Box(0, 255, (2, 3), dtype=np.uint8),
    Box(-np.inf, np.inf, ()),
    Dict(place=Box(-1, 1, (2,)), inventory=MultiDiscrete([3, 2]), a=Discrete(3, start=1)),
    Tuple((Discrete(2), Box(-1, 1, (3,)), Dict(x=MultiBinary(2)))),
]


def stacked(space: Space[Any], samples: list[Any]) -> Any:
    """Samples [R·K] as the arrays [R, K, ...] that an environment of many copies gives."""
    if isinstance(space, Dict):
        return {key: stacked(inner, [one[key] for one in samples]) for key, inner in space.spaces.items()}
    if isinstance(space, Tuple):
        return tuple(stacked(inner, [one[i] for one in samples]) for i, inner in enumerate(space.spaces))
    values = np.stack([np.asarray(one) for one in samples])
    return values.reshape(R, K, *values.shape[1:])


def test_actions_are_of_the_type_that_the_space_has() -> None:
    """As `contains` asks for: whole numbers of 32 bits where the box has those."""
    for space in (Box(-3, 9, (2,), np.int32), Box(0, 255, (2,), np.uint8), Box(-1, 1, (2,)), MultiBinary(2)):
        done = actions(space)
        some = torch.tensor([[-1.0, 0.3], [1.0, 0.999]]) if isinstance(space, Box) else torch.tensor([0, 3])
        found = done(some).numpy()
        assert found.dtype == space.dtype
        assert all(space.contains(one) for one in found)


def drawn(space: Space[Any]) -> list[Any]:
    space.seed(3)
    return [space.sample() for _ in range(R * K)]


@pytest.mark.parametrize("space", SPACES, ids=str)
def test_vectors_are_those_of_gymnasium(space: Space[Any]) -> None:
    samples, encoder = drawn(space), Vectors(space)
    found = encoder(stacked(space, samples))
    assert found.shape == (R, K, flatdim(space))
    assert found.dtype == torch.float32
    assert encoder.space.shape == flatten_space(space).shape
    for mine, one in zip(found.flatten(0, 1), samples, strict=True):
        np.testing.assert_allclose(mine, flatten(space, one))


@pytest.mark.parametrize("space", FINITE, ids=str)
def test_numbers_count_every_value_once_and_lead_back(space: Space[Any]) -> None:
    encoder, back = Numbers(space), Choices(space)
    count = int(encoder.space.n)
    assert int(back.space.n) == count
    everything = torch.arange(count).view(1, count)
    values = back(everything)
    assert all(space.contains(np.asarray(value, dtype=space.dtype)) for value in values[0].numpy())
    assert torch.equal(encoder(values), everything)
    assert len(values[0].reshape(count, -1).unique(dim=0)) == count


def test_digits_come_first_one_first() -> None:
    encoder = Numbers(MultiDiscrete([3, 4]))
    assert encoder(torch.tensor([[[0, 0], [0, 3], [1, 0], [2, 3]]])).tolist() == [[0, 3, 4, 11]]


@pytest.mark.parametrize(
    ("low", "high", "done", "expected"),
    [
        (-2.0, 4.0, [-1.0, 0.0, 1.0, 0.5], [-2, 1, 4, 2.5]),
        (0.0, 10.0, [-1.0, 0.0, 1.0, -0.8], [0, 5, 10, 1]),
        (-1.0, 1.0, [-1.0, 0.25, 1.0, 7.0], [-1, 0.25, 1, 1]),  # what lies outside is cut
    ],
)
def test_boxes_are_scaled(low: float, high: float, done: list[float], expected: list[float]) -> None:
    encoder = Scaled(Box(low, high, (1,)))
    assert encoder.space == Box(-1.0, 1.0, (1,))
    found = encoder(torch.tensor(done).view(1, 4, 1))
    assert found.dtype == torch.float32
    assert found.flatten().tolist() == pytest.approx(expected)


def test_every_number_of_a_box_has_its_own_bounds_and_place() -> None:
    space = Box(np.array([[0, -1], [5, -10]], np.float32), np.array([[1, 1], [9, 10]], np.float32))
    found = Scaled(space)(torch.tensor([[[-1.0, 0.0, 1.0, 0.5]]]))
    assert found.shape == (1, 1, 2, 2)
    assert found[0, 0].tolist() == [[0, 0], [9, 5]]


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_an_action_lies_in_its_space(kind: type) -> None:
    space = Box(-0.1, 0.1, (2,), kind)
    assert space.contains(Scaled(space)(torch.tensor([1.0, -1.0])).numpy())


def test_whole_numbers_stay_whole() -> None:
    found = Scaled(Box(0, 10, (1,), dtype=np.int32))(torch.tensor([[[-1.0], [0.13], [1.0]]]))
    assert found.dtype == torch.int32
    assert found.flatten().tolist() == [0, 6, 10]


@pytest.mark.parametrize("bounds", [(-np.inf, np.inf), (0.0, np.inf), (-np.inf, 1.0)])
def test_boxes_without_bounds_are_refused_with_a_way_out(bounds: tuple[float, float]) -> None:
    with pytest.raises(UserError, match=r"no bounds.*\[-1, 1\].*RescaleAction"):
        actions(Box(*bounds, (2,)))


def test_what_is_taken_for_what() -> None:
    assert observations(MultiDiscrete([3, 4])).space == Discrete(12)
    assert observations(MultiDiscrete([3, 4]), "vector").space.shape == (7,)
    assert isinstance(observations(Box(0, 1, (2,))), Vectors)
    large = MultiBinary(40)
    assert isinstance(observations(large), Vectors)  # too many to count
    assert isinstance(actions(MultiDiscrete([2, 3])), Choices)
    assert isinstance(actions(Box(0, 1, (2,))), Scaled)
    for space, message in (
        (Box(0, 1, (2,)), "is not finite; see it as a vector"),
        (large, rf"has {2**40} values, at most {LARGEST}"),
    ):
        with pytest.raises(UserError, match=message):
            observations(space, "number")
    with pytest.raises(UserError, match=rf"has {2**40} values, at most {LARGEST}"):
        actions(large)


@pytest.mark.parametrize("space", [Text(4), Sequence(Discrete(2)), Dict(a=Text(3))], ids=str)
def test_values_of_different_sizes_are_refused(space: Space[Any]) -> None:
    with pytest.raises(UserError, match=r"values of different sizes.*TransformObservation"):
        observations(space)


def test_actions_of_several_kinds_are_refused() -> None:
    with pytest.raises(UserError, match=re.escape("Dict('a': Discrete(2))") + ".*TransformAction"):
        actions(Dict(a=Discrete(2)))


def test_a_problem_has_the_encoded_spaces() -> None:
    found = problem(observations(MultiDiscrete([3, 4])), actions(Box(0, 5, (2,))), 9, (1, 2))
    assert (found.states, found.actions, found.window, found.seeds) == (12, 2, 9, (1, 2))
    assert (found.finite_states, found.finite_actions, found.episodic) == (True, False, True)


def blocked(space: Space[Any]) -> Any:
    return concatenate(space, drawn(space), create_empty_array(space, R * K))  # type: ignore[arg-type]


@pytest.mark.parametrize("space", SPACES, ids=str)
def test_no_sample_lies_outside(space: Space[Any]) -> None:
    found = outside(space, blocked(space))
    assert (found is None) == isinstance(space, Box)
    assert found is None or found.tolist() == [False] * R * K


@pytest.mark.parametrize("wrong", [100, -100])
@pytest.mark.parametrize("space", FINITE, ids=str)
def test_what_lies_outside_is_found(space: Space[Any], wrong: int) -> None:
    values = blocked(space)
    values[3] = wrong
    assert not space.contains(values[3])
    for found in (outside(space, values), outside(Dict(a=Box(0, 1, ()), b=space), {"a": values, "b": values})):
        assert found is not None
        assert found.tolist() == [n == 3 for n in range(R * K)]
