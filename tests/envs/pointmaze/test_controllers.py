"""The controllers, one ball at a time in a loop of scalars."""

from __future__ import annotations

import math

import numpy as np
import pytest

from credit.envs.pointmaze.controllers import Controller, Path
from credit.envs.pointmaze.physics import Balls
from credit.envs.pointmaze.task import Task


def naive(controller: Controller, task: Task, legs: int, seed: int) -> Path:
    """One ball, written out."""
    generator = np.random.default_rng(seed)
    balls = Balls(task, [generator])
    balls.reset()
    points = [task.maze.xy(cell) for cell in task.path[1:]]
    noise = generator.standard_normal((task.horizon, 2))
    held = generator.uniform(-1, 1, (math.ceil(task.horizon / controller.hold), 2))
    states, actions, passed, wandered = [balls.states[0].astype(np.float32)], [], 0, 0
    for t in range(task.horizon):
        x, y, vx, vy = balls.states[0]
        px, py = points[min(passed, len(points) - 1)]
        if passed >= legs < len(points):
            force = held[wandered // controller.hold]
            wandered += 1
        else:
            pull = (
                controller.kp * (px - x) - controller.kd * vx + controller.sigma * noise[t, 0],
                controller.kp * (py - y) - controller.kd * vy + controller.sigma * noise[t, 1],
            )
            force = np.array([min(max(f, -1.0), 1.0) for f in pull])
        actions.append(force.astype(np.float32))
        balls.step([actions[-1]])
        states.append(balls.states[0].astype(np.float32))
        if wandered == 0 and math.dist((balls.states[0, 0], balls.states[0, 1]), (px, py)) < controller.switch:
            passed += 1
        if balls.reached[0]:
            break
    return Path(np.array(states), np.array(actions), bool(balls.reached[0]))


@pytest.mark.parametrize(
    "controller", [Controller(), Controller(kp=9.0, kd=1.2, sigma=0.1, switch=0.3, hold=7)], ids=["default", "other"]
)
def test_side_by_side_as_one_by_one(medium: Task, controller: Controller) -> None:
    legs = [10, 0, 3, 8, 99]
    together = controller.drive(medium, legs, [np.random.default_rng(seed) for seed in range(5)])
    for seed, path in enumerate(together):
        alone = naive(controller, medium, legs[seed], seed)
        assert path.success == alone.success
        np.testing.assert_array_equal(path.states, alone.states)
        np.testing.assert_array_equal(path.actions, alone.actions)
    assert len({len(path.actions) for path in together}) > 2


def test_way_points_lead_to_the_goal_of_medium_in_about_219_steps(medium: Task) -> None:
    paths = Controller().drive(medium, [10] * 8, [np.random.default_rng(seed) for seed in range(8)])
    assert all(path.success for path in paths)
    assert 214 < np.mean([len(path.actions) for path in paths]) < 224


def test_a_random_ball_stays_within_the_limits(medium: Task) -> None:
    path = Controller().drive(medium, [0], [np.random.default_rng(0)])[0]
    assert path.states.shape == (301, 4)
    assert path.actions.shape == (300, 2)
    assert path.states.dtype == path.actions.dtype == np.float32
    held = path.actions.reshape(20, 15, 2)
    assert (held == held[:, :1]).all()
    assert np.abs(path.actions).max() <= 1
    assert len(np.unique(held[:, 0], axis=0)) == 20
