"""Learning from the newest round alone: advantages, log-probabilities, epochs and minibatches."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import torch
from tensordict import TensorDict


@torch.no_grad()
def judged(loss: Any, data: TensorDict) -> TensorDict:
    """The rows with their advantages, value targets, and the log-probability that each action had.

    The policy has not moved since it acted, so that its log-probabilities are those of the time of collection.

    Args:
        loss: an actor-critic loss of TorchRL with an advantage estimator. data: rows [n] in the order of time.
    """
    loss.value_estimator(
        data, params=loss.critic_network_params.detach(), target_params=loss.target_critic_network_params
    )
    with loss.actor_network_params.to_module(loss.actor_network):
        distribution = loss.actor_network.get_dist(data)
    return data.set(loss.tensor_keys.sample_log_prob, distribution.log_prob(data["action"]))


def minibatches(data: TensorDict, batch: int, epochs: int) -> Iterator[TensorDict]:
    """All rows in a random order, cut into parts of about `batch` rows that differ by one at most, `epochs` times."""
    rows = len(data)
    for _ in range(epochs):
        order = torch.randperm(rows, device=data.device)
        for part in order.tensor_split(max(1, round(rows / batch))):
            yield data[part]
