"""PointMaze as credit has it: from a start to a goal, one success bit for a whole trajectory (6.3)."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from credit.core.errors import UserError
from credit.core.problem import FLOAT, Problem
from credit.core.ranges import NonNegativeInt, Positive, PositiveInt
from credit.core.seams import Environment, Transitions
from credit.core.state import pack, unpack
from credit.core.steps import Steps
from credit.core.windows import Windows
from credit.envs.pointmaze.demonstrations import Demonstrations, describe, driven, recorded
from credit.envs.pointmaze.geometry import MazeKnowledge
from credit.envs.pointmaze.maze import Cell, Maze, Row
from credit.envs.pointmaze.outside import in_walls, require
from credit.envs.pointmaze.physics import Balls, noise
from credit.envs.pointmaze.task import RADIUS, Task

OBSERVATIONS, ACTIONS = 4, 2
PACE = 3.0  # m/s, of the moves in pictures


class PointMaze(Environment):
    """A ball in a maze, fixed start and goal, at most H steps of .01 s; H is the feedback's window.

    Args:
        maze: UMaze, Open, Medium or Large, or a map of your own: rows of 1 (wall) and 0 (free).
        start: cell (row, column). goal: cell (row, column).
        successes: demonstrations that reach the goal. partials: that go part of the way. failures: that act at random.
        demonstrations_from: read them from here: a file that `Demonstrations.save` wrote, or a Minari dataset (its
            folder or name). null drives them anew, from each run's seed.
        one_sided: what to do if all demonstrations have the same label: `go_on` or `stop`.
        primitive: the reward: `sparse` (1 at the goal) or `dense` (exp of minus the distance to it).
        evaluation_episodes: episodes of each evaluation, of each policy.
        cap: the longest way (m) to a wall that features tell apart.
    """

    setting: ClassVar = "episodic"
    rolls: ClassVar = False
    names = ("x", "y", "vx", "vy")

    def __init__(
        self,
        maze: str | Sequence[Row] = "Medium",
        start: Sequence[int] = (1, 1),
        goal: Sequence[int] = (6, 6),
        successes: NonNegativeInt = 10,
        partials: NonNegativeInt = 10,
        failures: NonNegativeInt = 10,
        demonstrations_from: str | None = None,
        one_sided: Literal["go_on", "stop"] = "go_on",
        primitive: Literal["sparse", "dense"] = "sparse",
        evaluation_episodes: PositiveInt = 20,
        cap: Positive = 8.0,
    ) -> None:
        self.maze = Maze.of(maze)
        self.begin, self.goal = _cell("start", start), _cell("goal", goal)
        self.successes, self.partials, self.failures = successes, partials, failures
        self.demonstrations_from = demonstrations_from
        self.one_sided = one_sided
        self.primitive: Literal["sparse", "dense"] = primitive
        self.evaluation_episodes = evaluation_episodes
        self.cap = cap

    def knowledge(self) -> MazeKnowledge:
        """The map and the nominal goal."""
        return MazeKnowledge(self.maze, self.goal, self.cap)

    def task(self, horizon: int) -> Task:
        """From start to goal in at most H steps.

        Raises:
            UserError: start or goal in a wall, no path, a horizon that is too short.
        """
        return Task(self.maze, self.begin, self.goal, horizon)

    def problem(self, window: int, seeds: tuple[int, ...], device: torch.device | str) -> Problem:
        """Four numbers in a state, two in an action; refuses a task that cannot be done."""
        self.task(window)
        return Problem.vectors(OBSERVATIONS, ACTIONS, window, seeds, device)

    def start(self, problem: Problem, copies: int = 1, purpose: str = "environment") -> None:
        """Read or drive the demonstrations; put all balls at rest.

        Raises:
            UserError: demonstrations that cannot be read or driven, or of one label where that is to stop the run.
        """
        if getattr(self, "_problem", None) is not problem:  # a twin need not read again what its original has
            self._problem, self._task = problem, self.task(problem.window)
            self._read = self._found() if self.demonstrations_from else None
            known = [self.demonstrations_of(seed) for seed in problem.seeds]  # now: not every task can be shown
            if known[0].one_sided and self.one_sided == "stop":
                raise UserError(f"env.one_sided=stop: {describe(known[0])} one_sided=go_on trains nevertheless")
        self._shape = (problem.replicas, copies)
        self._balls = Balls(self._task, noise(problem.seeds, copies, purpose))
        self._balls.reset()  # where they lie before the first episode: it takes a draw of its own

    def twin(self) -> PointMaze:
        """Another, to be started: that makes new balls."""
        return copy.copy(self)

    def reset(self, mask: Tensor | None = None) -> Tensor:
        """Put balls back to the start, with new noise on goal and start."""
        self._balls.reset(None if mask is None else np.flatnonzero(mask.cpu().numpy()).tolist())
        self._goals = self._of_copies(self._balls.goals.copy())
        return self._of_copies(self._balls.states.astype(np.float32))

    def step(self, actions: Tensor, mask: Tensor | None = None) -> Transitions:
        """Push the balls of the mask; the facts are `success` [R, K] and `goals`, where they are [R, K, 2]."""
        balls = self._balls
        moved = None if mask is None else np.flatnonzero(mask.cpu().numpy()).tolist()
        balls.step(actions.cpu().numpy().reshape(-1, ACTIONS), moved)
        distances = balls.distances
        reached = distances <= RADIUS
        rewards = np.exp(-distances).astype(np.float32) if self.primitive == "dense" else reached
        success = self._of_copies(reached)
        return Transitions(
            self._of_copies(balls.states.astype(np.float32)),
            self._of_copies(rewards.astype(np.float64)),  # `dense` in single precision, as states are
            success,
            self._of_copies(balls.elapsed >= self._task.horizon),
            {"success": success, "goals": self._goals},
        )

    def state_dict(self) -> dict[str, Any]:
        """Where the noise of the balls stands: between two rounds every ball is to be reset."""
        return {"noise": pack(self._balls.noise, "noise")}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on with that noise."""
        unpack(state["noise"], self._balls.noise, "noise")

    def _of_copies(self, values: np.ndarray) -> Tensor:
        """Values [R·K, ...] of the balls as [R, K, ...] on the problem's device."""
        return torch.from_numpy(values.reshape(*self._shape, *values.shape[1:])).to(self._problem.device)

    def impossible(self, states: NDArray[np.floating[Any]]) -> NDArray[np.bool_]:
        """In walls, and outside."""
        return in_walls(states, self.maze)

    def demonstrations(self) -> tuple[Windows, Tensor] | None:
        """The labelled trajectories that all methods start from, and their primitive rewards [R, n].

        Dense ones are by the nominal goal, since demonstrations do not say where theirs was.
        """
        drawn = [self.demonstrations_of(seed) for seed in self._problem.seeds]
        if not len(drawn[0]):
            return None
        labels = torch.stack([torch.from_numpy(one.labels).to(FLOAT) for one in drawn])
        found = Windows.of_episodes([one.episodes() for one in drawn], labels.to(self._problem.device))
        if self.primitive == "sparse":
            assert found.terminated is not None
            return found, found.terminated.to(FLOAT)
        near = (-self.knowledge().geometry.goal_distance(found.next_states)).exp()
        return found, near if found.valid is None else near * found.valid

    def demonstrations_of(self, seed: int) -> Demonstrations:
        """The demonstrations of one run."""
        if self._read is not None:
            return self._read
        return driven(self._task, self.successes, self.partials, self.failures, seed)

    def remark(self) -> str:
        """What reward models can learn from demonstrations of one kind."""
        known = self.demonstrations_of(self._problem.seeds[0])
        return describe(known) if known.one_sided else ""

    def digests(self) -> dict[str, list[str]]:
        """SHA-256 of the demonstrations of each replica."""
        return {"demonstrations": [self.demonstrations_of(seed).digest for seed in self._problem.seeds]}

    def grid(self, per_cell: int = 4) -> Steps:
        """Where pictures look at a reward [N]: per_cell² places in each free cell from which the goal can be reached.

        At each the ball moves, and is pushed, towards the next cell of a shortest way. A ball at rest would look like
        what it is in the data: a trajectory that came so far and no further.
        """
        offset = (torch.arange(per_cell) + 0.5) / per_cell - 0.5
        within = torch.cartesian_prod(offset, offset)
        ahead = self.maze.ahead(self.goal)
        parts = (ahead.keys(), ahead.values())
        centres, targets = (torch.tensor([self.maze.xy(cell) for cell in part]).unsqueeze(1) for part in parts)
        places = (centres + within).flatten(0, 1)
        ways = (targets - centres).expand(-1, len(within), -1).flatten(0, 1)
        ways = torch.where(
            ways.abs().sum(1, keepdim=True) > 0, ways, places.new_tensor(self.maze.xy(self.goal)) - places
        )
        actions = torch.nn.functional.normalize(ways)
        states = torch.cat([places, PACE * actions], dim=1).to(self._problem.device)
        return Steps(states, actions.to(states.device), states)

    def picture(self, replica: int) -> dict[str, np.ndarray]:
        """The maze and the demonstrations of a run.

        `maze/walls` [rows, columns], `maze/start`, `maze/goal` (row, column); `demonstrations/states` [n, 4],
        trajectory after trajectory, `demonstrations/lengths`, `/labels` and `/kinds` [K].
        """
        shown = self.demonstrations_of(self._problem.seeds[replica])
        return {
            "maze/walls": self.maze.grid,
            "maze/start": np.array(self.begin),
            "maze/goal": np.array(self.goal),
            "demonstrations/states": shown.states,
            "demonstrations/lengths": shown.lengths,
            "demonstrations/labels": shown.labels,
            "demonstrations/kinds": shown.kinds,
        }

    def _found(self) -> Demonstrations:
        source = str(self.demonstrations_from)
        if Path(source).suffix == ".npz":
            found = Demonstrations.load(source)
            require(source, found, self._task)
            return found
        return recorded(source, self._task)


def _cell(key: str, cell: Sequence[int]) -> Cell:
    if len(cell) != 2:
        raise UserError(f"env.{key}={list(cell)}: a cell is a row and a column, [1, 1]")
    return int(cell[0]), int(cell[1])
