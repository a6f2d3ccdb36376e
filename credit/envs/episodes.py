"""Episodes of copies side by side: in lock-step until all are over, then as rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from credit.core.errors import UserError
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Act, Environment, Transitions
from credit.core.windows import Windows


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
    now = first_states(world, problem)
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
        awake = awake & ~over(out)
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


def first_states(world: World, problem: Problem) -> Tensor:
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


def ticks(problem: Problem, copies: int) -> tuple[Tensor, ...]:
    """The step in the window [R, K], for each of its T steps: made once."""
    steps = torch.arange(problem.horizon, device=problem.device).view(-1, 1, 1)
    return steps.repeat(1, problem.replicas, copies).unbind()


def over(out: Transitions) -> Tensor:
    """Which episodes end with a step [R, K]."""
    assert out.terminated is not None
    return out.terminated if out.truncated is None else out.terminated | out.truncated


def _at(values: Tensor, last: Tensor) -> Tensor:
    """Values [R, K, L, ...] at one step of each copy [R, K]."""
    index = last.view(*last.shape, *[1] * (values.dim() - 2)).expand(*last.shape, 1, *values.shape[3:])
    return values.gather(2, index).squeeze(2)
