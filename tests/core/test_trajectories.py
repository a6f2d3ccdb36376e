"""Trajectories as rows: what belongs to a trajectory and what to a step, against loops; and rows that stay in place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace

import pytest
import torch

from credit.core.trajectories import ContinuousProblem, Trajectories, TrajectoryDataset

Make = Callable[..., Trajectories]
ROUNDS = [  # lengths [R][K] and labels [R][K] of three rounds of two replicas
    ([[3, 1], [2, 4]], [[1.0, 0.0], [0.0, 1.0]]),
    ([[2], [9]], [[-0.5], [0.25]]),
    ([[1, 1, 5], [7, 2, 1]], [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]),
]
LABELS = [[1.0, 0.0, -0.5, 1.0, 2.0, 3.0], [0.0, 1.0, 0.25, 4.0, 5.0, 6.0]]
LENGTHS = [[3, 1, 2, 1, 1, 5], [2, 4, 9, 7, 2, 1]]


@pytest.fixture
def rounds(make_trajectories: Make) -> list[Trajectories]:
    return [make_trajectories(lengths, labels, first=10 * i) for i, (lengths, labels) in enumerate(ROUNDS)]


@pytest.fixture
def dataset(make_continuous: Callable[..., ContinuousProblem], rounds: list[Trajectories]) -> TrajectoryDataset:
    dataset = TrajectoryDataset(make_continuous((0, 1)))
    for trajectories in rounds:
        dataset.append(trajectories)
    return dataset


def test_lengths_and_sums_are_those_of_loops(rounds: list[Trajectories]) -> None:
    for trajectories, (lengths, labels) in zip(rounds, ROUNDS, strict=True):
        assert trajectories.lengths.tolist() == lengths
        assert trajectories.lengths.dtype == torch.float64
        scalar, vector = torch.arange(float(len(trajectories))), trajectories.states
        for values in (scalar, vector):
            expected = torch.zeros(2, len(labels[0]), *values.shape[1:])
            for row, (r, k) in enumerate(zip(trajectories.replica, trajectories.number, strict=True)):
                expected[r, k] += values[row]
            torch.testing.assert_close(trajectories.sums(values), expected)


def test_what_a_trajectory_has_at_each_of_its_steps(rounds: list[Trajectories]) -> None:
    assert rounds[0].to_steps(rounds[0].labels).tolist() == [1, 1, 1, 0, 0, 0, 1, 1, 1, 1]
    pairs = torch.stack([rounds[0].labels, rounds[0].lengths], -1)
    assert rounds[0].to_steps(pairs)[[0, 3, 4, 9]].tolist() == [[1, 3], [0, 1], [0, 2], [1, 4]]


def test_rows_in_any_order_have_the_same_sums(dataset: TrajectoryDataset) -> None:
    whole = dataset.windows
    order = torch.randperm(len(whole), generator=torch.Generator().manual_seed(0))
    names = [field.name for field in fields(whole) if field.name not in ("labels", "primitive")]
    mixed = replace(whole, **{name: getattr(whole, name)[order] for name in names})
    assert torch.equal(mixed.lengths, whole.lengths)
    torch.testing.assert_close(mixed.sums(mixed.states), whole.sums(whole.states))


def test_rows_of_an_append_follow_those_before(dataset: TrajectoryDataset, rounds: list[Trajectories]) -> None:
    whole = dataset.windows
    assert len(dataset) == 6
    assert len(whole) == sum(len(trajectories) for trajectories in rounds) == 38
    for name in set(TrajectoryDataset.COLUMNS) - {"number"}:
        assert torch.equal(getattr(whole, name), torch.cat([getattr(part, name) for part in rounds])), name
    assert whole.labels.tolist() == LABELS
    assert whole.lengths.tolist() == LENGTHS
    assert whole.primitive is None


def test_numbers_go_on_and_those_of_the_newest_do_not(dataset: TrajectoryDataset, rounds: list[Trajectories]) -> None:
    whole, start = dataset.windows, 0
    for trajectories, before in zip(rounds, (0, 2, 3), strict=True):
        stop = start + len(trajectories)
        assert torch.equal(whole.number[start:stop], trajectories.number + before)
        start = stop
    assert dataset.new is rounds[-1]
    assert dataset.new.number.min() == 0
    for r in range(2):
        for k in range(6):
            assert int(((whole.replica == r) & (whole.number == k) & whole.final).sum()) == 1


def test_all_trajectories_are_views(dataset: TrajectoryDataset) -> None:
    first, second = dataset.windows, dataset.windows
    for name in TrajectoryDataset.COLUMNS:
        assert getattr(first, name).data_ptr() == getattr(second, name).data_ptr(), name


def test_shown_primitive_rewards_are_kept(
    make_continuous: Callable[..., ContinuousProblem], rounds: list[Trajectories]
) -> None:
    dataset, shown = TrajectoryDataset(make_continuous((0, 1))), []
    for part in rounds:
        shown.append(torch.arange(len(part), dtype=torch.float64))
        dataset.append(replace(part, primitive=shown[-1]))
    assert dataset.windows.primitive is not None
    assert torch.equal(dataset.windows.primitive, torch.cat(shown))


@pytest.mark.parametrize("first", [True, False])
def test_primitive_rewards_of_some_alone_are_refused(
    make_continuous: Callable[..., ContinuousProblem], rounds: list[Trajectories], first: bool
) -> None:
    dataset = TrajectoryDataset(make_continuous((0, 1)))
    parts = [replace(rounds[0], primitive=torch.zeros(len(rounds[0]), dtype=torch.float64)), rounds[1]]
    dataset.append(parts.pop(0 if first else 1))
    with pytest.raises(ValueError, match="primitive rewards of all trajectories, or of none"):
        dataset.append(parts[0])
    assert len(dataset) == (2 if first else 1)
