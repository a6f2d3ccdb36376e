"""Steps of any environment under any policy, as labelled windows: the one place where rewards meet the feedback."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import torch
from torch import Tensor

from credit.core.errors import RunError, UserError
from credit.core.policy import Policy
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Act, Agent, Environment, Evaluated, Evaluation, Feedback
from credit.core.state import Stateful
from credit.core.windows import Windows
from credit.envs.episodes import Track, World, first_states, joined, over, play, ticks
from credit.envs.rolling import Rolling


class Collector(Stateful):
    """Runs policies in an environment, and has the feedback label what they did.

    What it returns for learners holds no primitive reward; that comes apart, for the judge. Where all windows have T
    steps, `Windows.length` says so; else windows are episodes of any length, K of each replica in lock-step until all
    are over.

    Args:
        env: started. feedback: started. problem: what both were started with.

    Raises:
        UserError: a feedback that needs windows of T steps, and episodes that may end before; or many copies of a task
            that goes on for ever.

    Example:
        >>> windows, rewards = Collector(env, feedback, problem).collect(policy, 4)
    """

    def __init__(self, env: Environment, feedback: Feedback, problem: Problem) -> None:
        name = type(env).__name__
        if env.ends_early and feedback.whole:
            raise UserError(
                f"{type(feedback).__name__} reads the reward of a window's last step, and episodes of {name} may end "
                "before; choose another feedback, like block_sum, or say ends_early = False if they never do"
            )
        if not problem.episodic and (env.ends_early or (problem.even and env.copies != 1)):
            raise UserError(
                f"{name} goes on for ever and says copies={env.copies}, ends_early={env.ends_early}: such a task has "
                "one copy and never ends (copies = 1, ends_early = False); or make its problem episodic"
            )
        self._env, self._feedback, self._problem = env, feedback, problem
        self._worlds: dict[int, World] = {}  # K → K copies
        self._rolling: Rolling | None = None
        self.taken = 0  # steps of a replica in the last call of `roll`
        self.episodes = 0  # whole ones in all of them, of the replica that has the fewest

    def collect(self, policy: Act, windows: int, steps: int | None = None) -> tuple[Windows, Tensor]:
        """Some windows of each replica, and their primitive rewards [R, n].

        Args:
            policy: whom to follow. windows: K. steps: of each window, where they are to be cut short; T by default.

        Raises:
            RunError: an episode ended that cannot. UserError: the environment's tensors have other shapes.
        """
        if self._env.ends_early:
            return self._episodes(policy, windows, steps)
        return self._even(policy, windows, steps or self._problem.window)

    def roll(self, policy: Act, steps: int, episodes: int = 0) -> tuple[Windows, Tensor] | None:
        """So many steps of each replica, and the windows whose labels have come since, with primitive rewards [R, n].

        Args:
            policy: whom to follow. steps: of each replica. episodes: behind which no step is taken, an equal share by
                each copy; 0 for no such limit.

        Returns:
            None as long as a replica has no window at all.
        """
        if self._rolling is None:
            self._rolling = Rolling(self._env, self._feedback, self._problem)
        found = self._rolling.collect(policy, steps // (self._env.copies or 1), episodes // (self._env.copies or 1))
        self.taken, self.episodes = self._rolling.taken, self._rolling.episodes
        return found

    def evaluation(self, episodes: int) -> Apart:
        """Episodes of each replica with copies and random numbers of their own."""
        return Apart(self._env, self._problem, episodes)

    def state_dict(self) -> dict[str, Any]:
        """Where the copies are; those that the environment has itself only as far as it does not know."""
        return {
            "worlds": {
                count: {
                    "now": None if world.now is None or self._problem.episodic else world.now.cpu().clone(),
                    "env": None if world.env is self._env else world.env.state_dict(),
                }
                for count, world in self._worlds.items()
            },
            "rolling": None if self._rolling is None else self._rolling.state_dict(),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on from there."""
        for count, held in state["worlds"].items():
            world = self._world(count)
            world.now = None if held["now"] is None else held["now"].to(self._problem.device)
            if held["env"] is not None:
                world.env.load_state_dict(held["env"])
        if state.get("rolling") is not None:
            self._rolling = Rolling(self._env, self._feedback, self._problem)
            self._rolling.load_state_dict(state["rolling"])
            self.episodes = self._rolling.episodes

    def _even(self, policy: Act, windows: int, steps: int) -> tuple[Windows, Tensor]:
        """Windows of the same length: those of one copy follow each other, others run side by side."""
        if self._env.copies == 1:
            parts = [self._run(policy, self._world(1), windows, steps)]
        else:
            parts = [self._run(policy, self._world(count), 1, steps) for count in self._sizes(windows)]
        states, actions, arrivals, rewards, seen = (
            column[0] if len(column) == 1 else torch.cat(column, 1) for column in zip(*parts, strict=True)
        )
        labels = self._feedback(seen.unflatten(1, (windows, steps)))
        return Windows(states, actions, arrivals, labels=labels, length=steps), rewards

    def _run(self, policy: Act, world: World, windows: int, steps: int) -> tuple[Tensor, ...]:
        """Rows [R, windows·K·T, ...] of every column; what the hot path of tables is."""
        if (followed := self._follow(policy, world, windows, steps)) is not None:
            return followed
        track, act, reads = Track(), policy.act, self._feedback.reads
        step, episodic, now = world.env.step, self._problem.episodic, world.now
        clock = world.ticks[:steps]
        for _ in range(windows):
            if episodic or now is None:
                now = first_states(world, self._problem)
            for t, tick in enumerate(clock):
                action = act(now, tick)
                out = step(action)
                track.add(now, action, out)
                if reads is not None:
                    track.seen.append(out.facts.get(reads, out.rewards))
                if out.terminated is not None and t + 1 < steps and over(out).any():
                    raise RunError(
                        f"{type(world.env).__name__} ended an episode in step {t} of a window of {steps}, and says "
                        "that none does; let it say ends_early = True"
                    )
                now = out.states
        world.now = now
        columns = (track.states, track.actions, track.next_states, track.rewards, track.seen or track.rewards)
        one = windows > 1 or len(world.ticks[0][0]) == 1  # only one copy has several windows
        states, actions, arrivals, rewards, seen = (
            torch.cat(column, 1) if one else torch.stack(column, 2).flatten(1, 2) for column in columns
        )
        return states, actions, arrivals, rewards.to(FLOAT), seen.to(FLOAT)

    def _follow(self, policy: Act, world: World, windows: int, steps: int) -> tuple[Tensor, ...] | None:
        """The same rows from an environment that can follow a table for whole windows; None elsewhere."""
        whole = steps == self._problem.window and self._feedback.reads is None and not self._problem.episodic
        if not (whole and isinstance(policy, Agent) and world.env.follows):
            return None
        if not (speaks_for(policy, "table", "act") and speaks_for(world.env, "follow", "step", "_draw")):
            return None  # an heir does something else
        table = policy.table()
        if table is None:
            return None
        if world.now is None:
            first_states(world, self._problem)
        states, actions, arrivals, rewards = world.env.follow(table, windows)
        world.now, rewards = arrivals[:, -1:], rewards.to(FLOAT)
        return states, actions, arrivals, rewards, rewards

    def _episodes(self, policy: Act, windows: int, steps: int | None) -> tuple[Windows, Tensor]:
        """Episodes of any length."""
        found = [
            play(self._world(count), policy, self._problem, steps, self._feedback.reads)
            for count in self._sizes(windows)
        ]
        grid = joined(found)
        padded = torch.nn.functional.pad(grid.seen, (0, self._problem.window - grid.seen.shape[2]))
        return grid.windows(self._feedback.label(padded, grid.active.sum(2))), grid.rows(grid.rewards)

    def _sizes(self, windows: int) -> list[int]:
        """How many windows run side by side, one time after the other."""
        most = self._env.copies or windows
        return [min(most, windows - start) for start in range(0, windows, most)]

    def _world(self, count: int) -> World:
        if count not in self._worlds:
            env = self._env
            if env.copies != 1:
                env = env.twin()
                env.start(self._problem, count, f"environment, {count} at once")
            self._worlds[count] = World(env, ticks(self._problem, count))
        return self._worlds[count]


def speaks_for(part: object, quick: str, *slow: str) -> bool:
    """Whether a method stands for others: no class below the one that defines it defines one of them anew.

    Example:
        >>> class Mine(ValueIteration):
        ...     def act(self, states, step): ...
        >>> speaks_for(Mine(transition), "table", "act")
        False
    """
    for cls in type(part).__mro__:
        if quick in vars(cls):
            return True
        if any(name in vars(cls) for name in slow):
            return False
    return False


class Apart(Evaluation):
    """Episodes of copies of their own, with random numbers of their own.

    Args:
        env: of what. problem: seeds and sizes. episodes: K, of each replica.
    """

    keeps: ClassVar = ("_env",)

    def __init__(self, env: Environment, problem: Problem, episodes: int) -> None:
        self._problem, self._env = problem, env.twin()
        self._env.start(problem, episodes, "evaluation")
        self._ticks = ticks(problem, episodes)

    def __call__(self, policy: Policy) -> Evaluated:
        """One episode of each copy."""
        grid = play(World(self._env, self._ticks), policy, self._problem, facts=True)
        return Evaluated(grid.windows(grid.rewards.sum(2)), grid.rows(grid.rewards), grid.facts)
