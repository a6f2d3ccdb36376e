"""Replay of whole trajectories of R replicas, on TorchRL's buffer: relabelling, n-step returns, success sampling."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer

from credit.agents.sac.loss import Batch
from credit.core.draws import Draws
from credit.core.errors import UserError
from credit.core.state import Stateful

Key = str | tuple[str, ...]

REWARD = ("next", "reward")
KEYS: tuple[Key, ...] = (
    "observation",
    "action",
    ("collector", "traj_ids"),
    *(("next", key) for key in ("observation", "reward", "success", "done", "terminated", "truncated")),
)


class Group(NamedTuple):
    """Rows of the table that batches are drawn from: `rows`, replica after replica; `start` and `size` of each [R]."""

    rows: Tensor
    start: Tensor
    size: Tensor


class Replay(Stateful):
    """All trajectories of R replicas, as flat rows in the order in which they came.

    A row's n-step return runs to the end of its trajectory at most. Behind the goal (`terminated`) there is no value;
    behind a time-out there is. The returns of all rows are summed once after every relabelling, so that drawing a batch
    is one look-up.

    Args:
        seeds: one a replica. capacity: rows of all replicas together; nothing is ever forgotten.
        n_step: n. discount: γ. success_share: of a batch, what is drawn from the successful trajectories of a replica
            (where it has one; the rest from all).
        device: where rows and batches live.

    Example:
        >>> replay = Replay(seeds=(0,), capacity=30_000, n_step=30, discount=0.99, success_share=0.5)
        >>> replay.extend(rows, torch.zeros(len(rows), dtype=torch.int64))
        >>> replay.relabel(rewards)
        >>> batches = replay.sample(batch=64, count=32)
    """

    def __init__(
        self,
        seeds: Sequence[int],
        capacity: int,
        n_step: int = 1,
        discount: float = 0.99,
        success_share: float = 0.0,
        device: torch.device | str = "cpu",
    ) -> None:
        self.replicas, self.capacity = len(seeds), capacity
        self.n_step, self.discount, self.success_share = n_step, discount, success_share
        self.device = torch.device(device)
        self.buffer = self._empty()
        self._draws = Draws(seeds, "sac/replay", self.device)
        self._table: Tensor | None = None

    def __len__(self) -> int:
        return len(self.buffer)

    @property
    def rows(self) -> TensorDictBase:
        """All rows [N]; to change them in place use `set_` or `relabel`."""
        return self.buffer[:]

    def reserve(self, capacity: int) -> None:
        """Make room for more rows."""
        rows = self.rows.clone() if len(self) else None
        self.capacity = capacity
        self.buffer = self._empty()
        if rows is not None:
            self.buffer.extend(rows)

    def extend(self, rows: TensorDictBase, replicas: Tensor) -> None:
        """Append whole trajectories.

        Args:
            rows: [M] as `RoundCollector` gives them. replicas: the replica of each row [M], int64.

        Raises:
            UserError: more rows than the capacity. ValueError: the last row does not end a trajectory.
        """
        if len(self) + len(rows) > self.capacity:
            raise UserError(
                f"the replay buffer holds {self.capacity} transitions and was given {len(self) + len(rows)}; "
                "reserve more"
            )
        if not rows["next", "done"][-1]:
            raise ValueError("the last row does not end a trajectory; whole trajectories are needed")
        kept = TensorDict({key: rows[key] for key in KEYS}, rows.batch_size)
        self.buffer.extend(kept.set("replica", replicas.view(-1, 1)).to(self.device))
        self._table = None

    def relabel(self, rewards: Tensor) -> None:
        """Replace the rewards of all rows [N] in place."""
        if rewards.shape != (len(self),):
            raise ValueError(f"rewards of shape {tuple(rewards.shape)} for {len(self)} rows")
        # rb[:][key] = r would change a copy while the buffer is not full
        self.rows.set_(REWARD, rewards.unsqueeze(-1).to(self.device, torch.float32))
        self._table = None

    def sample(self, batch: int, count: int = 1) -> list[Batch]:
        """`count` batches of `batch` rows a replica, each replica from its own stream.

        Raises:
            RuntimeError: a replica has no rows.
        """
        if self._table is None:
            self._prepare()
        assert self._table is not None
        uniform = self._draws.uniform(count, batch, axis=1)  # [count, R, B]
        index = _pick(self._all, uniform)
        wins = round(self.success_share * batch)
        if wins and len(self._won.rows):
            preferred = _pick(self._won, uniform[..., :wins])
            index[..., :wins] = torch.where(self._won.size.view(-1, 1) > 0, preferred, index[..., :wins])
        rows = self._table.index_select(0, index.flatten()).view(*index.shape, -1)
        columns = zip(*(part.unbind() for part in rows.split(self._widths, -1)), strict=True)
        return [
            Batch(state, action, returns.squeeze(-1), discount.squeeze(-1), ahead, self._low, self._high)
            for state, action, returns, discount, ahead in columns
        ]

    def state_dict(self) -> dict[str, Any]:
        """Rows and streams."""
        rows = {} if not len(self) else {_flat(key): self.rows[key].cpu().clone() for key in (*KEYS, "replica")}
        return {"rows": rows, "draws": self._draws.state_dict()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Become the buffer that gave this state; it makes room for its rows."""
        if rows := state["rows"]:
            tensors = {key: rows[_flat(key)] for key in (*KEYS, "replica")}
            count = len(rows["observation"])
            self.capacity = max(self.capacity, 2 * count)
            self.buffer = self._empty()
            self.buffer.extend(TensorDict(tensors, [count]).to(self.device))
        self._table = None
        self._draws.load_state_dict(state["draws"])

    def _empty(self) -> TensorDictReplayBuffer:
        return TensorDictReplayBuffer(storage=LazyTensorStorage(self.capacity, device=self.device), batch_size=1)

    def _prepare(self) -> None:
        rows = self.rows
        done, terminated = rows["next", "done"].squeeze(-1), rows["next", "terminated"].squeeze(-1)
        here = torch.arange(len(rows), device=self.device)
        ends = done.nonzero().squeeze(-1)
        end = ends[torch.searchsorted(ends, here)]  # of the trajectory that a row belongs to
        returns, last = self._returns(rows[REWARD].squeeze(-1).double(), here, end)
        discount = self.discount ** (last - here + 1).double() * ~(terminated[last])
        parts = [
            rows["observation"],
            rows["action"],
            returns.unsqueeze(-1),
            discount.unsqueeze(-1),
            rows["next", "observation"][last],
        ]
        self._widths = [part.shape[-1] for part in parts]
        self._table = torch.cat([part.float() for part in parts], -1)
        replica = rows["replica"].squeeze(-1)
        self._all = self._group(here, replica)
        if not self._all.size.all():
            raise RuntimeError(f"replicas {(self._all.size == 0).nonzero().flatten().tolist()} have no trajectories")
        self._won = self._group(here[rows["next", "success"].squeeze(-1)[end]], replica)
        self._low, self._high = self._bounds(rows[REWARD].squeeze(-1), replica)

    def _returns(self, rewards: Tensor, here: Tensor, end: Tensor) -> tuple[Tensor, Tensor]:
        """Σ γᵏ r over n steps or to the end of the trajectory, and the last row of the sum."""
        total = torch.zeros_like(rewards)
        last = torch.minimum(here + self.n_step - 1, end)
        for k in range(min(self.n_step, int((end - here).max()) + 1)):
            at = here + k
            total += torch.where(at <= end, self.discount**k * rewards[at.clamp_max(len(here) - 1)], 0)
        return total, last

    def _group(self, rows: Tensor, replica: Tensor) -> Group:
        count = torch.bincount(replica[rows], minlength=self.replicas)
        return Group(rows[replica[rows].argsort(stable=True)], count.cumsum(0) - count, count)

    def _bounds(self, rewards: Tensor, replica: Tensor) -> tuple[Tensor, Tensor]:
        """What an endless discounted sum of the rewards, cut anywhere, cannot leave [R, 1]."""
        ends = []
        for reduce in ("amin", "amax"):  # zero is within the range: nothing follows the goal
            extreme = torch.zeros(self.replicas, device=self.device).scatter_reduce(0, replica, rewards, reduce)
            ends.append((extreme / (1 - self.discount)).unsqueeze(-1))
        return ends[0], ends[1]


def _pick(group: Group, uniform: Tensor) -> Tensor:
    """Rows [count, R, B] of a group for uniform numbers of that shape; an empty replica gets any row."""
    position = (uniform * group.size.view(-1, 1)).long() + group.start.view(-1, 1)
    return group.rows[position.clamp_max_(len(group.rows) - 1)]


def _flat(key: Key) -> str:
    return key if isinstance(key, str) else "/".join(key)
