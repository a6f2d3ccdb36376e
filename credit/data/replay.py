"""What an agent learns from: the rows of a store, with rewards that may change, drawn by each replica for itself."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import torch
from torch import Tensor

from credit.core.draws import Draws
from credit.core.problem import Problem
from credit.core.state import Stateful
from credit.core.store import Windows

Prefer = Literal["none", "success", "top"]
TOP = 0.9  # quantile of a replica's labels from which on a window is among its best


class Batch(NamedTuple):
    """Steps of R replicas, B each; where returns span n steps, `ahead` lies n steps later.

    Attributes:
        observation: s [R, B] or [R, B, O]. action: a [R, B] or [R, B, A]. step: in the episode [R, B].
        returns: Σ γᵏ r [R, B] up to `ahead`. discount: γⁿ [R, B], 0 where nothing lies behind `ahead`.
        ahead: the observation there, as `observation`. low, high: bounds of a return [R, 1], from the range of the
            rewards. outcome: Σ γᵏ r to the end of the episode [R, B], where it was asked for.
    """

    observation: Tensor
    action: Tensor
    step: Tensor | None
    returns: Tensor
    discount: Tensor
    ahead: Tensor
    low: Tensor
    high: Tensor
    outcome: Tensor | None = None


class Replay(Stateful):
    """All rows of a store, or those of its newest windows, with rewards that may change later.

    States and actions stay where they are, in the store. Beside them there are, for each row, its reward, and what
    follows from the rewards after every `relabel`: n-step returns, where they end, and the discount there. Returns run
    to the end of an episode at most; behind a terminated one there is no value, behind one that was cut short there is.

    Args:
        problem: seeds, device, and whether windows are episodes. n_step: n. discount: γ.
        prefer: which windows are preferred: those with a label above zero, where labels are success bits; those with
            the best tenth of labels; or none. share: of a batch, what is drawn from them (where a replica has some).
        capacity: windows that are remembered, the newest; None for all.
        outcome: whether batches say how the episode goes on. kind: of numbers. purpose: of the random numbers.

    Example:
        >>> replay = Replay(problem, n_step=3)
        >>> replay.relabel(store.windows, assigner.rewards(store.windows))
        >>> batches = replay.sample(batch=64, count=32)
    """

    def __init__(
        self,
        problem: Problem,
        n_step: int = 1,
        discount: float = 0.99,
        prefer: Prefer = "none",
        share: float = 0.0,
        capacity: int | None = None,
        outcome: bool = False,
        kind: torch.dtype = torch.float32,
        purpose: str = "replay",
    ) -> None:
        self._problem, self.n_step, self.discount = problem, n_step, discount
        self.prefer, self.share, self.capacity = prefer, share, capacity
        self._outcome, self._kind = outcome, kind
        self._draws = Draws(problem.seeds, purpose, problem.device)
        self._replica = torch.arange(problem.replicas, device=problem.device).unsqueeze(1)
        self._windows: Windows | None = None

    def relabel(self, windows: Windows, rewards: Tensor) -> None:
        """Take rewards [R, n] for all rows of all windows so far.

        Raises:
            ValueError: another number of rewards than of rows. RuntimeError: a replica has no rows.
        """
        if rewards.shape != windows.states.shape[:2]:
            raise ValueError(f"rewards of shape {tuple(rewards.shape)} for rows {tuple(windows.states.shape[:2])}")
        self._windows, self.rewards = windows, rewards.to(self._kind)
        full = torch.full_like(self._replica[:, 0], len(windows))
        count = full if windows.count is None else windows.count
        if not count.all():
            raise RuntimeError(f"replicas {(count == 0).nonzero().flatten().tolist()} have no rows")
        self._first = self._oldest(windows)
        self._size = count - self._first
        end, over = self._ends(windows, count)
        here = torch.arange(len(windows), device=rewards.device)
        self._last = torch.minimum(here + self.n_step - 1, end)
        self._returns = _sums(self.rewards, self._last, self.discount, self.n_step)
        behind = self.discount ** (self._last - here + 1).double()
        self._behind = (behind * ~over.gather(1, self._last)).to(self._kind)
        if self._outcome:
            self._outcomes = _sums(self.rewards, end, self.discount, len(windows)).to(self._kind)
        self._returns = self._returns.to(self._kind)
        self._preferred, self._wins = self._best(windows)
        self._bounds = self._range(windows)

    def sample(self, batch: int, count: int = 1) -> list[Batch]:
        """`count` batches of `batch` rows a replica."""
        uniform = self._draws.uniform(count, batch, axis=1)  # [count, R, B]
        rows = self._first.view(-1, 1) + (uniform * self._size.view(-1, 1)).long()
        wins = round(self.share * batch)
        if wins and self._preferred is not None and self._preferred.shape[1]:
            place = (uniform[..., :wins] * self._wins.view(-1, 1)).long()
            best = self._preferred.expand(count, -1, -1).gather(2, place)
            rows[..., :wins] = torch.where(self._wins.view(-1, 1) > 0, best, rows[..., :wins])
        return [self.at(part) for part in rows.unbind()]

    def at(self, rows: Tensor) -> Batch:
        """Some rows [R, B] of each replica."""
        windows, replica = self._windows, self._replica
        assert windows is not None, "relabel first"
        ahead = self._last[replica, rows]
        return Batch(
            windows.states[replica, rows],
            windows.actions[replica, rows],
            self._times(windows, rows),
            self._returns[replica, rows],
            self._behind[replica, rows],
            windows.next_states[replica, ahead],
            *self._bounds,
            self._outcomes[replica, rows] if self._outcome else None,
        )

    def state_dict(self) -> dict[str, Any]:
        """The streams: rows are the store's, and rewards are given anew before the next batch."""
        return {"draws": self._draws.state_dict()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Draw on from there."""
        self._draws.load_state_dict(state["draws"])

    def _times(self, windows: Windows, rows: Tensor) -> Tensor | None:
        if windows.step is not None:
            return windows.step[self._replica, rows]
        return rows % windows.length if windows.length else None

    def _oldest(self, windows: Windows) -> Tensor:
        """The first row that is remembered [R]."""
        forgotten = windows.labels.shape[1] - (self.capacity or windows.labels.shape[1])
        return torch.zeros_like(self._replica[:, 0]) if forgotten <= 0 else windows.ends[:, forgotten - 1] + 1

    def _ends(self, windows: Windows, count: Tensor) -> tuple[Tensor, Tensor]:
        """The last row of the episode, or of all that is known of it, and whether nothing lies behind a row [R, n]."""
        here = torch.arange(len(windows), device=count.device).expand(len(count), -1)
        if windows.length is not None:
            if not self._problem.episodic:
                return (count - 1).unsqueeze(1).expand_as(here), torch.zeros_like(here, dtype=torch.bool)
            last = here % windows.length == windows.length - 1
            return here - here % windows.length + windows.length - 1, last
        assert windows.ended is not None
        assert windows.terminated is not None
        known = torch.where(windows.ended, here, len(windows)).flip(1).cummin(1).values.flip(1)
        return torch.minimum(known, (count - 1).clamp(min=0).unsqueeze(1)), windows.terminated

    def _best(self, windows: Windows) -> tuple[Tensor | None, Tensor]:
        """Rows of preferred windows [R, most], and how many there are of each replica [R]."""
        if self.prefer == "none" or not self.share:
            return None, torch.zeros_like(self._size)
        labels = windows.labels
        bar = torch.zeros_like(labels[:, :1]) if self.prefer == "success" else labels.quantile(TOP, 1, keepdim=True)
        good = labels > bar if self.prefer == "success" else labels >= bar
        here = torch.arange(len(windows), device=labels.device)
        own = windows.to_steps(good.to(labels.dtype)).bool() & (here >= self._first.unsqueeze(1))
        own &= here <= windows.ends[:, -1:]
        wins = own.sum(1)
        return own.to(torch.int8).argsort(dim=1, descending=True, stable=True)[:, : int(wins.max())], wins

    def _range(self, windows: Windows) -> tuple[Tensor, Tensor]:
        """What an endless discounted sum of the rewards, cut anywhere, cannot leave [R, 1]."""
        rewards = self.rewards if windows.valid is None else self.rewards * windows.valid  # zero is within the range
        low, high = rewards.amin(1, keepdim=True).clamp(max=0), rewards.amax(1, keepdim=True).clamp(min=0)
        rest = 1 - self.discount
        return (low / rest, high / rest) if rest else (low - torch.inf, high + torch.inf)


def _sums(rewards: Tensor, last: Tensor, discount: float, most: int) -> Tensor:
    """Σ γᵏ r_{t+k} up to the row `last` of every row [R, n], of at most so many rewards; float64."""
    rewards, total = rewards.double(), torch.zeros_like(rewards, dtype=torch.float64)
    here = torch.arange(rewards.shape[1], device=rewards.device)
    for k in range(min(most, int((last - here).max()) + 1)):
        at = here + k
        values = discount**k * rewards[:, at.clamp(max=rewards.shape[1] - 1)]
        total += torch.where(at <= last, values, 0)
    return total
