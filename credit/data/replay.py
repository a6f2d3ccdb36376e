"""What an agent learns from: the rows of a store, with rewards that may change, drawn by each replica for itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Literal, NamedTuple

import torch
from torch import Tensor

from credit.core.checks import check_rewards, check_windows
from credit.core.draws import Draws
from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.seams import CreditAssigner
from credit.core.state import Stateful
from credit.core.store import Store, put
from credit.core.tensors import grown
from credit.core.windows import Windows
from credit.data.preferred import Prefer, preferred, require_bits
from credit.data.relabel import needed, numbers, oldest
from credit.data.returns import discounted_sums, discounted_sums_at, episode_ends

NO_ROWS = "this replay has no rows yet; give it some by `update` or `relabel`"


class Batch(NamedTuple):
    """Steps of R replicas, B each; where returns span n steps, `ahead` lies n steps later.

    Attributes:
        observation: s [R, B] or [R, B, O]. action: a [R, B] or [R, B, A]. step: in the episode [R, B].
        returns: Σ γᵏ r [R, B] up to `ahead`. discount: γⁿ [R, B], 0 where nothing lies behind `ahead`.
        ahead: the observation there, as `observation`. low, high: bounds of a return [R, 1], from the range of the
            rewards. outcome: Σ γᵏ r to the end of the episode [R, B], where it was asked for. after: the step in the
            episode there [R, B], where that is not the next one.
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
    after: Tensor | None = None


