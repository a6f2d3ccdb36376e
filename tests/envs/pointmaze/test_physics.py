"""Bit for bit the Gymnasium environment, over whole episodes that touch walls."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import gymnasium
import gymnasium_robotics
import numpy as np
import pytest

from credit.core.errors import RunError
from credit.envs.pointmaze.controllers import Controller
from credit.envs.pointmaze.maze import Cell, Maze
from credit.envs.pointmaze.physics import Balls, noise
from credit.envs.pointmaze.task import Task

gymnasium.register_envs(gymnasium_robotics)


def official(name: str, horizon: int) -> gymnasium.Env[Any, Any]:
    """The environment of Gymnasium-Robotics, episodic."""
    return gymnasium.make(f"PointMaze_{name}-v3", continuing_task=False, max_episode_steps=horizon, reset_target=False)


def actions(seed: int, steps: int) -> np.ndarray:
    """Forces held for 15 steps, beyond the limits now and then, float32 as a network gives them."""
    held = np.random.default_rng(seed).uniform(-1.5, 1.5, (-(-steps // 15), 2))
    return np.repeat(held, 15, axis=0)[:steps].astype(np.float32)


@pytest.mark.parametrize(
    ("name", "goal", "horizon"), [("Medium", (6, 6), 300), ("UMaze", (3, 1), 150), ("LargeDense", (7, 10), 200)]
)
def test_same_bits_as_gymnasium(name: str, goal: Cell, horizon: int) -> None:
    task = Task(Maze.of(name.removesuffix("Dense")), (1, 1), goal, horizon)
    options = {"reset_cell": np.array(task.start), "goal_cell": np.array(task.goal)}
    seeds = (0, 1, 2)
    environments = [official(name, horizon) for _ in seeds]
    balls = Balls(task, [np.random.default_rng(seed) for seed in seeds])
    contacts = 0
    for episode in range(2):  # the second continues the noise of the first
        balls.reset()
        forces = np.stack([actions(10 * seed + episode, horizon) for seed in seeds], axis=1)
        for i, environment in enumerate(environments):
            observed, info = environment.reset(seed=seeds[i] if episode == 0 else None, options=options)
            assert np.array_equal(observed["observation"], balls.states[i])
            assert np.array_equal(observed["desired_goal"], balls.goals[i])
            assert not info["success"]
        for t in range(horizon):
            balls.step(forces[t])
            for i, environment in enumerate(environments):
                observed, reward, terminated, truncated, _ = environment.step(forces[t, i])
                assert np.array_equal(observed["observation"], balls.states[i])
                dense = np.exp(-balls.distances[i])
                assert reward == (dense if name.endswith("Dense") else float(balls.reached[i]))
                assert terminated == balls.reached[i]
                assert truncated == (balls.elapsed[i] >= horizon)
                contacts += environment.unwrapped.data.ncon > 1  # type: ignore[attr-defined]
    assert contacts > horizon  # one contact is the floor


def test_same_bits_up_to_the_goal(medium: Task) -> None:
    path = Controller().drive(medium, [99], [np.random.default_rng(5)])[0]
    assert path.success
    environment = official("Medium", 300)
    observed, _ = environment.reset(seed=5, options={"reset_cell": np.array([1, 1]), "goal_cell": np.array([6, 6])})
    speeds = []
    for t, force in enumerate(path.actions):
        assert np.array_equal(observed["observation"].astype(np.float32), path.states[t])
        observed, reward, terminated, truncated, info = environment.step(force)
        speeds.append(np.abs(observed["observation"][2:]).max())
        assert (reward, terminated, info["success"]) == (
            (1, True, True) if t + 1 == len(path.actions) else (0, False, False)
        )
        assert not truncated
    assert np.array_equal(observed["observation"].astype(np.float32), path.states[-1])


def test_speed_is_clipped_as_in_gymnasium() -> None:
    task = Task(Maze.of(["1" * 14, "1" + "0" * 12 + "1", "1" * 14]), (1, 1), (1, 12), 300)
    environment = gymnasium.make(
        "PointMaze_UMaze-v3", maze_map=[[int(w) for w in row] for row in task.maze.walls], continuing_task=False
    )
    environment.reset(seed=3, options={"reset_cell": np.array(task.start), "goal_cell": np.array(task.goal)})
    balls = Balls(task, [np.random.default_rng(3)])
    balls.reset()
    fastest = 0.0
    for _ in range(260):  # all the way, and into the end wall
        observed, *_ = environment.step(np.array([1.0, 0.3]))
        balls.step([[1.0, 0.3]])
        assert np.array_equal(observed["observation"], balls.states[0])
        fastest = max(fastest, balls.states[0, 2])
    assert 5.2 < fastest < 5.25


def test_only_some_move_and_only_some_are_reset(medium: Task) -> None:
    balls = Balls(medium, [np.random.default_rng(seed) for seed in range(3)])
    balls.reset()
    before, goals = balls.states.copy(), balls.goals.copy()
    balls.step(np.ones((3, 2)), which=[0, 2])
    assert np.array_equal(balls.states[1], before[1])
    assert (balls.states[[0, 2], 2:] > 0).all()
    assert balls.elapsed.tolist() == [1, 0, 1]
    moved = balls.states.copy()
    balls.reset([2])
    assert np.array_equal(balls.states[:2], moved[:2])
    assert np.array_equal(balls.goals[:2], goals[:2])
    assert (balls.goals[2] != goals[2]).all()
    assert (balls.states[2, :2] != before[2, :2]).all()
    assert (balls.states[2, 2:] == 0).all()
    assert balls.elapsed.tolist() == [1, 0, 0]


def test_start_and_goal_move_by_a_quarter(medium: Task) -> None:
    balls = Balls(medium, [np.random.default_rng(seed) for seed in range(200)])
    balls.reset()
    for places, centre in ((balls.states[:, :2], (-2.5, 2.5)), (balls.goals, (2.5, -2.5))):
        away = places - np.array(centre)
        assert 0.23 < np.abs(away).max() < 0.25
        assert np.abs(away.mean(0)).max() < 0.05


def test_noise_is_of_its_own_for_seed_copy_and_purpose(medium: Task) -> None:
    def places(seeds: tuple[int, ...], copies: int, purpose: str = "environment") -> np.ndarray:
        balls = Balls(medium, noise(seeds, copies, purpose))
        balls.reset()
        return balls.states[:, :2]

    batch = places((0, 1), 2)
    assert len(np.unique(batch, axis=0)) == 4
    assert np.array_equal(batch[2:], places((1,), 2))
    assert np.array_equal(batch[::2], places((0, 1), 1))
    assert (places((0, 1), 2, "evaluation") != batch).all()


@pytest.mark.parametrize("twin", [copy.deepcopy, lambda balls: pickle.loads(pickle.dumps(balls))])
def test_a_copy_goes_on_like_the_original(medium: Task, twin: Callable[[Balls], Balls]) -> None:
    balls = Balls(medium, [np.random.default_rng(seed) for seed in range(3)])
    balls.reset()
    forces = np.stack([actions(seed, 200) for seed in range(3)], axis=1)
    for t in range(100):
        balls.step(forces[t])
    other = twin(balls)
    for t in range(100, 200):
        balls.step(forces[t])
        assert not np.array_equal(balls.states, other.states)
        other.step(forces[t])
        assert np.array_equal(balls.states, other.states)
        if t == 150:
            balls.reset([0])
            other.reset([0])


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_actions_must_be_finite(medium: Task, bad: float) -> None:
    balls = Balls(medium, [np.random.default_rng(seed) for seed in range(2)])
    balls.reset()
    if np.isinf(bad):
        balls.step([[0, 0], [bad, 0]])  # infinity is clipped like any force
        assert balls.states[1, 2] > 0
        return
    with pytest.raises(RunError, match=r"PointMaze 1 got the action \[nan, 0\.0\] in state \[-2\."):
        balls.step([[0, 0], [bad, 0]])
    assert balls.elapsed.tolist() == [0, 0]
