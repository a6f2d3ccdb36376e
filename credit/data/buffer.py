"""The replay of one replica as a TorchRL replay buffer, for losses and loops of TorchRL; nothing is copied."""

from __future__ import annotations

from typing import Any, NoReturn

import torch
from tensordict import TensorDict
from torchrl.data import Storage, TensorDictReplayBuffer
from torchrl.data.replay_buffers.samplers import RandomSampler, Sampler
from torchrl.data.replay_buffers.writers import ImmutableDatasetWriter

from credit.data.replay import Replay


class Rows(Storage):
    """The rows of one replica; only reading is possible, since the replay's store holds them.

    A row has `observation`, `action`, and in `next` what lies n steps later: `observation`, the discounted sum `reward`
    of the rewards up to there, `terminated` and `done`. `steps_to_next_obs` is n, so that TorchRL's losses discount by
    γⁿ.

    Args:
        replay: with rewards. replica: which.
    """

    def __init__(self, replay: Replay, replica: int = 0) -> None:
        super().__init__(max_size=2**62)
        self._replay, self._replica = replay, replica

    def __len__(self) -> int:
        """Rows that are remembered."""
        return self._replay.span(self._replica)[1]

    def get(self, index: Any) -> TensorDict:
        """Rows by number, the oldest that is remembered first."""
        replay, replica = self._replay, self._replica
        first, size = replay.span(replica)
        rows = torch.arange(first, first + size, device=replay.rewards.device)[index]
        batch, ahead = replay.at(rows, replica), replay.ahead(rows, replica)
        done, terminated = replay.ends(ahead, replica)
        following = {"observation": batch.ahead, "reward": batch.returns, "done": done, "terminated": terminated}
        return TensorDict(
            {
                "observation": batch.observation,
                "action": batch.action,
                "steps_to_next_obs": (ahead - rows + 1).unsqueeze(-1),
                "next": {k: v if k == "observation" else v.unsqueeze(-1) for k, v in following.items()},
            },
            rows.shape,
        )

    def set(self, cursor: Any, data: Any, *, set_cursor: bool = True) -> NoReturn:
        """Refused."""
        raise TypeError("rows are the store's: append windows to it, and `update` or `relabel` the replay")

    def contains(self, item: Any) -> Any:
        """Whether rows with these numbers are there."""
        return torch.as_tensor(item) < len(self)

    def state_dict(self) -> dict[str, Any]:
        """Nothing: the store and the replay have states of their own."""
        return {}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Nothing to load."""

    def _empty(self) -> NoReturn:
        raise TypeError("rows are the store's: make a new store instead")


def torchrl_buffer(
    replay: Replay, batch: int, replica: int = 0, sampler: Sampler | None = None
) -> TensorDictReplayBuffer:
    """A replica's replay as TorchRL has it: `sample()` gives a TensorDict [batch].

    Rewards are those of the last `update` or `relabel`, whenever that was; a share of preferred rows is not drawn,
    and random numbers are PyTorch's.

    Args:
        replay: what to read. batch: rows a sample. replica: which. sampler: TorchRL's, uniform by default.

    Example:
        >>> data = torchrl_buffer(replay, batch=256).sample()
        >>> loss = SACLoss(actor, critic)(data)
    """
    return TensorDictReplayBuffer(
        storage=Rows(replay, replica),
        sampler=RandomSampler() if sampler is None else sampler,
        writer=ImmutableDatasetWriter(),
        batch_size=batch,
        collate_fn=lambda rows: rows,  # they come side by side
    )
