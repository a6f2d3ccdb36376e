"""The least number of steps, against the simulation and by hand."""

from __future__ import annotations

import re
from math import pi

import numpy as np
import pytest

from credit.core.errors import UserError
from credit.envs.pointmaze import task as facts
from credit.envs.pointmaze.controllers import Controller
from credit.envs.pointmaze.maze import Maze
from credit.envs.pointmaze.physics import Balls, model
from credit.envs.pointmaze.task import Task, clearance, fastest


class Luckiest:
    """The noise that brings start and goal as near as can be in a corridor that runs along +x."""

    def __init__(self) -> None:
        self.draws = iter((-facts.NOISE, 0.0, facts.NOISE, 0.0))  # goal x, y, start x, y

    def uniform(self, low: float, high: float) -> float:
        """The next of the four."""
        return next(self.draws)


def test_facts_are_those_of_the_simulated_ball() -> None:
    ball = model(Maze.of("UMaze"))
    assert ball.body("particle").mass[0] == pytest.approx(facts.MASS)
    assert pytest.approx(1000 * 4 / 3 * pi * 0.1**3) == facts.MASS
    assert ball.opt.timestep == facts.TIMESTEP
    assert ball.dof_damping.tolist() == [facts.DAMPING] * 2
    assert ball.actuator_gear[:, 0].tolist() == [facts.FORCE] * 2


@pytest.mark.parametrize("cells", [2, 3, 5, 12])
def test_least_steps_are_those_of_full_speed_through_a_corridor(cells: int) -> None:
    free = "0" * cells
    task = Task(Maze.of(["1" * (cells + 2), f"1{free}1", "1" * (cells + 2)]), (1, 1), (1, cells), 1000)
    balls = Balls(task, [Luckiest()])
    balls.reset()
    while not balls.reached[0]:
        balls.step([[1.0, 0.0]])
    assert balls.elapsed[0] == task.least_steps


def test_fastest_by_hand() -> None:
    # from rest 100 N on 4.19 kg: .2382 m/s and .0024 m in the first step, three times that after two
    assert fastest(0.00238) == 1
    assert fastest(0.0024) == 2
    assert fastest(0.00713) == 2
    assert fastest(0.0072) == 3
    # 100 m further at the top speed, 5 m/s and what one step adds: about .0523 m a step
    assert fastest(110.0) - fastest(10.0) == pytest.approx(100 / (0.05 + 1e-4 * 95 / facts.MASS), abs=1)
    assert fastest(-1.0) == 1


@pytest.mark.parametrize(
    ("rows", "goal", "length"),
    [
        (["11111", "10001", "11111"], (1, 3), 2),
        (["11111", "10001", "10001", "10001", "11111"], (3, 3), 2),  # diagonally across the open
        (["11111", "10001", "11101", "10001", "11111"], (3, 3), 3),  # 1.5 to the corner, 1 along the wall, .5
        (["11111", "10001", "11101", "10001", "11111"], (3, 1), 4),  # 1.5 + 1 + 1.5
        (["1111", "1011", "1001", "1111"], (2, 2), 1),  # round one corner
    ],
)
def test_clearance_by_hand(rows: list[str], goal: tuple[int, int], length: float) -> None:
    assert clearance(Maze.of(rows), (1, 1), goal) == length


def test_the_ball_does_not_fit_through_touching_walls() -> None:
    maze = Maze.of(["11111", "10011", "11001", "11111"])
    assert clearance(maze, (1, 1), (2, 3)) == 2
    pinched = Maze.of(["111111", "101001", "110101", "100001", "111111"])  # (1, 1) touches (2, 2) by a corner alone
    with pytest.raises(UserError, match="no path"):
        Task(pinched, (1, 1), (3, 4), 300)
    around = Maze.of(["11111", "10011", "10101", "10001", "11111"])  # (1, 2) touches (2, 3) by a corner alone
    assert clearance(around, (1, 2), (2, 3)) == 3  # round the wall in the middle; 1 through the corner


@pytest.mark.parametrize(("name", "goal"), [("UMaze", (3, 1)), ("Medium", (6, 6)), ("Large", (7, 10))])
def test_no_controller_is_faster(name: str, goal: tuple[int, int]) -> None:
    task = Task(Maze.of(name), (1, 1), goal, 800)
    fast = Controller(kp=60, kd=6, sigma=0, switch=0.6)
    paths = fast.drive(task, [len(task.path)] * 4, [np.random.default_rng(i) for i in range(4)])
    steps = min(len(path.actions) for path in paths if path.success)
    assert task.least_steps <= steps <= 2 * task.least_steps


def test_a_horizon_that_is_too_short() -> None:
    maze = Maze.of("Medium")
    least = Task(maze, (1, 1), (6, 6), 300).least_steps
    assert Task(maze, (1, 1), (6, 6), least).least_steps == least
    message = f"horizon={least - 1} is too short: the shortest path from (1, 1) to (6, 6) has 10 moves"
    with pytest.raises(UserError, match=re.escape(message) + f".* at least {least} steps"):
        Task(maze, (1, 1), (6, 6), least - 1)


def test_start_and_goal_must_differ() -> None:
    with pytest.raises(UserError, match=re.escape("start=(1, 1) is the goal too")):
        Task(Maze.of("Medium"), (1, 1), (1, 1), 300)
