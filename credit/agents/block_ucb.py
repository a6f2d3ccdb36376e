"""The block-level baseline of A.1: a whole window's action sequence is one macro-action."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

import numpy as np
import torch
from annotated_types import Interval
from torch import Tensor

from credit.core.checks import require_finite
from credit.core.errors import UserError
from credit.core.policy import Policy, TablePolicy
from credit.core.problem import Problem
from credit.core.ranges import NonNegative, Positive, PositiveInt
from credit.core.seams import Agent, CreditAssigner
from credit.core.store import Store
from credit.core.streams import generators
from credit.core.tensors import grown, matvec

SLOTS = 256  # room at first
LARGEST = 100_000  # macro-actions A^T: beyond it the orders in which they are tried would fill the memory


class BlockUCB(Agent):
    """UCB on the block MDP: macro-actions u ∈ A^T, block reward R̂(s, u) and transition P̂(s'|s, u) from blocks (A.1).

    V(s) = max_u [R̂(s, u) + c/√(λ + N(s, u)) + γ Σ P̂(s'|s, u) V(s')]; an untried u is worth c/√λ + γ V(s). Only what was
    tried is stored, so a block costs O(blocks so far). All untried macro-actions of a state are tied.

    States and actions are numbers, and windows have one length.

    Args:
        scale: c, in units of block reward.
        lambda_visits: λ.
        discount: γ per block.
        backups: sweeps of value iteration after each block, warm-started.
        ties: which untried macro-action is taken, a `random` one or the `lexicographic` first. The paper's regret is
            reproduced by the latter and owes 700 of its 2354 to it.
    """

    observations: ClassVar = "finite"
    actions: ClassVar = "finite"
    setting: ClassVar = "continuing"
    keeps: ClassVar = ("_value", "_tried", "_used", "_key", "_state", "_sums", "_macro")

    def __init__(
        self,
        scale: NonNegative = 1.0,
        lambda_visits: Positive = 1.0,
        discount: Annotated[float, Interval(ge=0, lt=1)] = 0.95,
        backups: PositiveInt = 3,
        ties: Literal["random", "lexicographic"] = "random",
    ) -> None:
        self.scale = scale
        self.lambda_visits = lambda_visits
        self.discount = discount
        self.backups = backups
        self.ties = ties

    def start(self, problem: Problem) -> None:
        """No block was seen; every state is worth what optimism promises for ever."""
        self._problem = problem
        self._macros = problem.actions**problem.window
        if self._macros > LARGEST:
            raise UserError(
                f"feedback.window={problem.window}: block_ucb has {problem.actions}^{problem.window} = {self._macros} "
                f"macro-actions, at most {LARGEST} are allowed; shorten the window or choose another method"
            )
        self._order = self._orders(problem)
        self._untried = self.scale * self.lambda_visits**-0.5
        self._value = problem.zeros(problem.states) + self._untried / (1 - self.discount)
        self._tried = torch.zeros_like(self._value, dtype=torch.int64)
        self._rows = torch.arange(problem.replicas, device=problem.device)
        self._used = torch.zeros_like(self._rows)
        # A slot for every tried (s, u): its key (0: empty), state, and sums: count, block reward, next states.
        self._key = torch.zeros(problem.replicas, SLOTS, dtype=torch.int64, device=problem.device)
        self._state = torch.zeros_like(self._key)
        self._sums = problem.zeros(SLOTS, 2 + problem.states)
        self._macro = torch.zeros_like(self._rows)

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """Choose a macro-action at the first step of a window, then play its digits."""
        if not step[0, 0]:  # all replicas are at the same step
            self._macro = self._choose(states[:, 0])
        place = self._problem.actions ** (self._problem.window - 1 - step)
        return (self._macro.unsqueeze(1) // place) % self._problem.actions

    def improve(self, store: Store, assigner: CreditAssigner) -> None:
        """Count the newest blocks and back up the values.

        Raises:
            RunError: a value is not finite.
        """
        windows = store.new
        rewards = windows.sums(assigner.rewards(windows))
        states, actions, arrivals = (windows.grid(x) for x in (windows.states, windows.actions, windows.next_states))
        for k in range(rewards.shape[1]):
            self._count(states[:, k, 0], actions[:, k], arrivals[:, k, -1], rewards[:, k])
        for _ in range(self.backups):
            values = self._values()
            untried = torch.where(self._tried < self._macros, self._untried + self.discount * self._value, -torch.inf)
            self._value = untried.scatter_reduce(1, self._state[:, : values.shape[1]], values, "amax")
        require_finite("Block-UCB: a value", self._value, self._problem.seeds, "; are the rewards finite?")

    def filled(self) -> Mapping[str, int]:
        """As many slots as any replica uses."""
        return dict.fromkeys(("_key", "_state", "_sums"), int(self._used.max()))

    def policies(self) -> dict[str, Policy]:
        """The first action of the macro-action chosen in each state."""
        first = self._problem.actions ** (self._problem.window - 1)
        columns = [self._choose(torch.full_like(self._rows, s)) // first for s in range(self._problem.states)]
        return {"behaviour": TablePolicy(torch.stack(columns, dim=1), self._problem.actions)}

    def _orders(self, problem: Problem) -> Tensor:
        shape = (problem.replicas, problem.states, self._macros)
        if self.ties == "lexicographic":
            return torch.arange(self._macros, device=problem.device).expand(shape)
        rows = np.broadcast_to(np.arange(self._macros), shape[1:])
        orders = np.stack([g.permuted(rows, axis=1) for g in generators(problem.seeds, "macro-actions")])
        return torch.from_numpy(orders).to(problem.device)

    def _count(self, start: Tensor, actions: Tensor, end: Tensor, reward: Tensor) -> None:
        places = self._problem.actions ** torch.arange(actions.shape[1] - 1, -1, -1, device=actions.device)
        key = 1 + start * self._macros + (actions * places).sum(-1)
        if (full := self._key.shape[1]) == int(self._used.max()):
            self._key, self._state, self._sums = (grown(x, full + 1) for x in (self._key, self._state, self._sums))
        matches = self._key == key.unsqueeze(1)
        known = matches.any(1)
        slot = torch.where(known, matches.to(torch.uint8).argmax(1), self._used)
        self._used += (~known).to(torch.int64)
        self._tried[self._rows, start] += (~known).to(torch.int64)
        self._key[self._rows, slot] = key
        self._state[self._rows, slot] = start
        self._sums[self._rows, slot, 0] += 1
        self._sums[self._rows, slot, 1] += reward
        self._sums[self._rows, slot, 2 + end] += 1

    def _values(self) -> Tensor:
        """Q of every tried (s, u), [R, slots]; −inf in slots that a replica has not filled."""
        used = int(self._used.max())
        sums = self._sums[:, :used]
        count = sums[..., 0]
        ahead = matvec(sums[..., 2:], self._value)
        values = (sums[..., 1] + self.discount * ahead) / count + self.scale * (self.lambda_visits + count).rsqrt()
        return values.masked_fill(count == 0, -torch.inf)

    def _choose(self, states: Tensor) -> Tensor:
        """The macro-action [R] to play in states [R]: the first best tried one, or the next untried."""
        tried = self._tried[self._rows, states]
        untried = self._untried + self.discount * self._value[self._rows, states]
        untried = torch.where(tried < self._macros, untried, -torch.inf)
        fresh = self._order[self._rows, states, tried.clamp(max=self._macros - 1)]
        if int(self._used.max()) == 0:
            return fresh
        values = self._values()
        here = values.masked_fill(self._state[:, : values.shape[1]] != states.unsqueeze(1), -torch.inf)
        best, slot = here.max(1)
        return torch.where(best > untried, (self._key[self._rows, slot] - 1) % self._macros, fresh)