class Replay(Stateful):
    """All rows of a store, or those of its newest windows, with rewards that may change later.

    States and actions stay where they are, in the store. Beside them there are, for each row, its reward, and what
    follows from the rewards: n-step returns, where they end, and the discount there; 16 bytes in float32. Returns run
    to the end of an episode at most; behind a terminated one there is no value, behind one that was cut short there is.

    Args:
        problem: seeds, device, and whether windows are episodes. n_step: n. discount: γ.
        prefer: which windows are preferred: those with the label 1, where labels are bits (`success`); those with the
            best tenth of all labels (`top`); or `none`. share: of a batch, what is drawn from them (where a replica has
            some; the rest from all).
        capacity: windows that are remembered, the newest; None for all.
        outcome: whether batches say how the episode goes on. kind: of numbers. purpose: of the random numbers.

    Raises:
        UserError: successes are preferred, and the problem's labels are no bits.

    Example:
        >>> replay = Replay(problem, n_step=3)
        >>> replay.relabel(store.windows, assigner.rewards(store.windows))
        >>> batches = replay.sample(batch=64, count=32)
    """

    acts: ClassVar = ()  # no policy looks at it

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
        if share:
            require_bits(prefer, problem.labels)
        self._problem, self.n_step, self.discount = problem, n_step, discount
        self.prefer, self.share, self.capacity = prefer, share, capacity
        self._kinds = {"reward": kind, "returns": kind, "discount": kind, "last": torch.int32}
        if outcome:
            self._kinds["outcome"] = kind
        self._draws = Draws(problem.seeds, purpose, problem.device)
        self._replica = torch.arange(problem.replicas, device=problem.device).unsqueeze(1)
        self._windows: Windows | None = None
        self._columns: dict[str, Tensor] = {}  # [R, room], room for all rows
        self._counts: list[int] = []  # rows of each replica
        self._bounds: tuple[Tensor, Tensor]  # low and high
        self._ages = self._replica[:, :0].int()  # the update of each row's reward [R, n], where some stay as they are
        self._updates = 0
        self._ask: Callable[[Tensor], Tensor] | None = None  # for the rewards of rows, when they are sampled

    @property
    def windows(self) -> Windows:
        """The rows, as the store has them.

        Raises:
            UserError: there are none yet.
        """
        if self._windows is None:
            raise UserError(NO_ROWS)
        return self._windows

    @property
    def rewards(self) -> Tensor:
        """The reward of every row [R, n], 0 where a replica has fewer."""
        return self._columns["reward"][:, : len(self.windows)]

    @property
    def ages(self) -> Tensor:
        """How many updates ago the reward was made that a sample of each row now has [R, n]."""
        stays = self._ages.shape[1] and self._ask is None
        return self._updates - self._ages if stays else torch.zeros_like(self.rewards, dtype=torch.int32)

    def update(self, store: Store, assigner: CreditAssigner, cost: float = 0.0) -> None:
        """Take the rewards of an assigner, less a cost: for all rows where old ones change, else for the newest.

        What the assigner says of `relabel` may leave old rewards as they are, or all until they are sampled.

        Args:
            store: all windows. assigner: the same every time.
        """
        if assigner.learns and assigner.relabel != "all":
            self._update_some(store, lambda rows: assigner.at(rows) - cost, assigner.relabel)
        elif assigner.learns or self._counts != store.before.tolist():
            self.relabel(store.windows, assigner.rewards(store.windows) - cost, checked=True)
        else:
            self.extend(store.windows, assigner.rewards(store.new) - cost, checked=True)

    def relabel(self, windows: Windows, rewards: Tensor, checked: bool = False) -> None:
        """Take rewards [R, n] for all rows of all windows so far.

        Args:
            windows: all. rewards: of their rows. checked: whether somebody made sure that they fit the problem.

        Raises:
            ValueError: another number of rewards than of rows. RuntimeError: a replica has no rows. UserError: a reward
                is not finite, or windows do not fit the problem; labels that are no bits, where those of success are
                preferred.
        """
        if rewards.shape != windows.states.shape[:2]:
            raise ValueError(f"rewards of shape {tuple(rewards.shape)} for rows {tuple(windows.states.shape[:2])}")
        if not checked:
            check_windows(windows, self._problem)
            check_rewards(windows, rewards, self._problem)
        if self._columns and self._columns["reward"].shape[1] >= len(windows):
            self._columns["reward"].zero_()
        else:
            self._columns = {}
            self._make_room(len(windows))
        self._counts = [0] * len(rewards)
        self.extend(windows, rewards, checked=True)

    def extend(self, windows: Windows, rewards: Tensor, checked: bool = False) -> None:
        """Take rewards for the rows of each replica that are new among all windows so far; raises as `relabel` does.

        Args:
            windows: all. rewards: of the new rows [R, m], as those of a store's newest windows stand. checked: whether
                somebody made sure that they fit the problem.
        """
        if not self._counts:
            self.relabel(windows, rewards, checked)
            return
        if not checked:
            check_windows(windows, self._problem)
            if not rewards.isfinite().all():
                raise UserError(f"new rewards are {rewards[~rewards.isfinite()][0].item()}; give finite numbers")
        rows, before = len(windows), self._counts
        counts = _rows_of(windows)
        added = [count - start for count, start in zip(counts, before, strict=True)]
        if max(added) != rewards.shape[1]:
            raise ValueError(f"rewards of shape {tuple(rewards.shape)} for at most {max(added)} new rows a replica")
        self._make_room(rows)
        if len(set(before)) == len(set(counts)) == 1:
            self._columns["reward"][:, before[0] : rows] = rewards
        else:
            put(self._columns["reward"], rewards.to(self._kinds["reward"]), before, added)
        self._settle(windows, counts, min(before))

    def _settle(self, windows: Windows, counts: list[int], new: int) -> None:
        """Fill what follows from rewards and windows, where rows from `new` on are new."""
        self._windows, self._counts = windows, counts
        forgotten = windows.labels.shape[1] - (self.capacity or windows.labels.shape[1])
        first = windows.ends[:, forgotten - 1] + 1 if forgotten > 0 else torch.zeros_like(self._replica[:, 0])
        self._first = first.unsqueeze(1)
        self._size = torch.tensor(counts, device=first.device).unsqueeze(1) - self._first
        self._sum(new)
        self._bound(new)
        self._prefer(max(forgotten, 0))

    def _update_some(self, store: Store, ask: Callable[[Tensor], Tensor], relabel: float | Literal["sampled"]) -> None:
        """Make room for the new rows, and ask for the rewards of some, or for none as long as none is sampled."""
        windows, before = store.windows, self._counts
        rows, self._updates = len(windows), self._updates + 1
        counts = _rows_of(windows)
        self._make_room(rows)
        self._ages = torch.nn.functional.pad(self._ages, (0, rows - self._ages.shape[1]))
        if relabel == "sampled":
            self._columns["reward"].zero_()  # what is not known bounds no return
            self._settle(windows, counts, 0)
            self._ask = ask
            return
        begin = self._first.flatten().tolist() if before else [0] * len(counts)
        self._label(oldest(self._ages, begin, before or [0] * len(counts), counts, relabel), ask)
        self._settle(windows, counts, 0)

    def _make_room(self, rows: int) -> None:
        """Columns of so many rows at least."""
        shape = (len(self._replica), rows)
        for name, kind in self._kinds.items():
            if name not in self._columns:
                self._columns[name] = torch.zeros(shape, dtype=kind, device=self._replica.device)
            elif rows > self._columns[name].shape[1]:
                self._columns[name] = grown(self._columns[name], rows)

    def _label(self, chosen: Tensor, ask: Callable[[Tensor], Tensor]) -> Tensor:
        """Ask for the rewards of the rows of a mask [R, n]: [R, m], 0 where a replica has fewer."""
        rows = numbers(chosen)
        rewards = ask(rows).to(self._kinds["reward"])
        self._columns["reward"][:, : chosen.shape[1]][chosen] = rewards[rows < chosen.shape[1]]
        self._ages[chosen] = self._updates
        return rewards.where(rows < chosen.shape[1], 0)

    def _label_sampled(self, rows: Tensor, replica: Tensor | int, ask: Callable[[Tensor], Tensor]) -> None:
        """Have rewards and returns of rows [...] of a replica as they are now."""
        held = self._columns
        last = rows if self.n_step == 1 else self.ahead(rows, replica)
        stop = self._end[replica, rows] if "outcome" in held else last
        if stop is rows:
            chosen = torch.zeros_like(self._ages, dtype=torch.bool)
            chosen[replica, rows] = True
        else:
            chosen = needed(rows, stop, replica, self.rewards.shape)
        chosen &= self._ages < self._updates
        if bool(chosen.any()):
            self._widen(self._label(chosen, ask))
        held["returns"][replica, rows] = discounted_sums_at(self.rewards, rows, last, replica, self.discount).to(
            self._kinds["returns"]
        )
        if "outcome" in held:
            outcome = discounted_sums_at(self.rewards, rows, stop, replica, self.discount)
            held["outcome"][replica, rows] = outcome.to(self._kinds["outcome"])

    def sample(self, batch: int, count: int = 1) -> list[Batch]:
        """`count` batches of `batch` rows a replica.

        Raises:
            UserError: there are no rows yet.
        """
        if self._windows is None:
            raise UserError(NO_ROWS)
        uniform = self._draws.uniform(count, batch, axis=1)  # [count, R, B]
        rows = self._first + (uniform * self._size).long()
        wins = round(self.share * batch)
        if wins and self._preferred.shape[1]:
            place = (uniform[..., :wins] * self._wins).long()
            best = self._preferred.expand(count, -1, -1).gather(2, place).long()
            rows[..., :wins] = torch.where(self._wins > 0, best, rows[..., :wins])
        drawn = self.at(rows)
        several = {name: part.unbind() for name, part in zip(Batch._fields, drawn, strict=True) if part is not None}
        bounds = {name: [getattr(drawn, name)] * count for name in ("low", "high")}
        fields = [(several | bounds).get(name, [None] * count) for name in Batch._fields]
        return [Batch(*parts) for parts in zip(*fields, strict=True)]

    def span(self, replica: int) -> tuple[int, int]:
        """The oldest row of a replica that is remembered, and how many there are from it on."""
        return int(self._first[replica]), int(self._size[replica])

    def ahead(self, rows: Tensor, replica: Tensor | int) -> Tensor:
        """The row at whose end the n-step returns of rows [...] of a replica stop."""
        return self._columns["last"][replica, rows].long()

    def ends(self, rows: Tensor, replica: Tensor | int) -> tuple[Tensor, Tensor]:
        """Whether rows [...] of a replica are the last of their episode, and whether nothing lies behind them."""
        windows = self.windows
        if windows.ended is not None and windows.terminated is not None:
            return windows.ended[replica, rows], windows.terminated[replica, rows]
        last = (rows + 1) % (windows.length or 1) == 0 if self._problem.episodic else torch.zeros_like(rows).bool()
        return last, last

    def at(self, rows: Tensor, replica: Tensor | int | None = None) -> Batch:
        """Some rows [..., R, B] of each replica, or [B] of one."""
        windows, held = self.windows, self._columns
        replica = self._replica if replica is None else replica
        if self._ask is not None:
            self._label_sampled(rows, replica, self._ask)
        ahead = self.ahead(rows, replica)
        step = rows % windows.length if windows.length else None
        after = None
        if self.n_step > 1 and windows.step is not None:
            after = windows.step[replica, ahead] + 1
        elif self.n_step > 1 and windows.length:
            after = ahead % windows.length + 1
        return Batch(
            windows.states[replica, rows],
            windows.actions[replica, rows],
            step if windows.step is None else windows.step[replica, rows],
            held["returns"][replica, rows],
            held["discount"][replica, rows],
            windows.next_states[replica, ahead],
            *self._bounds,
            held["outcome"][replica, rows] if "outcome" in held else None,
            after,
        )

    def state_dict(self) -> dict[str, Any]:
        """The streams: rows are the store's, and rewards are given anew before the next batch; but those that stay."""
        held: dict[str, Any] = {"draws": self._draws.state_dict()}
        if self._ages.shape[1] and self._ask is None:
            stay = {
                "reward": self._columns["reward"][:, : self._ages.shape[1]],
                "ages": self._ages,
                "first": self._first,
            }
            held |= {name: column.cpu().clone() for name, column in stay.items()}
            held |= {"counts": list(self._counts), "updates": self._updates}
        return held

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Draw on from there."""
        self._draws.load_state_dict(state["draws"])
        self._counts = []
        if "ages" in state:
            device = self._replica.device
            rewards, self._ages, self._first = (state[name].to(device) for name in ("reward", "ages", "first"))
            self._columns = {}
            self._make_room(rewards.shape[1])
            self._columns["reward"].copy_(rewards)
            self._counts, self._updates = list(state["counts"]), state["updates"]

    def _sum(self, new: int) -> None:
        """Fill the columns that follow from rewards, where rows from `new` on are new."""
        windows, held = self.windows, self._columns
        apart = self._problem.episodic and windows.ended is None  # no sum runs from old windows into new ones
        start = new if apart else 0 if "outcome" in held else max(0, new - self.n_step + 1)
        end, over = episode_ends(windows, self._problem.episodic, start)
        if "outcome" in held:
            self._end = end  # of the rows from `start` on
        here = torch.arange(start, len(windows), device=end.device)
        last = torch.minimum(here + self.n_step - 1, end)
        part = slice(start, len(windows))
        held["last"][:, part] = last
        held["returns"][:, part] = discounted_sums(self.rewards, last, self.discount, self.n_step)
        power = self.discount ** (last - here + 1).double()
        held["discount"][:, part] = power * ~over.gather(1, (last - start).clamp(min=0))
        if "outcome" in held:
            held["outcome"][:, part] = discounted_sums(self.rewards, end, self.discount, len(windows))

    def _bound(self, new: int) -> None:
        """Between what an endless discounted sum of the rewards, cut anywhere, must lie: low and high [R, 1]."""
        self._widen(self.rewards[:, new:], anew=not new)

    def _widen(self, rewards: Tensor, anew: bool = False) -> None:
        """The bounds of all rewards so far and of these [R, m], or of these alone."""
        rest = 1 - self.discount
        low, high = rewards.amin(1, keepdim=True).clamp(max=0), rewards.amax(1, keepdim=True).clamp(min=0)
        bounds = (low / rest, high / rest) if rest else (low - torch.inf, high + torch.inf)
        if not anew:
            bounds = torch.minimum(self._bounds[0], bounds[0]), torch.maximum(self._bounds[1], bounds[1])
        self._bounds = bounds

    def _prefer(self, forgotten: int) -> None:
        """Find the rows of preferred windows [R, most], and how many there are of each replica [R, 1]."""
        self._wins, self._preferred = torch.zeros_like(self._size), self._replica[:, :0].int()
        if self.prefer == "none" or not self.share:
            return
        windows = self.windows
        known = None if windows.labelled is None else windows.labelled[:, forgotten:]
        good = preferred(windows.labels[:, forgotten:], self.prefer, known)
        good = torch.nn.functional.pad(good, (forgotten, 0)).to(windows.labels.dtype)
        own = windows.to_steps(good) > 0
        self._wins = own.sum(1, keepdim=True)
        places = own.nonzero()[:, 1].int().split(self._wins.flatten().tolist())
        self._preferred = torch.nn.utils.rnn.pad_sequence(list(places), batch_first=True)


def _rows_of(windows: Windows) -> list[int]:
    """How many rows each replica has."""
    counts = [len(windows)] * len(windows.labels) if windows.count is None else windows.count.tolist()
    if not all(counts):
        raise RuntimeError(f"replicas {[r for r, count in enumerate(counts) if not count]} have no rows")
    return counts
