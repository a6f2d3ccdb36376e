"""PointMaze as credit has it: from a start to a goal, one success bit for a whole trajectory (6.3)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar, Literal

import torch
from tensordict import TensorDictBase
from torch import Tensor

from credit.envs.pointmaze import minari
from credit.envs.pointmaze.collector import RoundCollector
from credit.envs.pointmaze.demonstrations import Demonstrations, describe, make
from credit.envs.pointmaze.env import PointMazeEnv
from credit.envs.pointmaze.geometry import Geometry
from credit.envs.pointmaze.maze import Cell, Maze
from credit.envs.pointmaze.oracle import MazeOracle
from credit.envs.pointmaze.task import Task
from credit.errors import UserError
from credit.interfaces import Act, Environment, Feedback
from credit.trajectories import ContinuousProblem, Moves, Trajectories
from credit.types import FLOAT, NonNegativeInt, Positive, PositiveInt

OBSERVATIONS, ACTIONS = 4, 2


class PointMaze(Environment):
    """A ball in a maze, fixed start and goal, at most H steps of .01 s; H is the feedback's window.

    Args:
        maze: UMaze, Open, Medium or Large, or a map of your own: rows of 1 (wall) and 0 (free).
        start: cell (row, column). goal: cell (row, column).
        successes: demonstrations that reach the goal. partials: that go part of the way. failures: that act at random.
        demonstrations_from: read them from here: a file that `Demonstrations.save` wrote, or a Minari dataset (its
            folder or name). null drives them anew, from each run's seed.
        one_sided: what to do if all demonstrations have the same label: `go_on` or `stop`.
        primitive: what an oracle is shown: `sparse` (1 at the goal) or `dense` (exp of minus the distance to it).
        evaluation_episodes: episodes of each evaluation, of each policy.
        cap: the longest way (m) to a wall that features tell apart.
        poison: NaN for the primitive reward wherever a learner could read it.
    """

    domain: ClassVar = "continuous"
    setting: ClassVar = "episodic"

    def __init__(
        self,
        maze: str | Sequence[str] = "Medium",
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
        poison: bool = False,
    ) -> None:
        self.maze = Maze.of(maze)
        self.begin, self.goal = _cell("start", start), _cell("goal", goal)
        self.successes, self.partials, self.failures = successes, partials, failures
        self.demonstrations_from = demonstrations_from
        self.one_sided = one_sided
        self.primitive: Literal["sparse", "dense"] = primitive
        self.evaluation_episodes = evaluation_episodes
        self.cap = cap
        self.poison = poison

    @property
    def geometry(self) -> Geometry:
        """What a person knows about the maze, for feature maps."""
        return Geometry(self.maze, self.goal, self.cap)

    def task(self, horizon: int) -> Task:
        """From start to goal in at most H steps.

        Raises:
            UserError: start or goal in a wall, no path, a horizon that is too short.
        """
        return Task(self.maze, self.begin, self.goal, horizon)

    def problem(self, window: int, seeds: tuple[int, ...], device: Any) -> ContinuousProblem:
        """Four numbers in a state, two in an action; refuses a task that cannot be done."""
        self.task(window)
        return ContinuousProblem(OBSERVATIONS, ACTIONS, window, tuple(seeds), torch.device(device))

    def start(self, problem: ContinuousProblem) -> None:
        """Read the demonstrations, if they are read; put all balls at rest.

        Raises:
            UserError: demonstrations that cannot be read, or of one label where that is to stop the run.
        """
        self._problem, self._task = problem, self.task(problem.window)
        self._read = self._found() if self.demonstrations_from else None
        one_sided = self._read.one_sided if self._read else not (self.successes and self.partials + self.failures)
        if one_sided and self.one_sided == "stop":
            known = self._read or make(self._task, self.successes, self.partials, self.failures)
            raise UserError(f"env.one_sided=stop: {describe(known)} one_sided=go_on trains nevertheless")
        self._collectors: dict[int, _Collecting] = {}
        self.taken = problem.zeros()

    def demonstrations(self) -> Trajectories | None:
        """The labelled trajectories that all methods start from, without their primitive reward."""
        drawn = [self.demonstrations_of(seed) for seed in self._problem.seeds]
        if not len(drawn[0]):
            return None
        rows = torch.cat([one.rows() for one in drawn])
        counts = torch.tensor([len(one.states) for one in drawn])
        replica = torch.arange(len(drawn)).repeat_interleave(counts)
        labels = torch.stack([torch.from_numpy(one.labels).to(FLOAT) for one in drawn])
        return self._trajectories(rows, replica, rows["collector", "traj_ids"], labels)

    def demonstrations_of(self, seed: int) -> Demonstrations:
        """The demonstrations of one run."""
        return self._read or make(self._task, self.successes, self.partials, self.failures, seed)

    def collect(self, act: Act, feedback: Feedback, windows: int, steps: int) -> tuple[Trajectories, Tensor]:
        """Some whole trajectories of each replica, and their primitive rewards [N]; the feedback sees 1 at the goal."""
        replicas = self._problem.replicas
        if windows not in self._collectors:
            self._collectors[windows] = _Collecting(self, windows, f"environment {windows}")
        rows, ball = self._collectors[windows].round(act)
        replica, number = ball // windows, ball % windows
        before = torch.nn.functional.pad(torch.bincount(ball, minlength=replicas * windows).cumsum(0)[:-1], (1, 0))
        at_goal = torch.zeros(replicas, windows, steps, dtype=FLOAT)
        at_goal[replica, number, torch.arange(len(ball)) - before[ball]] = rows["next", "success"][:, 0].to(FLOAT)
        self.taken += torch.bincount(replica, minlength=replicas).to(self.taken)
        primitive = rows["next", "reward"][:, 0].to(self._problem.device, FLOAT)
        primitive = primitive * torch.nan if self.poison else primitive
        return self._trajectories(rows, replica, number, feedback(at_goal.to(self._problem.device))), primitive

    def oracle(self, problem: ContinuousProblem, feedback: Feedback) -> MazeOracle:
        """Success of the policies in episodes of their own, with noise of their own."""
        return MazeOracle(problem, self.evaluation_episodes, self._evaluate, lambda: self.taken)

    def grid(self, per_cell: int = 4) -> Moves:
        """Balls at rest, per_cell² in each free cell, that do not push: where pictures look at a reward [N]."""
        offset = (torch.arange(per_cell) + 0.5) / per_cell - 0.5
        centres = torch.tensor([self.maze.xy(cell) for cell in self.maze.free])
        x, y = (
            centres[:, axis].view(-1, 1, 1) + offset.view(shape) for axis, shape in ((0, (1, 1, -1)), (1, (1, -1, 1)))
        )
        places = torch.stack(torch.broadcast_tensors(x, y), -1).view(-1, 2).float()
        states = torch.cat([places, torch.zeros_like(places)], 1).to(self._problem.device)
        still = torch.zeros_like(states[:, :ACTIONS])
        return Moves(states, still, states, torch.zeros(len(states), dtype=torch.int64, device=states.device))

    def env(self, copies: int, purpose: str) -> PointMazeEnv:
        """Balls that run rounds; their reward is the primitive one."""
        seeds = self._problem.seeds
        return PointMazeEnv(self._task, seeds, copies, episodes="round", reward=self.primitive, purpose=purpose)

    def _evaluate(self, act: Act, episodes: int) -> tuple[Tensor, Tensor]:
        """Success and length [R, episodes] of one round."""
        key = -episodes  # evaluation has balls of its own
        if key not in self._collectors:
            self._collectors[key] = _Collecting(self, episodes, "evaluation")
        rows, ball = self._collectors[key].round(act)
        shape, least = (self._problem.replicas, episodes), self._problem.replicas * episodes
        lengths = torch.bincount(ball, minlength=least).view(shape)
        success = torch.bincount(ball[rows["next", "success"][:, 0]], minlength=least).view(shape)
        return success.to(self.taken), lengths.to(self.taken)

    def _trajectories(self, rows: TensorDictBase, replica: Tensor, number: Tensor, labels: Tensor) -> Trajectories:
        rows = rows.to(self._problem.device)
        return Trajectories(
            states=rows["observation"],
            actions=rows["action"],
            next_states=rows["next", "observation"],
            replica=replica.to(labels.device),
            number=number.to(labels.device),
            final=rows["next", "done"][:, 0],
            terminated=rows["next", "terminated"][:, 0],
            labels=labels,
        )

    def _found(self) -> Demonstrations:
        source = str(self.demonstrations_from)
        if Path(source).suffix == ".npz":
            return Demonstrations.load(source)
        return minari.read(source, self._task)


class _Collecting:
    """A collector whose policy is a function of states and the step; it is another one in every round."""

    def __init__(self, maze: PointMaze, copies: int, purpose: str) -> None:
        self._collector = RoundCollector(maze.env(copies, purpose), self._policy)
        self._device = maze._problem.device

    def round(self, act: Act) -> tuple[TensorDictBase, Tensor]:
        """Rows [N], and which ball each belongs to."""
        self._act, self._step, first = act, 0, self._collector.next_id
        rows = self._collector.rollout()
        return rows, rows["collector", "traj_ids"] - first

    def _policy(self, tensordict: TensorDictBase) -> TensorDictBase:
        actions = self._act(tensordict["observation"].to(self._device), self._step)
        self._step += 1
        return tensordict.set("action", actions)


def _cell(key: str, cell: Sequence[int]) -> Cell:
    if len(cell) != 2:
        raise UserError(f"env.{key}={list(cell)}: a cell is a row and a column, [1, 1]")
    return int(cell[0]), int(cell[1])
