"""Steps of any environment under any policy, as labelled windows: the one place where rewards meet the feedback."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import torch
from torch import Tensor

from credit.core.errors import RunError, UserError
from credit.core.policy import Policy
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Act, Environment, Evaluated, Evaluation, Feedback, Transitions
from credit.core.state import Stateful
from credit.core.store import Windows


@dataclass
class World:
    """K copies of each replica, started.

    Attributes:
        env: them. ticks: the step in the window [R, K], for each of its T steps.
        now: the states that they are in [R, K, ...], None before the first episode.
    """

    env: Environment
    ticks: tuple[Tensor, ...]
    now: Tensor | None = None


@dataclass
class Track:
    """What K copies did in L steps: one tensor [R, K, ...] a step, then columns [R, K, L, ...]."""

    states: list[Tensor] = field(default_factory=list)
    actions: list[Tensor] = field(default_factory=list)
    next_states: list[Tensor] = field(default_factory=list)
    rewards: list[Tensor] = field(default_factory=list)
    seen: list[Tensor] = field(default_factory=list)  # what the feedback is shown, where that is not the reward

    def add(self, states: Tensor, actions: Tensor, out: Transitions) -> None:
        """One more step."""
        self.states.append(states)
        self.actions.append(actions)
        self.next_states.append(out.states)
        self.rewards.append(out.rewards)


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
        if not problem.episodic and (env.copies != 1 or env.ends_early):
            raise UserError(
                f"{name} goes on for ever and says copies={env.copies}, ends_early={env.ends_early}: such a task has "
                "one copy and never ends (copies = 1, ends_early = False); or make its problem episodic"
            )
        self._env, self._feedback, self._problem = env, feedback, problem
        self._worlds: dict[int, World] = {}  # K → K copies

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
            }
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on from there."""
        for count, held in state["worlds"].items():
            world = self._world(count)
            world.now = None if held["now"] is None else held["now"].to(self._problem.device)
            if held["env"] is not None:
                world.env.load_state_dict(held["env"])

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
        track, act, reads = Track(), policy.act, self._feedback.reads
        step, episodic, now = world.env.step, self._problem.episodic, world.now
        ticks = world.ticks[:steps]
        for _ in range(windows):
            if episodic or now is None:
                now = _states(world, self._problem)
            for t, tick in enumerate(ticks):
                action = act(now, tick)
                out = step(action)
                track.add(now, action, out)
                if reads is not None:
                    track.seen.append(out.facts.get(reads, out.rewards))
                if out.terminated is not None and t + 1 < steps and _over(out).any():
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

    def _episodes(self, policy: Act, windows: int, steps: int | None) -> tuple[Windows, Tensor]:
        """Episodes of any length."""
        found = [
            play(self._world(count), policy, self._problem, steps, self._feedback.reads)
            for count in self._sizes(windows)
        ]
        grid = joined(found)
        padded = torch.nn.functional.pad(grid.seen, (0, self._problem.window - grid.seen.shape[2]))
        return grid.windows(self._feedback(padded)), grid.rows(grid.rewards)

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
            self._worlds[count] = World(env, _ticks(self._problem, count))
        return self._worlds[count]


class Apart(Evaluation):
    """Episodes of copies of their own, with random numbers of their own.

    Args:
        env: of what. problem: seeds and sizes. episodes: K, of each replica.
    """

    keeps: ClassVar = ("_env",)

    def __init__(self, env: Environment, problem: Problem, episodes: int) -> None:
        self._problem, self._env = problem, env.twin()
        self._env.start(problem, episodes, "evaluation")
        self._ticks = _ticks(problem, episodes)

    def __call__(self, policy: Policy) -> Evaluated:
        """One episode of each copy."""
        grid = play(World(self._env, self._ticks), policy, self._problem, facts=True)
        return Evaluated(grid.windows(grid.rewards.sum(2)), grid.rows(grid.rewards), grid.facts)


@dataclass
class Grid:
    """Episodes of K copies, L steps at most.

    Attributes:
        states, actions, next_states: [R, K, L, ...]. active: whether a step was taken [R, K, L].
        rewards: r, 0 where it was not [R, K, L]. seen: what the feedback is shown, likewise.
        terminated: whether nothing lies behind a step [R, K, L]. facts: of the last step [R, K, ...].
    """

    states: Tensor
    actions: Tensor
    next_states: Tensor
    active: Tensor
    rewards: Tensor
    seen: Tensor
    terminated: Tensor
    facts: dict[str, Tensor]

    def rows(self, values: Tensor) -> Tensor:
        """Of values [R, K, L, ...] those of steps that were taken, episode after episode [R, n, ...]; 0 behind them."""
        count = self.active.sum((1, 2))
        most = int(count.max())
        flat = values[self.active]
        if bool((count == most).all()):
            return flat.unflatten(0, (-1, most))
        block = flat.new_zeros(len(count), most, *flat.shape[1:])
        block[torch.arange(most, device=count.device) < count.unsqueeze(1)] = flat
        return block

    def windows(self, labels: Tensor) -> Windows:
        """The episodes as windows with labels [R, K]."""
        lengths = self.active.sum(2)
        count, last = lengths.sum(1), lengths.cumsum(1) - 1
        states = self.rows(self.states)
        ended = torch.zeros(states.shape[:2], dtype=torch.bool, device=states.device).scatter(1, last, True)
        step = torch.arange(self.active.shape[2], device=states.device).expand(self.active.shape)
        return Windows(
            states,
            self.rows(self.actions),
            self.rows(self.next_states),
            self.rows(step),
            labels=labels,
            last=last,
            ended=ended,
            terminated=self.rows(self.terminated),
            count=None if bool((count == states.shape[1]).all()) else count,
        )


