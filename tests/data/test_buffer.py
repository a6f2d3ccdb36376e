"""The TorchRL face of a replay: TorchRL's own losses find the targets that ours have; nothing is copied."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from tensordict.nn import TensorDictModule
from torchrl.data.replay_buffers.samplers import SamplerWithoutReplacement
from torchrl.objectives import DDPGLoss, SoftUpdate, ValueEstimators
from torchrl.objectives.value import TD0Estimator

from credit.core.problem import Problem
from credit.core.windows import Windows
from credit.data.buffer import torchrl_buffer
from credit.data.replay import Replay

LENGTHS = [[7, 3, 1, 5], [2, 4, 4, 1]]
LABELS = [[1.0, 0.0, 1.0, 0.0], [0.0, 0.0, 1.0, 0.0]]


@pytest.fixture
def replay(make_trajectories: Callable[..., Windows]) -> Replay:
    windows = make_trajectories(LENGTHS, LABELS)
    replay = Replay(Problem.vectors(4, 2, 9, (0, 1)), n_step=3, discount=0.9, capacity=3)
    replay.relabel(windows, windows.states.sum(-1))
    return replay


@pytest.mark.parametrize("replica", [0, 1])
def test_every_remembered_row_is_drawn_once(replay: Replay, replica: int) -> None:
    buffer = torchrl_buffer(replay, 4, replica, SamplerWithoutReplacement())
    first, size = replay.span(replica)
    assert len(buffer) == size == sum(LENGTHS[replica][1:])
    drawn = torch.cat([buffer.sample()["observation"] for _ in range(-(-size // 4))])[:size]
    kept = replay.windows.states[replica, first : first + size]
    assert {tuple(row) for row in drawn.tolist()} == {tuple(row) for row in kept.tolist()}


@pytest.mark.parametrize("replica", [0, 1])
def test_targets_of_torchrl_are_ours(replay: Replay, replica: int) -> None:
    """n-step rewards, γⁿ, and no value behind an end: TD(0) of TorchRL, with a value network of its own."""
    value = TensorDictModule(torch.nn.Linear(4, 1), in_keys=["observation"], out_keys=["state_value"])
    buffer = torchrl_buffer(replay, 5, replica)
    first, size = replay.span(replica)
    rows = buffer[:]
    target = TD0Estimator(gamma=0.9, value_network=value).value_estimate(rows).squeeze(-1)
    batch = replay.at(torch.arange(first, first + size), replica)
    ahead = value.module(batch.ahead).squeeze(-1)
    torch.testing.assert_close(target, batch.returns + batch.discount * ahead)
    ends = torch.tensor(LENGTHS[replica]).cumsum(0) - 1 - first
    last_rows = rows[ends[ends >= 0]]
    assert last_rows["next", "done"].all()
    assert last_rows["next", "terminated"].flatten().tolist() == [bool(label) for label in LABELS[replica][1:]]
    assert (batch.discount == 0).tolist() == rows["next", "terminated"].flatten().tolist()


def test_a_loss_of_torchrl_learns_from_it(replay: Replay) -> None:
    actor = TensorDictModule(torch.nn.Linear(4, 2), in_keys=["observation"], out_keys=["action"])
    both = torch.nn.Bilinear(4, 2, 1)
    critic = TensorDictModule(both, in_keys=["observation", "action"], out_keys=["state_action_value"])
    loss = DDPGLoss(actor, critic)
    loss.make_value_estimator(ValueEstimators.TD0, gamma=0.9)
    SoftUpdate(loss, tau=0.005)  # otherwise TorchRL warns
    found = loss(torchrl_buffer(replay, 8).sample())
    found["loss_value"].backward()
    assert all(p.grad is None or p.grad.isfinite().all() for p in loss.parameters())
    assert any(p.grad is not None and p.grad.abs().sum() > 0 for p in loss.value_network_params.values(True, True))


def test_it_follows_the_replay_and_takes_nothing_itself(
    replay: Replay, make_trajectories: Callable[..., Windows]
) -> None:
    buffer = torchrl_buffer(replay, 4)
    before = buffer[:]
    replay.relabel(replay.windows, 2 * replay.rewards)
    torch.testing.assert_close(buffer[:]["next", "reward"], 2 * before["next", "reward"])
    for write in (lambda: buffer.extend(before), buffer.empty):
        with pytest.raises(RuntimeError, match="doesn't allow writing"):
            write()
    with pytest.raises(TypeError, match="rows are the store's"):
        buffer.storage.set(0, before[0])
