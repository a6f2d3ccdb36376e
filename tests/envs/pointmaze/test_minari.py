"""Datasets that Minari wrote."""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path
from typing import Any

import gymnasium
import gymnasium_robotics
import numpy as np
import pytest

from credit.core.errors import UserError
from credit.envs.pointmaze.controllers import Controller
from credit.envs.pointmaze.controllers import Path as Driven
from credit.envs.pointmaze.demonstrations import recorded as read
from credit.envs.pointmaze.demonstrations import trimmed
from credit.envs.pointmaze.environment import PointMaze
from credit.envs.pointmaze.task import Task

from ...minari_datasets import written

pytest.importorskip("minari")
gymnasium.register_envs(gymnasium_robotics)
pytestmark = pytest.mark.filterwarnings("ignore:.*env.*:UserWarning")


def episode(states: np.ndarray, actions: np.ndarray, goal: tuple[float, float]) -> dict[str, Any]:
    """One in PointMaze's format."""
    desired = np.broadcast_to(np.array(goal), (len(states), 2))
    observed = {"observation": states, "achieved_goal": states[:, :2], "desired_goal": desired}
    return {"observations": {key: value.astype(np.float64) for key, value in observed.items()}, "actions": actions}


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    return tmp_path


def recorded(path: Driven, seed: int) -> dict[str, Any]:
    """What the Gymnasium environment showed of a trajectory, its own goal included."""
    env = gymnasium.make("PointMaze_Medium-v3", continuing_task=False, max_episode_steps=300)
    observed, _ = env.reset(seed=seed, options={"reset_cell": np.array([1, 1]), "goal_cell": np.array([6, 6])})
    seen = [observed, *(env.step(action)[0] for action in path.actions)]
    return {"observations": {key: np.stack([o[key] for o in seen]) for key in observed}, "actions": path.actions}


def test_a_dataset_by_folder_and_by_name(medium: Task, store: Path) -> None:
    paths = Controller().drive(medium, [10, 3, 10, 0], [np.random.default_rng(seed) for seed in range(4)])
    written("pointmaze/mine-v0", [recorded(path, seed) for seed, path in enumerate(paths)], "PointMaze_Medium-v3")
    for source in (store / "pointmaze" / "mine-v0", store / "pointmaze" / "mine-v0" / "data", "pointmaze/mine-v0"):
        found = read(source, medium)
        assert found.kinds.tolist() == ["unknown"] * 4
        assert found.labels.tolist() == [1, 0, 1, 0]
        assert found.lengths.tolist() == [len(path.actions) for path in paths]  # the goal's noise counts in both
        assert np.array_equal(found.states, np.concatenate([path.states[:-1] for path in paths]))
        assert np.array_equal(found.next_states, np.concatenate([path.states[1:] for path in paths]))
        assert np.array_equal(found.actions, np.concatenate([path.actions for path in paths]))
        assert np.flatnonzero(found.terminated).tolist() == (np.cumsum(found.lengths) - 1)[[0, 2]].tolist()
    assert read("pointmaze/mine-v0", medium, limit=2).labels.tolist() == [1, 0]


def test_an_environment_starts_from_them(medium: Task, store: Path) -> None:
    paths = Controller().drive(medium, [10, 3], [np.random.default_rng(seed) for seed in range(2)])
    written("pointmaze/mine-v0", [recorded(path, seed) for seed, path in enumerate(paths)], "PointMaze_Medium-v3")
    env = PointMaze(demonstrations_from="pointmaze/mine-v0", one_sided="stop")
    env.start(env.problem(300, (0, 5), "cpu"))
    demonstrations = env.demonstrations()
    assert demonstrations is not None
    found, primitive = demonstrations
    assert found.labels.tolist() == [[1, 0]] * 2
    assert found.lengths.tolist() == [[len(path.actions) for path in paths]] * 2
    assert found.sums(primitive).tolist() == [[1, 0]] * 2
    missing = PointMaze(demonstrations_from="pointmaze/none-v0")
    problem = missing.problem(300, (0,), "cpu")
    with pytest.raises(UserError, match="`minari download pointmaze/none-v0`"):
        missing.start(problem)


def test_one_odd_episode_is_named(medium: Task, store: Path) -> None:
    """Also what lies behind the first arrival, which is cut away, was recorded in that maze or not."""
    good = Controller().drive(medium, [2, 2], [np.random.default_rng(seed) for seed in range(2)])
    for place, value, said in (
        ((5, 0), np.nan, "step 5: the state is"),
        (slice(40, 45), 0.0, "step 39: the ball moves by"),
        ((slice(None), slice(0, 2)), 3.5, r"step 0: a wall is where the ball is, \[3.5, 3.5\] \(\d+ of \d+ are so\)"),
    ):
        states = [path.states.astype(np.float64) for path in good]
        states[1][place] = value
        parts = zip(states, good, strict=True)
        written("pointmaze/odd-v0", [episode(seen, path.actions, (2.5, -2.5)) for seen, path in parts])
        with pytest.raises(UserError, match=rf"demonstrations pointmaze/odd-v0: episode 1, {said}"):
            read("pointmaze/odd-v0", medium)
        shutil.rmtree(store / "pointmaze" / "odd-v0")


def test_cut_at_the_goal_and_at_the_horizon(corridor: Task) -> None:
    """A ball that moves .1 m a step from x = -1 through the goal at x = 1 and on."""
    states = np.zeros((101, 4))
    states[:, 0] = -1 + 0.1 * np.arange(101)
    actions = np.full((100, 2), 1.5)
    elsewhere = np.full((101, 2), -1.0)
    path = trimmed(states, elsewhere, actions, corridor)
    assert path.success
    assert len(path.actions) == 16  # -1 + 1.6 = .6 is within .45 of 1, the middle of the goal's cell
    assert (path.actions == 1).all()
    assert path.states.shape == (17, 4)
    own = np.broadcast_to(np.array([0.8, 0.0]), (101, 2))
    assert len(trimmed(states, own, actions, corridor).actions) == 14  # the episode's own goal in that cell: .4 of .8
    waiting = trimmed(np.broadcast_to(states[:1], (101, 4)), own, actions, corridor)
    assert not waiting.success
    assert len(waiting.actions) == corridor.horizon
    short = trimmed(states[:11], elsewhere[:11], actions[:10], corridor)
    assert not short.success
    assert len(short.actions) == 10


def test_datasets_that_cannot_be_read(medium: Task, store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UserError, match=re.escape("`minari download pointmaze/none-v0`")):
        read("pointmaze/none-v0", medium)
    (store / "empty").mkdir()
    with pytest.raises(UserError, match="empty"):
        read(store / "empty", medium)
    states, actions = np.zeros((4, 27)), np.zeros((3, 2))
    written("antmaze/x-v0", [episode(states, actions, (0.0, 0.0))])
    with pytest.raises(
        UserError, match=re.escape("episode 0 with 3 actions has no observations['observation'] of shape (4, 4)")
    ):
        read("antmaze/x-v0", medium)
    monkeypatch.setitem(sys.modules, "minari", None)
    with pytest.raises(UserError, match=re.escape("pip install 'minari[hdf5]'")):
        read("pointmaze/none-v0", medium)