@torch.no_grad()
def play(
    world: World,
    policy: Act,
    problem: Problem,
    steps: int | None = None,
    reads: str | None = None,
    facts: bool = False,
) -> Grid:
    """An episode in every copy, in lock-step until all are over.

    Args:
        world: the copies. policy: whom to follow; it is asked for the copies that are done, too. problem: sizes.
        steps: most of an episode, T by default. reads: the fact that the feedback is shown instead of the reward.
        facts: whether to keep what the environment said of each episode's last step.
    """
    track, active, ends, said = Track(), list[Tensor](), list[Tensor](), list[Mapping[str, Tensor]]()
    now = _states(world, problem)
    awake = torch.ones(now.shape[:2], dtype=torch.bool, device=now.device)
    for tick in world.ticks[:steps]:
        action = policy.act(now, tick)
        out = world.env.step(action, awake)
        track.add(now, action, out)
        active.append(awake)
        said.append(out.facts)
        if reads is not None:
            track.seen.append(out.facts.get(reads, out.rewards))
        now = out.states
        if out.terminated is None:
            ends.append(torch.zeros_like(awake))
            continue
        ends.append(out.terminated)
        awake = awake & ~_over(out)
        if not awake.any():
            break
    taken = torch.stack(active, 2)
    rewards, seen = (torch.stack(part, 2).to(FLOAT) * taken for part in (track.rewards, track.seen or track.rewards))
    last = taken.sum(2) - 1
    return Grid(
        states=torch.stack(track.states, 2),
        actions=torch.stack(track.actions, 2),
        next_states=torch.stack(track.next_states, 2),
        active=taken,
        rewards=rewards,
        seen=seen,
        terminated=torch.stack(ends, 2) & taken,
        facts={name: _at(torch.stack([each[name] for each in said], 2), last) for name in said[0] if facts},
    )


def joined(grids: Sequence[Grid]) -> Grid:
    """Episodes that ran one time after the other, side by side; without their facts."""
    if len(grids) == 1:
        return grids[0]
    most = max(grid.active.shape[2] for grid in grids)

    def column(name: str) -> Tensor:
        parts = [getattr(grid, name) for grid in grids]
        longer = [part.new_zeros(*part.shape[:2], most - part.shape[2], *part.shape[3:]) for part in parts]
        return torch.cat([torch.cat(pair, 2) for pair in zip(parts, longer, strict=True)], 1)

    names = ("states", "actions", "next_states", "active", "rewards", "seen", "terminated")
    columns: dict[str, Any] = {name: column(name) for name in names}
    return Grid(**columns, facts={})


def _states(world: World, problem: Problem) -> Tensor:
    """The first states of new episodes.

    Raises:
        UserError: they are not what the problem says.
    """
    states = world.env.reset()
    if world.now is None:
        width = () if problem.finite_states else (problem.observations,)
        shape, kind = (*world.ticks[0].shape, *width), torch.int64 if problem.finite_states else torch.float32
        if states.shape != shape or states.dtype != kind:
            raise UserError(
                f"{type(world.env).__name__}.reset gave states {states.dtype} {list(states.shape)}, and its problem "
                f"says {kind} {list(shape)}: replicas, copies, then the encoded observation (credit.envs.spaces)"
            )
        world.now = states
    return states


def _ticks(problem: Problem, copies: int) -> tuple[Tensor, ...]:
    ticks = torch.arange(problem.window, device=problem.device).view(-1, 1, 1)
    return ticks.repeat(1, problem.replicas, copies).unbind()


def _over(out: Transitions) -> Tensor:
    assert out.terminated is not None
    return out.terminated if out.truncated is None else out.terminated | out.truncated


def _at(values: Tensor, last: Tensor) -> Tensor:
    """Values [R, K, L, ...] at one step of each copy [R, K]."""
    index = last.view(*last.shape, *[1] * (values.dim() - 2)).expand(*last.shape, 1, *values.shape[3:])
    return values.gather(2, index).squeeze(2)
