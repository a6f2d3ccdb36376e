"""What a pseudo-reward is a table over, against loops over every value of every axis."""

from __future__ import annotations

from itertools import combinations, product

import pytest
import torch

from credit.core import cells as module
from credit.core.cells import ORDER, PAIRS, Axis, Cells
from credit.core.errors import UserError
from credit.core.problem import FLOAT, Problem
from credit.core.steps import Steps
from credit.core.windows import Windows

CPU = torch.device("cpu")
WINDOW, STATES, ACTIONS = 3, 4, 2
SIZES = {"step": WINDOW, "state": STATES, "action": ACTIONS, "next_state": STATES}
EVERY = [axes for count in range(5) for axes in combinations(ORDER, count)]
ALLOWED = [axes for axes in EVERY if "next_state" not in axes or not {"state", "action"} & set(axes)]
REFUSED = [axes for axes in EVERY if axes not in ALLOWED]
R_PAIR = torch.arange(STATES * ACTIONS, dtype=FLOAT).view(STATES, ACTIONS)
R_ARRIVAL = 100 + torch.arange(STATES, dtype=FLOAT)


def over(axes: tuple[Axis, ...]) -> Cells:
    return Cells.over(axes, WINDOW, STATES, ACTIONS)


def rows(axes: tuple[Axis, ...]) -> list[dict[str, int]]:
    """What every cell is a cell of, the last axis fastest."""
    return [dict(zip(axes, values, strict=True)) for values in product(*(range(SIZES[axis]) for axis in axes))]


def test_ten_selections_are_allowed() -> None:
    assert len(ALLOWED) == 10
    assert len(REFUSED) == 6


@pytest.mark.parametrize("axes", ALLOWED, ids="-".join)
def test_cells_are_numbered_row_by_row(axes: tuple[Axis, ...]) -> None:
    found = over(tuple(reversed(axes)))  # in whatever order somebody names them
    assert found.axes == axes
    assert found.sizes == tuple(SIZES[axis] for axis in axes)
    assert found.count == len(rows(axes))
    assert found.arrival == ("next_state" in axes)
    listed = found.steps(CPU)
    parts = {"step": listed.times, "state": listed.states, "action": listed.actions, "next_state": listed.next_states}
    for cell, row in enumerate(rows(axes)):
        assert {axis: int(values[cell]) for axis, values in parts.items()} == {**dict.fromkeys(ORDER, 0), **row}
    assert torch.equal(found.index(listed), torch.arange(found.count))


@pytest.mark.parametrize("axes", ALLOWED, ids="-".join)
def test_the_cell_of_every_step_of_a_window(axes: tuple[Axis, ...]) -> None:
    generator = torch.Generator().manual_seed(0)
    states, actions, arrivals = (torch.randint(n, (2, 5, WINDOW), generator=generator) for n in (STATES, ACTIONS, 4))
    windows = Windows.of_grid(states, actions, arrivals, torch.zeros(2, 5, dtype=FLOAT))
    index = windows.grid(over(axes).index(windows))
    assert index.shape == (2, 5, WINDOW)
    for replica, window, step in product(range(2), range(5), range(WINDOW)):
        at = replica, window, step
        taken = {"step": step, "state": states[at], "action": actions[at], "next_state": arrivals[at]}
        assert rows(axes)[index[at]] == {axis: int(taken[axis]) for axis in axes}


def test_steps_that_know_their_place_in_the_episode_are_counted_by_it() -> None:
    zeros = torch.zeros(1, 4, dtype=torch.int64)
    labels, last = torch.zeros(1, 2, dtype=FLOAT), torch.tensor([[0, 3]])
    windows = Windows(zeros, zeros, zeros + 1, step=torch.tensor([[2, 0, 1, 2]]), labels=labels, last=last)
    assert over(("step", "next_state")).index(windows).tolist() == [[9, 1, 5, 9]]  # 4·t + 1, of the episode


@pytest.mark.parametrize("axes", ALLOWED, ids="-".join)
def test_a_known_reward_as_a_table(axes: tuple[Axis, ...]) -> None:
    table = over(axes).known(R_PAIR, R_ARRIVAL)
    assert table.shape == (len(rows(axes)),)
    for value, row in zip(table.tolist(), rows(axes), strict=True):
        if "next_state" in row:
            assert value == 100 + row["next_state"]
        elif {"state", "action"} <= row.keys():
            assert value == ACTIONS * row["state"] + row["action"]
        else:
            assert value != value  # a table of s alone, or of a alone, cannot say r(s, a)
    if "next_state" in axes:
        assert over(axes).known(R_PAIR).isnan().all()  # nor can one of s' where r(s') is not known


@pytest.mark.parametrize("axes", ALLOWED, ids="-".join)
def test_what_a_planner_adds_at_a_step(axes: tuple[Axis, ...]) -> None:
    found = over(axes)
    values = torch.randn(2, found.count, dtype=FLOAT, generator=torch.Generator().manual_seed(1))
    numbers = {tuple(row.items()): cell for cell, row in enumerate(rows(axes))}
    for step in range(WINDOW):
        of_pair, of_arrival = found.at(values, step, (STATES, ACTIONS))
        assert torch.broadcast_shapes(of_pair.shape, (2, STATES, ACTIONS)) == (2, STATES, ACTIONS)
        total = of_pair.unsqueeze(-1) + of_arrival.view(-1, 1, 1, STATES)
        for s, a, then in product(range(STATES), range(ACTIONS), range(STATES)):
            taken = {"step": step, "state": s, "action": a, "next_state": then}
            cell = numbers[tuple((axis, taken[axis]) for axis in axes)]
            assert torch.equal(total.expand(2, STATES, ACTIONS, STATES)[:, s, a, then], values[:, cell])


@pytest.mark.parametrize("axes", REFUSED, ids="-".join)
def test_an_arrival_beside_a_pair_is_refused(axes: tuple[Axis, ...]) -> None:
    with pytest.raises(UserError, match=rf"look at {', '.join(axes)}: .*of \(s, a\) or of s'"):
        over(axes)


def test_too_many_cells_are_refused() -> None:
    assert module.LARGEST == 1_000_000
    assert Cells.over(PAIRS, 5, 1000, 1000).count == 1_000_000
    with pytest.raises(UserError, match=r"look at state, action: 1001000 cells, at most 1000000"):
        Cells.over(PAIRS, 5, 1001, 1000)
    with pytest.raises(UserError, match=r"look at step, state, action: 2000000 cells"):
        Cells.over(("step", *PAIRS), 2, 1000, 1000)


def test_the_cells_of_a_problem_are_its_pairs() -> None:
    assert Problem.finite(STATES, ACTIONS, WINDOW, (0,)).cells == over(PAIRS)


def test_steps_that_do_not_know_their_place_have_cells_without_it() -> None:
    steps = Steps(torch.tensor([3, 1]), torch.tensor([1, 0]), torch.tensor([0, 2]))
    assert over(PAIRS).index(steps).tolist() == [7, 2]
    with pytest.raises(ValueError, match=r"do not say where in the episode they are.*give `step`"):
        over(("step", *PAIRS)).index(steps)
