"""PointMaze as credit has it: from a start to a goal, one success bit for a whole trajectory (6.3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import torch
from tensordict import TensorDictBase
from torch import Tensor

from credit.core.errors import UserError
from credit.core.policy import Policy
from credit.core.problem import FLOAT, Problem
from credit.core.ranges import NonNegativeInt, Positive, PositiveInt
from credit.core.seams import Act, Environment, Episodes, Rollout
from credit.core.steps import Steps
from credit.core.store import Windows
from credit.envs.pointmaze import minari
from credit.envs.pointmaze.demonstrations import Demonstrations, describe, driven
from credit.envs.pointmaze.geometry import Geometry
from credit.envs.pointmaze.maze import Cell, Maze
from credit.envs.pointmaze.rounds import Round, Rounds, by_replica, packed
from credit.envs.pointmaze.task import Task

OBSERVATIONS, ACTIONS = 4, 2
PACE = 3.0  # m/s, of the moves in pictures
PARTS = ("states", "lengths", "labels")  # of trajectories in a picture


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

    observations: ClassVar = "vector"
    actions: ClassVar = "vector"
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
        """What a person knows about the maze."""
        return Geometry(self.maze, self.goal, self.cap)

    def knowledge(self) -> Geometry:
        """The map and its nominal goal, for feature maps."""
        return self.geometry

    def task(self, horizon: int) -> Task:
        """From start to goal in at most H steps.

        Raises:
            UserError: start or goal in a wall, no path, a horizon that is too short.
        """
        return Task(self.maze, self.begin, self.goal, horizon)

    def problem(self, window: int, seeds: tuple[int, ...], device: Any) -> Problem:
        """Four numbers in a state, two in an action; refuses a task that cannot be done."""
        self.task(window)
        return Problem.vectors(OBSERVATIONS, ACTIONS, window, tuple(seeds), device)

    def start(self, problem: Problem) -> None:
        """Read or drive the demonstrations; put all balls at rest.

        Raises:
            UserError: demonstrations that cannot be read or driven, or of one label where that is to stop the run.
        """
        self._problem, self._task = problem, self.task(problem.window)
        self._read = self._found() if self.demonstrations_from else None
        known = [self.demonstrations_of(seed) for seed in problem.seeds]  # now, since not every task can be shown
        if known[0].one_sided and self.one_sided == "stop":
            raise UserError(f"env.one_sided=stop: {describe(known[0])} one_sided=go_on trains nevertheless")
        self._rounds: dict[int, Rounds] = {}  # K → what collects K trajectories of each replica
        self._evaluation = Rounds(self._task, problem, self.evaluation_episodes, "evaluation")
        self._evaluated: Round | None = None

    def demonstrations(self) -> tuple[Windows, Tensor] | None:
        """The labelled trajectories that all methods start from, and their primitive rewards [R, n].

        Dense ones are by the nominal goal, since demonstrations do not say where theirs was.
        """
        drawn = [self.demonstrations_of(seed) for seed in self._problem.seeds]
        if not len(drawn[0]):
            return None
        rows: TensorDictBase = torch.cat([one.rows() for one in drawn])
        lengths = torch.stack([torch.from_numpy(one.lengths) for one in drawn])
        labels = torch.stack([torch.from_numpy(one.labels).to(FLOAT) for one in drawn])
        found = replace(packed(rows, lengths), labels=labels).to(self._problem.device)
        if self.primitive == "dense":
            distance = self.geometry.goal_distance(rows["next", "observation"])
            primitive = by_replica((-distance).exp(), lengths).to(self._problem.device)
        else:
            assert found.terminated is not None
            primitive = found.terminated.to(FLOAT)
        return found, self._hidden(primitive)

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

    def run(self, act: Act, windows: int, steps: int) -> Rollout:
        """Some whole trajectories of each replica; the feedback sees 1 at the goal."""
        taken, device = self._of(windows).run(act), self._problem.device
        rewards = taken.at_goal(steps).to(device)
        return Rollout(taken.windows.to(device), self._hidden(taken.primitive.to(device)), rewards)

    def evaluate(self, name: str, policy: Policy) -> Episodes:
        """One round of episodes with noise of their own; that of the behaviour policy is kept for pictures."""
        found = self._evaluation.run(policy)
        if name == "behaviour":
            self._evaluated = found
        return Episodes(found.success, found.lengths, found.success.to(FLOAT))

    def state_dict(self) -> dict[str, Any]:
        """Where the noise of the balls of every purpose stands: rounds start from the start."""
        rounds = {count: rounds.state_dict() for count, rounds in self._rounds.items()}
        return {"rounds": rounds, "evaluation": self._evaluation.state_dict()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on with that noise."""
        for count, rounds in state["rounds"].items():
            self._of(count).load_state_dict(rounds)
        self._evaluation.load_state_dict(state["evaluation"])

    def grid(self, per_cell: int = 4) -> Steps:
        """Where pictures look at a reward [N]: per_cell² places in each free cell from which the goal can be reached.

        At each the ball moves, and is pushed, towards the next cell of a shortest way. A ball at rest would look like
        what it is in the data: a trajectory that came so far and no further.
        """
        offset = (torch.arange(per_cell) + 0.5) / per_cell - 0.5
        within = torch.cartesian_prod(offset, offset)
        cells = [cell for cell in self.maze.free if self.maze.connects(cell, self.goal)]
        ahead = [self.maze.path(cell, self.goal)[:2][-1] for cell in cells]  # of the goal, the goal
        centres, targets = (torch.tensor([self.maze.xy(cell) for cell in part]).unsqueeze(1) for part in (cells, ahead))
        places = (centres + within).flatten(0, 1)
        ways = (targets - centres).expand(-1, len(within), -1).flatten(0, 1)
        ways = torch.where(
            ways.abs().sum(1, keepdim=True) > 0, ways, places.new_tensor(self.maze.xy(self.goal)) - places
        )
        actions = torch.nn.functional.normalize(ways)
        states = torch.cat([places, PACE * actions], dim=1).to(self._problem.device)
        return Steps(states, actions.to(states.device), states)

    def picture(self, replica: int) -> dict[str, np.ndarray]:
        """The maze, the demonstrations of a run, and its last evaluation.

        `maze/walls` [rows, columns], `maze/start`, `maze/goal` (row, column); `<part>/states` [n, 4], trajectory after
        trajectory, `<part>/lengths` and `<part>/labels` [K] of `demonstrations` and `evaluation`;
        `demonstrations/kinds` [K], `evaluation/goals` [K, 2] where the goals really were.
        """
        shown, last = self.demonstrations_of(self._problem.seeds[replica]), self._evaluated
        assert last is not None
        parts = {
            "demonstrations": (shown.states, shown.lengths, shown.labels),
            "evaluation": (
                last.states(replica).numpy(),
                last.lengths[replica].numpy(),
                last.success[replica].double().numpy(),
            ),
        }
        arrays = {"maze/walls": self.maze.grid, "maze/start": np.array(self.begin), "maze/goal": np.array(self.goal)}
        for part, columns in parts.items():
            arrays |= {f"{part}/{name}": column for name, column in zip(PARTS, columns, strict=True)}
        return arrays | {"demonstrations/kinds": shown.kinds, "evaluation/goals": last.goals[replica].numpy()}

    def _of(self, count: int) -> Rounds:
        """What collects so many trajectories of each replica."""
        if count not in self._rounds:
            purpose = f"environment, {count} at once"
            self._rounds[count] = Rounds(self._task, self._problem, count, purpose, self.primitive)
        return self._rounds[count]

    def _hidden(self, primitive: Tensor) -> Tensor:
        return torch.full_like(primitive, torch.nan) if self.poison else primitive

    def _found(self) -> Demonstrations:
        source = str(self.demonstrations_from)
        if Path(source).suffix == ".npz":
            found = Demonstrations.load(source)
            if (longest := max(found.lengths, default=0)) > self._task.horizon:
                raise UserError(
                    f"demonstrations {source}: one has {longest} steps, and the horizon is {self._task.horizon}; they "
                    "are of another task; give others, or a larger feedback.window"
                )
            return found
        return minari.read(source, self._task)


def _cell(key: str, cell: Sequence[int]) -> Cell:
    if len(cell) != 2:
        raise UserError(f"env.{key}={list(cell)}: a cell is a row and a column, [1, 1]")
    return int(cell[0]), int(cell[1])
