"""Copies that step without a pause: episodes begin where others end, windows lie inside them, labels may come late."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import torch
from torch import Tensor

from credit.core.problem import FLOAT, Problem
from credit.core.seams import Act, Environment, Feedback
from credit.core.state import Stateful
from credit.core.streams import Queues
from credit.core.windows import Windows
from credit.envs.episodes import World, first_states, over, ticks


@dataclass
class Tape:
    """What K copies of R replicas did, [R, K, L, ...]: the steps whose windows have no label yet, and the newest.

    Attributes:
        states, actions, next_states, rewards, seen, step, ended, terminated: of each step; `seen` is what the feedback
            is shown, `step` that in the episode.
        closes: whether a window ends with it. short: whether the end of an episode cut that window short.
        due: when the label of that window arrives, in steps of a copy. held: whether there is a step at all.
    """

    states: Tensor
    actions: Tensor
    next_states: Tensor
    rewards: Tensor
    seen: Tensor
    step: Tensor
    ended: Tensor
    terminated: Tensor
    closes: Tensor
    short: Tensor
    due: Tensor
    held: Tensor

    def map(self, function: Any) -> Tape:
        """The same function of every column."""
        return Tape(*(function(getattr(self, field.name)) for field in fields(self)))

    def after(self, earlier: Tape | None) -> Tape:
        """Behind what was kept."""
        if earlier is None:
            return self
        pairs = ((getattr(earlier, field.name), getattr(self, field.name)) for field in fields(self))
        return Tape(*(torch.cat(pair, 2) for pair in pairs))


class Rolling(Stateful):
    """Steps of K copies of each replica, as windows once their labels have come.

    Every copy takes every step: a copy whose episode ends begins another. So replicas take as many steps, whatever
    happens to others, and a window may begin in one round and end in a later one; its steps are kept until then. The
    windows of one copy follow each other; where there are several copies, the last of a copy's windows in a round ends
    what returns may run over.

    Args:
        env: started. feedback: started. problem: what both were started with.
    """

    def __init__(self, env: Environment, feedback: Feedback, problem: Problem) -> None:
        self._feedback, self._problem = feedback, problem
        copies = env.copies or 1
        self._own = copies > 1  # else they are the environment, which is saved by itself
        if self._own:
            env = env.twin()
            env.start(problem, copies, f"environment, {copies} at once")
        self._world = World(env, ticks(problem, copies)[:1])
        shape = (problem.replicas, copies)
        self._step = torch.zeros(shape, dtype=torch.int64, device=problem.device)  # of the episode
        self._age = torch.zeros_like(self._step)  # steps of the window
        self._lengths = torch.full_like(self._step, problem.window)  # that it is to have
        self._inside = problem.window < problem.horizon or feedback.lengths is not None  # windows are parts of episodes
        self._clock = 0  # steps of each copy
        self._ended = torch.zeros_like(self._step)  # episodes of each copy that are over
        self.taken = 0  # steps of a replica in the last call of `collect`
        self._tape: Tape | None = None
        self._missing = Queues(problem, "feedback, missing", "uniform", 1)
        self._drawn = Queues(problem, "feedback, window", "uniform", 1)

    @property
    def episodes(self) -> int:
        """Whole episodes of the replica that has the fewest."""
        return int(self._ended.sum(1).min())

    def collect(self, policy: Act, steps: int, episodes: int = 0) -> tuple[Windows, Tensor] | None:
        """So many steps of each copy, and the windows whose labels have come since, with primitive rewards [R, n].

        Args:
            policy: whom to follow. steps: of each copy. episodes: of each copy, behind which it waits; 0 for no limit.

        Returns:
            None as long as a replica has no window at all.
        """
        begun = self._clock
        self._tape = self._taken(policy, steps, episodes).after(self._tape)
        return self._released(self._tape, begun)

    @torch.no_grad()
    def _taken(self, policy: Act, steps: int, episodes: int) -> Tape:
        """The newest steps."""
        env, world = self._world.env, self._world
        if world.now is None:
            world.now = first_states(world, self._problem)
            self._next_lengths(torch.ones_like(self._step, dtype=torch.bool))
        rows, everyone = list[tuple[Tensor, ...]](), torch.ones_like(self._step, dtype=torch.bool)
        for _ in range(steps):
            going = self._ended < episodes if episodes else everyone
            waits = bool(episodes) and not bool(going.all())
            if waits and not going.any():
                break
            action = policy.act(world.now, self._step)
            out = env.step(action, going) if waits else env.step(action)
            seen = out.rewards if self._feedback.reads is None else out.facts.get(self._feedback.reads, out.rewards)
            nothing = torch.zeros_like(self._step, dtype=torch.bool)
            terminated = nothing if out.terminated is None else out.terminated
            ended = nothing if out.terminated is None else over(out)
            if waits:
                terminated, ended = terminated & going, ended & going
            self._clock, self._age = self._clock + 1, self._age + going
            full = going & (self._age >= self._lengths)
            closes = ended | full
            due = torch.full_like(self._step, self._clock + self._feedback.delay)
            short = ended & ~full if self._inside else nothing
            rows.append(
                (
                    *(world.now, action, out.states, out.rewards.to(FLOAT), seen.to(FLOAT), self._step),
                    *(ended, terminated, closes, short, due, going),
                )
            )
            self._ended = self._ended + ended
            self._step = torch.where(ended, 0, self._step + going)
            self._age = torch.where(closes, 0, self._age)
            self._next_lengths(closes)
            world.now = env.reset(ended) if bool(ended.any()) else out.states
        tape = Tape(*(torch.stack(column, 2) for column in zip(*rows, strict=True)))
        self.taken = int(tape.held.sum((1, 2)).max())
        return tape

    def _next_lengths(self, begins: Tensor) -> None:
        """Draw how long windows are to be that begin now [R, K]."""
        if self._feedback.lengths is None:
            return
        least, most = self._feedback.lengths
        drawn = least + (self._drawn.take(begins).squeeze(-1) * (most - least + 1)).long()
        self._lengths = torch.where(begins, drawn, self._lengths)

    def _released(self, tape: Tape, begun: int) -> tuple[Windows, Tensor] | None:
        """The windows whose labels have come; the rest is kept."""
        later = tape.closes.long().flip(2).cumsum(2).flip(2) - tape.closes.long()  # windows that ended behind each row
        come = tape.closes & (tape.due <= self._clock) & (later >= self._feedback.delay_windows)
        done = tape.held & (come.flip(2).cumsum(2).flip(2) > 0)
        if not bool(done.flatten(1).any(1).all()):
            return None
        closes = tape.closes & done
        windows, primitive = self._windows(tape, done, closes)
        fresh = tape.due > begun + self._feedback.delay
        if bool((done & ~fresh).any()):  # labels that came late, or windows that were open when the round began
            windows = replace(windows, fresh=_Rows(done)(fresh))
        rest = tape.held & ~done
        waiting = rest.flatten(0, 1).any(0)  # in which columns; behind the last step of a copy there may be more
        most = len(waiting) - int(waiting.long().argmax()) if bool(waiting.any()) else 1
        kept = tape.map(lambda column: column[:, :, -most:].clone())
        kept.held, kept.closes = rest[:, :, -most:].clone(), (tape.closes & rest)[:, :, -most:].clone()
        self._tape = kept
        return windows, primitive

    def _windows(self, tape: Tape, done: Tensor, closes: Tensor) -> tuple[Windows, Tensor]:
        rows = _Rows(done)
        count, number = rows.count, closes.sum((1, 2))
        most = int(number.max())
        index = torch.arange(most, device=number.device).expand(len(number), -1)
        real = index < number.unsqueeze(1)
        places = rows(torch.ones_like(tape.step)).cumsum(1) - 1  # the row itself
        last = (count - 1).unsqueeze(1).expand(-1, most).clone()
        flat = rows(closes)
        last[real] = places[flat]
        short = torch.zeros_like(real)
        short[real] = rows(tape.short)[flat]
        ended = rows(tape.ended)
        if done.shape[1] > 1:  # the rows of another copy follow
            final = done & ~torch.nn.functional.pad(done[:, :, 1:], (0, 1))
            ended = ended | rows(final)
        even = bool((count == places.shape[1]).all())
        found = Windows(
            rows(tape.states),
            rows(tape.actions),
            rows(tape.next_states),
            rows(tape.step),
            labels=self._problem.zeros(most),
            last=last,
            ended=ended,
            terminated=rows(tape.terminated),
            count=None if even else count,
        )
        labels = self._feedback.label(_side_by_side(found, rows(tape.seen)), found.lengths)
        labelled = self._labelled(real, short)
        if not bool(labelled.all()):
            labels = torch.where(labelled, labels, 0.0)
            found = replace(found, labelled=labelled)
        return replace(found, labels=labels), rows(tape.rewards)

    def _labelled(self, real: Tensor, short: Tensor) -> Tensor:
        """Which windows get a label [R, W]."""
        good = real & ~short if self._feedback.cut == "drop" else real
        if not self._feedback.missing:
            return good
        return good & (self._missing.take(real).squeeze(-1) >= self._feedback.missing)

    def state_dict(self) -> dict[str, Any]:
        """Where the copies are, and the steps that wait for their labels."""
        tape = self._tape
        own = {name: getattr(self, name) for name in ("_step", "_age", "_lengths")}
        return {
            "now": None if self._world.now is None else self._world.now.cpu().clone(),
            "env": self._world.env.state_dict() if self._own else None,
            "clock": self._clock,
            "ended": self._ended.cpu().clone(),
            "streams": [self._missing.state_dict(), self._drawn.state_dict()],
            "tape": None if tape is None else {f.name: getattr(tape, f.name).cpu().clone() for f in fields(tape)},
            **{name: value.cpu().clone() for name, value in own.items()},
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on from there."""
        device = self._problem.device
        self._world.now = None if state["now"] is None else state["now"].to(device)
        if state["env"] is not None:
            self._world.env.load_state_dict(state["env"])
        self._clock = state["clock"]
        self._ended = state.get("ended", torch.zeros_like(self._ended)).to(device)
        for stream, held in zip((self._missing, self._drawn), state["streams"], strict=True):
            stream.load_state_dict(held)
        held = state["tape"]
        self._tape = None if held is None else Tape(**{name: part.to(device) for name, part in held.items()})
        for name in ("_step", "_age", "_lengths"):
            setattr(self, name, state[name].to(device))


class _Rows:
    """Of columns [R, K, L, ...] the rows of a mask, copy after copy: [R, n, ...], 0 where a replica has fewer."""

    def __init__(self, mask: Tensor) -> None:
        self._mask, self.count = mask, mask.sum((1, 2))
        most = int(self.count.max())
        self._real = torch.arange(most, device=mask.device) < self.count.unsqueeze(1)

    def __call__(self, values: Tensor) -> Tensor:
        block = values.new_zeros(*self._real.shape, *values.shape[3:])
        block[self._real] = values[self._mask]
        return block


def _side_by_side(windows: Windows, values: Tensor) -> Tensor:
    """Values of rows [R, n] as [R, W, T], 0 behind the end of a window."""
    lengths = windows.lengths
    place = torch.arange(int(lengths.max()), device=values.device)
    rows = (windows.ends - lengths + 1).unsqueeze(-1) + place
    inside = place < lengths.unsqueeze(-1)
    found = values.unsqueeze(1).expand(-1, lengths.shape[1], -1).gather(2, rows.clamp(0, values.shape[1] - 1))
    return torch.where(inside, found, 0.0)
