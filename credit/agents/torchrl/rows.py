"""Rows of one replica as TorchRL's losses read them: a TensorDict with `observation`, `action` and `next`."""

from __future__ import annotations

import math
from collections.abc import Iterator

import torch
from tensordict import TensorDict
from torch import Tensor

from credit.agents.sac.networks import encoded
from credit.core.problem import Problem
from credit.core.windows import Windows
from credit.data.replay import Batch
from credit.data.returns import episode_ends
from credit.networks.perceptron import PRECISION


def numbers_seen(problem: Problem) -> int:
    """How many numbers a network sees of a state: S where they are one-hot, else O."""
    return problem.states if problem.finite_states else problem.observations


def steps_spanned(power: Tensor, discount: float) -> Tensor:
    """n of γⁿ, where that is not 0; 1 where n makes no difference, as for γ = 0 and γ = 1."""
    if discount in (0.0, 1.0):
        return torch.ones_like(power)
    return (power.clamp(min=torch.finfo(power.dtype).tiny).log() / math.log(discount)).round()


def drawn(batch: Batch, replica: int, problem: Problem, discount: float) -> TensorDict:
    """B rows of a replica, of a batch that a replay gave.

    `next` lies n steps later; its reward is the discounted sum up to there, and `steps_to_next_obs` is n, so that
    losses discount what lies behind by γⁿ.
    """
    power = batch.discount[replica].unsqueeze(-1)
    size, over = numbers_seen(problem), power == 0
    following = {
        "observation": encoded(batch.ahead[replica], size),
        "reward": batch.returns[replica].unsqueeze(-1).to(PRECISION),
        "terminated": over,
        "done": over,
    }
    seen = {"observation": encoded(batch.observation[replica], size), "action": batch.action[replica]}
    shape = power.shape[:1]
    spanned = steps_spanned(power, discount).to(PRECISION)
    return TensorDict({**seen, "steps_to_next_obs": spanned, "next": TensorDict(following, shape)}, shape)


def newest(windows: Windows, rewards: Tensor, problem: Problem) -> Iterator[TensorDict]:
    """All rows of each replica that were taken in the newest round, in the order in which they happened.

    `done` is where an episode ends, or where no more is known of it; `terminated` where nothing lies behind.

    Args:
        windows: of every replica. rewards: of their rows [R, n].
    """
    end, over = episode_ends(windows, problem.episodic)
    done = end == torch.arange(len(windows), device=end.device)
    counts = [len(windows)] * len(rewards) if windows.count is None else windows.count.tolist()
    size = numbers_seen(problem)
    for replica, count in enumerate(counts):
        part: tuple[int, slice | Tensor] = (replica, slice(count))
        if windows.fresh is not None:  # others are another policy's: their labels came late, or their window was open
            part = (replica, windows.fresh[replica, :count].nonzero().flatten())
            count = len(done[part])
        following = {
            "observation": encoded(windows.next_states[part], size),
            "reward": rewards[part].unsqueeze(-1).to(PRECISION),
            "terminated": over[part].unsqueeze(-1),
            "done": done[part].unsqueeze(-1),
        }
        seen = {"observation": encoded(windows.states[part], size), "action": windows.actions[part]}
        yield TensorDict({**seen, "next": TensorDict(following, [count])}, [count])
