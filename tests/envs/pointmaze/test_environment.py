"""PointMaze as an environment: labels, primitive rewards, demonstrations, replicas, pictures, and what it refuses."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.windows import Windows
from credit.envs.collect import Collector
from credit.envs.feedback import BlockSum, Success
from credit.envs.pointmaze.demonstrations import Demonstrations, make
from credit.envs.pointmaze.environment import PointMaze
from credit.envs.pointmaze.task import RADIUS, Task
from credit.judges import judge

from ..collecting import Follow, begun

CORRIDOR = ["11111", "10001", "11111"]


def maze(**keys: Any) -> PointMaze:
    """Three free cells in a row, and few demonstrations."""
    few: dict[str, Any] = {"maze": CORRIDOR, "start": [1, 1], "goal": [1, 3], "evaluation_episodes": 2}
    return PointMaze(**(few | {"successes": 2, "partials": 1, "failures": 1} | keys))


def started(seeds: Sequence[int] = (0,), window: int = 80, **keys: Any) -> tuple[PointMaze, Collector, Problem]:
    env = maze(**keys)
    return env, *begun(env, Success(window), tuple(seeds))


def pushing(*strengths: float) -> Follow:
    """To the right, with a strength for each replica, and a little up and down."""

    def act(states: Tensor, step: Tensor) -> Tensor:
        right = torch.tensor(strengths).unsqueeze(1).expand(step.shape)
        return torch.stack([right, 0.1 * (-1.0) ** step], -1)

    return Follow(act)


def of(found: Windows, values: Tensor, replica: int, number: int) -> Tensor:
    """The rows of one trajectory."""
    last = found.ends[replica, number]
    return values[replica, last + 1 - found.lengths[replica, number] : last + 1]


def test_labels_say_whether_the_goal_was_reached() -> None:
    _, collector, _ = started((4, 5))
    found, primitive = collector.collect(pushing(1.0, 0.0), 3)
    assert found.labels.tolist() == [[1, 1, 1], [0, 0, 0]]
    assert found.labels.dtype == primitive.dtype == torch.float64
    assert (found.lengths[0] < 70).all()
    assert found.lengths[1].tolist() == [80, 80, 80]
    assert found.count is not None
    assert found.count.tolist() == found.lengths.sum(1).tolist()
    assert primitive.shape == found.states.shape[:2] == (2, 240)
    assert found.primitive is None
    assert torch.equal(found.sums(primitive), found.labels)
    assert found.terminated is not None
    assert torch.equal(primitive > 0, found.terminated)


def test_rows_are_whole_trajectories_of_the_replicas() -> None:
    _, collector, _ = started((4, 5))
    found, _ = collector.collect(pushing(0.9, 0.5), 2)
    assert found.ended is not None
    assert found.valid is not None
    assert (found.states[~found.valid] == 0).all()
    for r in range(2):
        for k in range(2):
            states, arrivals = of(found, found.states, r, k), of(found, found.next_states, r, k)
            assert torch.equal(states[1:], arrivals[:-1])
            assert ((states[0] - torch.tensor([-1.0, 0, 0, 0])).abs() <= 0.25).all()
            assert (states[0, 2:] == 0).all()
            assert of(found, found.ended, r, k).nonzero().tolist() == [[len(states) - 1]]
            assert of(found, found.times, r, k).tolist() == list(range(len(states)))
            assert of(found, found.actions, r, k)[:, 0].unique().tolist() == pytest.approx([(0.9, 0.5)[r]])


def test_dense_primitive_rewards_show_the_distance() -> None:
    (env, dense, _), (_, sparse, _) = started(primitive="dense"), started()
    found, primitive = dense.collect(pushing(1.0), 2)
    same, _ = sparse.collect(pushing(1.0), 2)
    assert torch.equal(found.states, same.states)
    assert torch.equal(found.labels, same.labels)  # the label is the same bit
    goal = torch.tensor(env.maze.xy((1, 3)))
    distance = -primitive.log()  # to the goal as it was moved, ±.25 on both axes
    assert ((distance - (found.next_states[..., :2] - goal).norm(dim=-1)).abs() <= 0.25 * 2**0.5 + 1e-5).all()
    for k in range(2):
        path = of(found, distance, 0, k)
        assert path[-1] <= RADIUS < path[:-1].min()


def test_a_ball_that_arrives_with_its_last_step_does_both() -> None:
    def ends(horizon: int) -> list[tuple[bool, bool]]:
        env, _, problem = started((3,), horizon)
        env.start(problem)
        env.reset()
        found = [env.step(torch.tensor([[[1.0, 0.0]]])) for _ in range(horizon)]
        return [(bool(step.terminated), bool(step.truncated)) for step in found]

    steps = 1 + ends(80).index((True, False))
    assert ends(steps) == [(False, False)] * (steps - 1) + [(True, True)]
    assert ends(steps - 1) == [(False, False)] * (steps - 2) + [(False, True)]


@pytest.mark.parametrize("windows", [1, 3])
def test_a_replica_depends_neither_on_the_others_nor_on_how_long_they_last(windows: int) -> None:
    def played(seeds: Sequence[int], *strengths: float) -> list[Windows]:
        _, collector, _ = started(seeds)
        return [collector.collect(pushing(*strengths), windows)[0] for _ in range(2)]

    alone = played((7,), 0.8)
    for seeds, strengths in (((7, 2), (0.8, 1.0)), ((3, 7), (0.0, 0.8)), ((7, 8, 9), (0.8, 0.3, 0.0))):
        mine = seeds.index(7)
        for single, together in zip(alone, played(seeds, *strengths), strict=True):
            rows = slice(len(single))
            for name in ("states", "actions", "next_states", "step", "ended", "terminated"):
                assert torch.equal(getattr(single, name)[0], getattr(together, name)[mine, rows]), name
            assert torch.equal(single.lengths[0], together.lengths[mine])
            assert torch.equal(single.labels[0], together.labels[mine])
    assert not torch.equal(alone[0].states[0, 0], alone[1].states[0, 0])  # each round has noise of its own


def test_policies_see_the_states_of_all_balls_and_the_step() -> None:
    _, collector, _ = started((0, 1))
    seen: list[tuple[tuple[int, ...], int]] = []

    def act(states: Tensor, step: Tensor) -> Tensor:
        assert step.shape == (2, 3)
        seen.append((tuple(states.shape), int(step[0, 0])))
        return pushing(1.0, 0.0).act(states, step)

    for _ in range(2):
        seen.clear()
        collector.collect(Follow(act), 3)
        assert seen == [((2, 3, 4), step) for step in range(80)]


def test_a_noisy_sum_is_a_label_too() -> None:
    collector, _ = begun(maze(), BlockSum(80, noise=0.01))
    found, _ = collector.collect(pushing(1.0), 3)
    assert found.labels[0].tolist() == pytest.approx([1, 1, 1], abs=0.05)
    assert len(found.labels.unique()) == 3


def test_demonstrations_are_those_of_each_seed() -> None:
    env, _, _ = started((3, 8))
    demonstrations = env.demonstrations()
    assert demonstrations is not None
    found, primitive = demonstrations
    assert found.labels.tolist() == [[1, 1, 0, 0]] * 2
    for r, seed in enumerate((3, 8)):
        expected, own = make(env.task(80), 2, 1, 1, seed), slice(int(found.lengths[r].sum()))
        assert env.demonstrations_of(seed).digest == expected.digest
        for name in ("states", "actions", "next_states", "terminated"):
            assert torch.equal(getattr(found, name)[r, own], torch.from_numpy(getattr(expected, name))), name
        assert found.lengths[r].tolist() == expected.lengths.tolist()
        assert found.number[r, own].tolist() == np.repeat(range(4), expected.lengths).tolist()
    assert not torch.equal(found.states[0, 0], found.states[1, 0])
    assert found.primitive is None
    assert torch.equal(found.sums(primitive), found.labels)


def test_dense_primitive_rewards_of_demonstrations_are_by_the_nominal_goal() -> None:
    demonstrations = started(primitive="dense")[0].demonstrations()
    assert demonstrations is not None
    found, primitive = demonstrations
    far = ((found.next_states[..., 0].double() - 1) ** 2 + found.next_states[..., 1].double() ** 2).sqrt()
    torch.testing.assert_close(primitive, (-far).exp())


def test_there_need_not_be_demonstrations() -> None:
    env, collector, _ = started(successes=0, partials=0, failures=0)
    assert env.demonstrations() is None
    assert collector.collect(pushing(1.0), 1)[0].labels.tolist() == [[1]]


def test_demonstrations_from_a_file_are_the_same_for_every_seed(tmp_path: Path) -> None:
    given = make(maze().task(80), 1, 0, 2, seed=77)
    given.save(tmp_path / "mine.npz")
    env, _, _ = started((3, 8), demonstrations_from=str(tmp_path / "mine.npz"))
    found, _ = env.demonstrations()  # type: ignore[misc]
    assert found.labels.tolist() == [[1, 0, 0]] * 2
    for r, seed in enumerate((3, 8)):
        assert torch.equal(found.states[r], torch.from_numpy(given.states))
        assert env.demonstrations_of(seed).digest == given.digest


def test_a_file_of_longer_trajectories_is_refused(tmp_path: Path) -> None:
    make(maze().task(90), 1, 0, 1).save(tmp_path / "long.npz")
    with pytest.raises(UserError, match="episode 1 has 90 steps, and the horizon is 80"):
        started(demonstrations_from=str(tmp_path / "long.npz"))


def test_one_sided_demonstrations_are_remarked_upon() -> None:
    assert started()[0].remark() == ""
    assert "cannot learn where the goal is" in started(successes=0)[0].remark()


def test_a_file_without_demonstrations_is_believed(tmp_path: Path) -> None:
    Demonstrations.of([], []).save(tmp_path / "none.npz")
    env, _, _ = started(demonstrations_from=str(tmp_path / "none.npz"))
    assert env.demonstrations() is None
    with pytest.raises(UserError, match="There are no demonstrations"):
        started(demonstrations_from=str(tmp_path / "none.npz"), one_sided="stop")


@pytest.mark.parametrize(
    ("kinds", "what"),
    [
        ({"successes": 0}, "2 demonstrations, 0 of them successful .* cannot learn where the goal is"),
        ({"partials": 0, "failures": 0}, "2 demonstrations, 2 of them successful .* not which steps fail"),
        ({"successes": 0, "partials": 0, "failures": 0}, "There are no demonstrations"),
    ],
)
def test_one_sided_demonstrations_stop_where_that_is_asked_for(
    kinds: dict[str, int], what: str, tmp_path: Path
) -> None:
    assert (started(**kinds)[0].demonstrations() is None) == (len(kinds) == 3)
    with pytest.raises(UserError, match=rf"env\.one_sided=stop: {what}.* one_sided=go_on"):
        started(**kinds, one_sided="stop")
    make(maze().task(80), **({"successes": 2, "partials": 1, "failures": 1} | kinds)).save(tmp_path / "mine.npz")
    with pytest.raises(UserError, match=rf"env\.one_sided=stop: {what}"):
        started(demonstrations_from=str(tmp_path / "mine.npz"), one_sided="stop")
    started(one_sided="stop")


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"start": [0, 2]}, "start=(0, 2) is a wall of maze of your own; free cells are row 1: 1 2 3"),
        ({"goal": [2, 2]}, "goal=(2, 2) is a wall of maze of your own; free cells are row 1: 1 2 3"),
        ({"goal": [1, 9]}, "goal=(1, 9) is outside the 3 x 5 cells of maze of your own; free cells are row 1: 1 2 3"),
        ({"goal": [1, 1]}, "start=(1, 1) is the goal too"),
        ({"maze": ["11111", "10101", "11111"]}, "no path from start (1, 1) to goal (1, 3): only row 1: 1 can be"),
        ({"window": 9}, "horizon=9 is too short: the shortest path from (1, 1) to (1, 3) has 2 moves"),
    ],
)
def test_a_task_that_cannot_be_done_is_refused_before_anything_starts(keys: dict[str, Any], message: str) -> None:
    window = keys.get("window", 80)
    env = maze(**{key: value for key, value in keys.items() if key != "window"})
    with pytest.raises(UserError, match=re.escape(message)):
        env.problem(window, (0,), "cpu")


def test_a_horizon_in_which_nobody_can_show_the_way_is_refused_before_a_run() -> None:
    with pytest.raises(UserError, match="2 of 2 of kind success did not reach the goal in 50 attempts"):
        started(window=32)
    started(window=32, successes=0)


@pytest.mark.parametrize("key", ["start", "goal"])
@pytest.mark.parametrize("cell", [[1], [1, 2, 3], []])
def test_a_cell_is_a_row_and_a_column(key: str, cell: list[int]) -> None:
    with pytest.raises(UserError, match=re.escape(f"env.{key}={cell}: a cell is a row and a column")):
        maze(**{key: cell})


def test_what_cannot_be_read_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="there is no such file"):
        started(demonstrations_from=str(tmp_path / "none.npz"))
    with pytest.raises(UserError, match="unknown"):
        maze(maze="Mediun")


def test_the_grid_is_all_over_the_free_cells() -> None:
    env, _, _ = started()
    moves = env.grid(3)
    assert len(moves.states) == 27
    assert moves.states.shape == moves.next_states.shape == (27, 4)
    assert moves.actions.shape == (27, 2)
    assert moves.states.dtype == torch.float32
    x, y = moves.states[:, 0].tolist(), moves.states[:, 1].tolist()
    cells = [env.maze.cell(a, b) for a, b in zip(x, y, strict=True)]
    assert {cell: cells.count(cell) for cell in set(cells)} == dict.fromkeys(env.maze.free, 9)
    assert sorted(set(y)) == pytest.approx([-1 / 3, 0, 1 / 3])
    assert len(set(zip(x, y, strict=True))) == 27
    assert len(env.grid().states) == 48


def test_a_picture_has_the_demonstrations_and_the_last_evaluation() -> None:
    env, collector, problem = started((3, 8))
    found = judge(env, Success(80), problem, collector.evaluation)
    assert found.picture(0) == {}
    found.measure({"behaviour": pushing(0.0, 0.0), "other": pushing(1.0, 1.0)}, None)
    found.measure({"behaviour": pushing(1.0, 0.0), "other": pushing(1.0, 1.0)}, None)
    for replica, seed in enumerate((3, 8)):
        arrays = env.picture(replica) | found.picture(replica)
        assert arrays["maze/walls"].shape == (3, 5)
        assert arrays["maze/walls"].sum() == 12
        assert (arrays["maze/start"].tolist(), arrays["maze/goal"].tolist()) == ([1, 1], [1, 3])
        made = env.demonstrations_of(seed)
        assert np.array_equal(arrays["demonstrations/states"], made.states)
        assert arrays["demonstrations/lengths"].tolist() == made.lengths.tolist()
        assert arrays["demonstrations/labels"].tolist() == [1, 1, 0, 0]
        assert arrays["demonstrations/kinds"].tolist() == ["success", "success", "partial", "failure"]
        assert arrays["evaluation/labels"].tolist() == [1 - replica] * 2  # of the behaviour policy, the newest
        assert arrays["evaluation/states"].shape == (arrays["evaluation/lengths"].sum(), 4)
        assert arrays["evaluation/goals"].shape == (2, 2)
        assert (np.abs(arrays["evaluation/goals"] - (1, 0)) <= 0.25).all()


def test_a_task_is_that_of_the_keys() -> None:
    task = PointMaze().task(300)
    assert (task.maze.name, task.start, task.goal, task.horizon) == ("Medium", (1, 1), (6, 6), 300)
    assert task == Task(PointMaze("medium").maze, (1, 1), (6, 6), 300)
