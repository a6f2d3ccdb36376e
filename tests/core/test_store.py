"""Windows as rows: what belongs to a window and what to a step, against loops; and a store in which rows stay."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import pytest
import torch
from torch import Tensor

from credit.core.errors import UserError
from credit.core.problem import FLOAT, Problem
from credit.core.store import ROWS, Store
from credit.core.windows import Windows

Make = Callable[..., Problem]
MakeWindows = Callable[..., Windows]
ROUNDS = [  # lengths [R][K] and labels [R][K] of three rounds of two replicas
    ([[3, 1], [2, 4]], [[1.0, 0.0], [0.0, 1.0]]),
    ([[2], [9]], [[-0.5], [0.25]]),
    ([[1, 1, 5], [7, 2, 1]], [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]),
]
LABELS = [[1.0, 0.0, -0.5, 1.0, 2.0, 3.0], [0.0, 1.0, 0.25, 4.0, 5.0, 6.0]]
LENGTHS = [[3, 1, 2, 1, 1, 5], [2, 4, 9, 7, 2, 1]]


@pytest.fixture
def rounds(make_trajectories: MakeWindows) -> list[Windows]:
    return [make_trajectories(lengths, labels, first=10 * i) for i, (lengths, labels) in enumerate(ROUNDS)]


def filled(problem: Problem, pieces: list[Windows], rows: int = 0) -> Store:
    store = Store(problem, rows)
    for piece in pieces:
        store.append(piece)
        assert store.new is piece
    return store


@pytest.fixture
def store(make_continuous: Make, rounds: list[Windows]) -> Store:
    return filled(make_continuous((0, 1)), rounds)


@pytest.fixture
def grids(make_problem: Make, make_windows: MakeWindows) -> list[Windows]:
    return [make_windows(make_problem((0, 1)), count, seed=count) for count in (1, 4, 2, 30)]


def own(column: Tensor, lengths: list[list[int]], replica: int) -> Tensor:
    """The rows of a replica that mean something."""
    return column[replica, : sum(lengths[replica])]


def test_what_windows_have_is_what_loops_find(rounds: list[Windows]) -> None:
    for windows, (lengths, labels) in zip(rounds, ROUNDS, strict=True):
        assert windows.lengths.tolist() == lengths
        assert len(windows) == max(map(sum, lengths))
        generator = torch.Generator().manual_seed(1)
        each = torch.randn(windows.states.shape[:2], dtype=FLOAT, generator=generator)
        expected, vectors = torch.zeros_like(windows.labels), torch.zeros(*windows.labels.shape, 4)
        spread = torch.zeros_like(each)
        for replica, number in ((r, k) for r in range(2) for k in range(len(labels[0]))):
            first = sum(lengths[replica][:number])
            for row in range(first, first + lengths[replica][number]):
                expected[replica, number] += each[replica, row]
                vectors[replica, number] += windows.states[replica, row]
                spread[replica, row] = labels[replica][number]
                assert windows.number[replica, row] == number
                assert windows.times[replica, row] == row - first
                last = row == first + lengths[replica][number] - 1
                assert bool(windows.final[replica, row]) == last
                assert windows.ended is not None
                assert windows.terminated is not None
                assert bool(windows.ended[replica, row]) == last
                assert bool(windows.terminated[replica, row]) == (last and labels[replica][number] > 0)
        torch.testing.assert_close(windows.sums(each), expected)
        torch.testing.assert_close(windows.sums(windows.states), vectors)
        assert torch.equal(windows.to_steps(windows.labels), spread)


def test_rows_that_mean_nothing_are_in_no_window(rounds: list[Windows]) -> None:
    windows = rounds[1]  # two rows beside nine
    assert windows.valid is not None
    assert windows.valid.sum(1).tolist() == [2, 9]
    assert windows.number.tolist() == [[0, 0] + [1] * 7, [0] * 9]
    assert windows.to_steps(windows.labels + 5).tolist() == [[4.5] * 2 + [0] * 7, [5.25] * 9]
    assert windows.sums(torch.ones(2, 9)).tolist() == [[2], [9]]
    assert rounds[0].valid is not None
    assert replace(rounds[0], count=None).valid is None


def test_windows_of_one_length_are_the_same_by_length_and_by_their_last_rows(grids: list[Windows]) -> None:
    even = grids[1]
    last = torch.arange(6, 28, 7).expand(2, 4)
    listed = replace(even, length=None, last=last, step=even.times)
    for name in ("ends", "lengths", "number", "final", "times"):
        assert torch.equal(getattr(even, name), getattr(listed, name)), name
    values = torch.randn(2, 28, 3, dtype=FLOAT, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(even.sums(values), listed.sums(values))
    assert torch.equal(even.to_steps(even.labels), listed.to_steps(even.labels))
    assert even.grid(values)[1, 2, 3].tolist() == values[1, 17].tolist()
    with pytest.raises(AssertionError, match="no grid"):
        listed.grid(values)


def test_windows_stay_in_order_while_the_store_grows(make_problem: Make, grids: list[Windows]) -> None:
    store = filled(make_problem((0, 1)), grids, 14)  # room for two; the rest has to grow
    assert len(store) == 37
    for name in ("states", "actions", "next_states", "labels"):
        expected = torch.cat([getattr(piece, name) for piece in grids], dim=1)
        assert torch.equal(getattr(store.windows, name), expected)
    assert store.windows.length == 7
    assert store.before.tolist() == [49, 49]  # rows before the last append


def test_a_grid_shares_memory_with_the_column(make_problem: Make, grids: list[Windows]) -> None:
    store = filled(make_problem((0, 1)), grids)
    windows = store.windows
    for name in ("states", "actions", "next_states"):
        column = getattr(windows, name)
        grid = windows.grid(column)
        assert grid.shape == (2, 37, 7)
        assert grid.data_ptr() == column.data_ptr() == store._columns[name].data_ptr()
        assert grid[1, 2, 3].data_ptr() == store._columns[name][1, 17].data_ptr()
    assert windows.labels.data_ptr() == store._labels.data_ptr()
    states = torch.zeros(2, 4, 7, dtype=torch.int64)
    assert Windows.of_grid(states, states, states, torch.zeros(2, 4)).states.data_ptr() == states.data_ptr()


def test_rows_of_an_append_follow_those_before(store: Store, rounds: list[Windows]) -> None:
    whole = store.windows
    assert len(store) == 6
    assert whole.labels.tolist() == LABELS
    assert whole.lengths.tolist() == LENGTHS
    assert whole.count is not None
    assert whole.count.tolist() == [sum(LENGTHS[0]), sum(LENGTHS[1])] == [13, 25]
    assert store.before.tolist() == [6, 15]
    assert whole.primitive is None
    for name in set(ROWS) - {"primitive"}:
        for replica in range(2):
            parts = [
                own(getattr(part, name), lengths, replica) for part, (lengths, _) in zip(rounds, ROUNDS, strict=True)
            ]
            assert torch.equal(own(getattr(whole, name), LENGTHS, replica), torch.cat(parts)), name


def test_numbers_go_on_and_those_of_the_newest_do_not(store: Store, rounds: list[Windows]) -> None:
    whole = store.windows
    for replica in range(2):
        first = 0
        for windows, before, (lengths, _) in zip(rounds, (0, 2, 3), ROUNDS, strict=True):
            stop = first + sum(lengths[replica])
            assert torch.equal(whole.number[replica, first:stop], own(windows.number, lengths, replica) + before)
            first = stop
        assert own(whole.number, LENGTHS, replica).bincount().tolist() == LENGTHS[replica]
        assert (whole.number[replica, first:] == 6).all()
    assert store.new.number.min() == 0


def test_all_windows_are_views(store: Store) -> None:
    first, second = store.windows, store.windows
    for name in (*set(ROWS) - {"primitive"}, "labels", "last"):
        assert getattr(first, name).data_ptr() == getattr(second, name).data_ptr(), name


def test_a_store_starts_empty(make_problem: Make) -> None:
    store = Store(make_problem((0, 1)))
    assert len(store) == 0
    assert store.before.tolist() == [0, 0]


@pytest.mark.parametrize("first", [True, False])
def test_a_round_without_windows_changes_nothing(
    make_problem: Make, make_continuous: Make, grids: list[Windows], rounds: list[Windows], first: bool
) -> None:
    for problem, piece in ((make_problem((0, 1)), grids[1]), (make_continuous((0, 1)), rounds[1])):
        none = nothing_like(piece)
        store = filled(problem, [none, piece] if first else [piece, none, none])
        assert len(store) == piece.labels.shape[1]
        assert len(store.new) == (len(piece) if first else 0)
        for name in ("states", "actions", "labels", "ends", "lengths", "number"):
            assert torch.equal(getattr(store.windows, name), getattr(piece, name)), name
        assert none.sums(torch.zeros(2, 0)).shape == none.to_steps(none.labels).shape == (2, 0)


def nothing_like(windows: Windows) -> Windows:
    """No windows, of the same columns."""
    parts = {field.name: getattr(windows, field.name) for field in fields(windows)}
    none: dict[str, Any] = {
        name: part[:, :0] if isinstance(part, Tensor) and part.dim() > 1 else part for name, part in parts.items()
    }
    return Windows(**none | {"count": None})


def test_a_store_comes_back_from_its_state(
    make_problem: Make, make_continuous: Make, grids: list[Windows], rounds: list[Windows]
) -> None:
    for problem, pieces in ((make_problem((0, 1)), grids), (make_continuous((0, 1)), rounds)):
        whole, half = filled(problem, pieces), filled(problem, pieces[:2])
        again = filled(problem, pieces[2:])  # what is there is forgotten
        again.load_state_dict(half.state_dict())
        for piece in pieces[2:]:
            again.append(piece)
        for name in ("states", "actions", "next_states", "labels", "ends", "number", "times"):
            assert torch.equal(getattr(again.windows, name), getattr(whole.windows, name)), name


def test_primitive_rewards_are_kept_where_they_were_shown(
    make_problem: Make, make_continuous: Make, grids: list[Windows], rounds: list[Windows]
) -> None:
    for problem, pieces in ((make_problem((0, 1)), grids), (make_continuous((0, 1)), rounds)):
        shown = [
            replace(piece, primitive=torch.randn(piece.states.shape[:2], dtype=FLOAT) + number)
            for number, piece in enumerate(pieces)
        ]
        kept = filled(problem, shown).windows.primitive
        assert kept is not None
        for replica in range(2):
            parts = [piece.primitive[replica][_rows(piece, replica)] for piece in shown]  # type: ignore[index]
            expected = torch.cat(parts)
            assert torch.equal(kept[replica, : len(expected)], expected)
        assert filled(problem, pieces).windows.primitive is None


def _rows(windows: Windows, replica: int) -> slice:
    return slice(None) if windows.count is None else slice(int(windows.count[replica]))


@pytest.mark.parametrize("first", [True, False])
def test_primitive_rewards_of_some_alone_are_refused(make_continuous: Make, rounds: list[Windows], first: bool) -> None:
    parts = [replace(rounds[0], primitive=torch.zeros(rounds[0].states.shape[:2], dtype=FLOAT)), rounds[1]]
    store = filled(make_continuous((0, 1)), [parts.pop(0 if first else 1)])
    with pytest.raises(ValueError, match=r"windows of one kind: .* and these have"):
        store.append(parts[0])
    assert len(store) == (2 if first else 1)


def test_windows_of_another_length_are_refused(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0, 1))
    store = filled(problem, [make_windows(problem, 3)])
    with pytest.raises(ValueError, match=r"with length 7, and these have .* with length 4"):
        store.append(make_windows(make_problem((0, 1), window=4), 3))


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("labels", float("nan"), r"window 2 of seed 8 has the label nan: labels are finite numbers"),
        ("labels", float("inf"), r"window 2 of seed 8 has the label inf"),
        ("actions", 3, r"row 2 of seed 8 has the action 3: actions are whole numbers from 0 to 2"),
        ("actions", -1, r"row 2 of seed 8 has the action -1"),
        ("states", 10, r"row 2 of seed 8 has the state 10: states are whole numbers from 0 to 9"),
        ("next_states", -2, r"row 2 of seed 8 has the next state -2: next states are whole numbers from 0 to 9"),
    ],
)
def test_what_is_not_of_the_problem_is_refused(
    make_problem: Make, make_windows: MakeWindows, column: str, value: float, message: str
) -> None:
    problem = make_problem((3, 8))
    windows = make_windows(problem, 5)
    getattr(windows, column)[1, 2] = value
    store = Store(problem)
    with pytest.raises(UserError, match=message):
        store.append(windows)
    assert len(store) == 0
    store.append(windows, checked=True)  # by whoever says so
    assert len(store) == 5


def test_vectors_that_are_not_of_the_problem_are_refused(make_continuous: Make, rounds: list[Windows]) -> None:
    problem, windows = make_continuous((3, 8)), rounds[1]
    states = windows.states.clone()
    states[0, 5, 1] = torch.nan  # behind the two rows that the first replica has
    Store(problem).append(replace(windows, states=states))
    states[1, 5, 1] = torch.nan
    with pytest.raises(UserError, match=r"row 5 of seed 8 has the state \[.*nan.*\]: states are finite numbers"):
        Store(problem).append(replace(windows, states=states))


def test_windows_of_another_shape_are_refused(
    make_problem: Make, make_continuous: Make, rounds: list[Windows], grids: list[Windows]
) -> None:
    vectors, tables, wide = make_continuous((0, 1)), make_problem((0, 1)), rounds[1]
    for problem, windows, message in (
        (make_problem((0, 1), window=9), wide, r"states have the shape \[2, 9, 4\], and here they must have \[2, 9\]"),
        (vectors, replace(wide, actions=wide.actions[..., :1]), r"actions .* \[2, 9, 1\], .* have \[2, 9, 2\]"),
        (make_problem((0, 1), window=6), grids[1], "a window has 7 steps, and in this problem one has at most 6"),
        (make_continuous((0, 1), window=8), wide, "a window has 9 steps, .* at most 8"),
        (tables, replace(grids[1], length=None), "neither their length nor their last rows"),
        (
            tables,
            replace(grids[1], labels=grids[1].labels[0]),
            r"labels have the shape \[4\], .* \[replicas, windows\]",
        ),
        (make_problem((0,)), grids[1], "windows of 2 replicas, and the problem has 1"),
        (tables, replace(grids[1], labels=grids[1].labels[:, :3]), "28 rows are not 3 windows of 7 steps"),
        (tables, replace(grids[1], actions=grids[1].actions.double()), r"actions are torch.float64.*whole numbers"),
        (vectors, replace(wide, last=torch.tensor([[2], [8]])), r"window 0 of seed 0 has the last row 2: .* within"),
        (vectors, replace(rounds[0], last=torch.tensor([[2, 2], [1, 5]])), r"window 1 of seed 0 .*at least one row"),
    ):
        with pytest.raises(UserError, match=message):
            Store(problem).append(windows)


def test_windows_elsewhere_are_the_same(rounds: list[Windows]) -> None:
    moved = rounds[0].to("cpu")
    for field in fields(moved):
        here, there = getattr(rounds[0], field.name), getattr(moved, field.name)
        assert torch.equal(here, there) if isinstance(here, Tensor) else here == there
