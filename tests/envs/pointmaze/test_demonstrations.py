"""The dataset that methods start from."""

from __future__ import annotations

import re
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from credit.core.errors import UserError
from credit.envs.pointmaze.demonstrations import Demonstrations, describe, make
from credit.envs.pointmaze.geometry import Geometry
from credit.envs.pointmaze.maze import Maze
from credit.envs.pointmaze.task import Task


@pytest.fixture(scope="module")
def made(medium: Task) -> Demonstrations:
    """The paper's thirty."""
    return make(medium)


def split(demonstrations: Demonstrations, values: np.ndarray) -> list[np.ndarray]:
    return np.split(values, np.cumsum(demonstrations.lengths)[:-1])


def test_the_thirty_of_the_paper(medium: Task, made: Demonstrations) -> None:
    assert len(made) == 30
    assert made.kinds.tolist() == ["success"] * 10 + ["partial"] * 10 + ["failure"] * 10
    assert made.labels.tolist() == [1] * 10 + [0] * 20
    assert (made.lengths[10:] == medium.horizon).all()
    assert ((made.lengths[:10] > 200) & (made.lengths[:10] < 240)).all()
    for states, arrivals, ended, label in zip(
        *(split(made, values) for values in (made.states, made.next_states, made.terminated)), made.labels, strict=True
    ):
        assert np.array_equal(states[1:], arrivals[:-1])
        assert np.abs(states[0, :2] - (-2.5, 2.5)).max() <= 0.25
        assert not ended[:-1].any()
        assert ended[-1] == label
        near = np.linalg.norm(arrivals[-1, :2] - (2.5, -2.5)) < 0.45 + 0.36
        assert near or not label


def test_partial_ones_get_further_than_failures(medium: Task, made: Demonstrations) -> None:
    geometry = Geometry(medium.maze, medium.goal)
    cells = [set(part) for part in split(made, geometry.cells(torch.from_numpy(made.next_states)).numpy())]
    along = [medium.maze.free.index(cell) for cell in medium.path]
    furthest = [max(i for i, cell in enumerate(along) if cell in visited) for visited in cells]
    assert min(furthest[:10]) >= 9  # a goal moved towards its neighbour can be reached from there
    assert min(furthest[10:20]) >= 2
    assert len(set(furthest[10:20])) > 2  # legs are drawn
    assert np.mean(furthest[20:]) < np.mean(furthest[10:20]) < 10


def test_one_depends_on_its_seed_kind_and_number_alone(medium: Task, made: Demonstrations) -> None:
    few = make(medium, successes=2, partials=3, failures=1)
    states, expected = split(few, few.states), split(made, made.states)
    for part, j in zip(states, (0, 1, 10, 11, 12, 20), strict=True):
        assert np.array_equal(part, expected[j])
    other = make(medium, successes=1, partials=0, failures=0, seed=1)
    assert not np.array_equal(other.states[0], made.states[0])


def test_digest(medium: Task, made: Demonstrations) -> None:
    assert make(medium).digest == made.digest
    assert re.fullmatch("[0-9a-f]{64}", made.digest)
    digests = {made.digest, make(medium, failures=9).digest, make(medium, seed=1).digest}
    for field in fields(made):
        values = getattr(made, field.name).copy()
        values[-1] = "partial" if field.name == "kinds" else 1 - values[-1].astype(int)
        digests.add(replace(made, **{field.name: values}).digest)
    assert len(digests) == 3 + len(fields(made))
    swapped = replace(made, states=made.states.astype(">f4"), actions=np.asfortranarray(made.actions))
    assert swapped.digest == made.digest  # neither the machine's byte order nor the memory layout counts


def test_save_and_load(made: Demonstrations, tmp_path: Path) -> None:
    made.save(tmp_path / "demonstrations.npz")
    read = Demonstrations.load(tmp_path / "demonstrations.npz")
    assert read.digest == made.digest
    for field in fields(made):
        assert getattr(read, field.name).dtype == getattr(made, field.name).dtype


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="there is no such file"):
        Demonstrations.load(tmp_path / "missing.npz")
    np.savez(tmp_path / "other.npz", states=np.zeros(3))
    with pytest.raises(UserError, match=r"cannot be read .*actions.*expected \.npz with"):
        Demonstrations.load(tmp_path / "other.npz")
    (tmp_path / "text.npz").write_text("not an archive")
    with pytest.raises(UserError, match="cannot be read"):
        Demonstrations.load(tmp_path / "text.npz")
    np.savez(tmp_path / "pickled.npz", states=np.array([{}], dtype=object))
    with pytest.raises(UserError, match="cannot be read"):
        Demonstrations.load(tmp_path / "pickled.npz")


def test_episodes_one_by_one(made: Demonstrations) -> None:
    episodes = made.episodes()
    assert [len(episode.actions) for episode in episodes] == made.lengths.tolist()
    assert [episode.terminated for episode in episodes] == [True] * 10 + [False] * 20
    assert all(torch.equal(episode.states[1:], episode.next_states[:-1]) for episode in episodes)
    assert torch.equal(torch.cat([episode.actions for episode in episodes]), torch.from_numpy(made.actions))


def test_what_reward_models_can_learn(medium: Task, made: Demonstrations) -> None:
    assert not made.one_sided
    assert describe(made).startswith("30 demonstrations, 10 of them successful (")
    assert describe(made).endswith("reward models can learn what sets successful trajectories apart from the others.")
    failed = make(medium, successes=0, partials=1, failures=1)
    assert failed.one_sided
    assert "all labels are 0" in describe(failed)
    assert "cannot learn where the goal is" in describe(failed)
    succeeded = make(medium, successes=2, partials=0, failures=0)
    assert succeeded.one_sided
    assert "all labels are 1" in describe(succeeded)
    empty = make(medium, 0, 0, 0)
    assert empty.one_sided
    assert "There are no demonstrations" in describe(empty)
    assert (len(empty), empty.states.shape, empty.episodes()) == (0, (0, 4), [])


def test_demonstrations_that_cannot_be_had(corridor: Task) -> None:
    tight = Task(corridor.maze, corridor.start, corridor.goal, corridor.least_steps)
    with pytest.raises(UserError, match=r"2 of 2 of kind success did not reach the goal in 50 attempts .*horizon="):
        make(tight, successes=2)
    easy = Task(Maze.of(["1111", "1001", "1111"]), (1, 1), (1, 2), 5000)
    with pytest.raises(UserError, match="of kind failure reached the goal by chance"):
        make(easy, successes=0, partials=0, failures=1)
