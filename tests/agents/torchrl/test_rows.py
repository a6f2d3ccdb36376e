"""What TorchRL's losses are given, and the targets that they make of it, against naive second implementations."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

from credit.agents.torchrl.agent import TorchRL
from credit.agents.torchrl.rounds import judged, minibatches
from credit.agents.torchrl.rows import drawn, newest, steps_spanned
from credit.core.problem import FLOAT, Problem
from credit.core.windows import Episode, Windows
from credit.data.replay import Replay

DISCOUNT, TRACE = 0.9, 0.7
LENGTHS = [[3, 1, 4], [2, 5, 3]]  # of episodes; the second replica has more rows


def episodes(problem: Problem, seed: int = 0) -> tuple[Windows, Tensor]:
    """Episodes of any lengths, every other one terminated, and rewards of their rows."""
    generator = torch.Generator().manual_seed(seed)
    every = []
    for own in LENGTHS:
        made = []
        for k, length in enumerate(own):
            path = torch.randn(length + 1, 2, generator=generator)
            actions = torch.rand(length, 1, generator=generator) * 2 - 1
            made.append(Episode(path[:-1], actions, path[1:], k % 2 == 0))
        every.append(made)
    windows = Windows.of_episodes(every, torch.zeros(2, 3, dtype=FLOAT))
    return windows, torch.randn(windows.states.shape[:2], generator=generator, dtype=FLOAT)


def started(**keys: Any) -> tuple[TorchRL, Problem]:
    problem = Problem.vectors(2, 1, 9, (3, 4))
    agent = TorchRL(hidden=(5,), discount=DISCOUNT, **keys)
    agent.start(problem)
    return agent, problem


def test_advantages_by_hand() -> None:
    """A_t = Σ (γλ)ᵏ δ_{t+k} to the end of the episode; δ = r + γ V(s′) − V(s), V(s′) = 0 behind a terminated one."""
    agent, problem = started(loss="ppo", gae_lambda=TRACE)
    windows, rewards = episodes(problem)
    for replica, data in enumerate(newest(windows, rewards, problem)):
        loss = agent._learners[replica].loss
        with torch.no_grad(), loss.critic_network_params.to_module(loss.critic_network):
            value, behind = (
                loss.critic_network.module(data[key]).squeeze(-1) for key in ("observation", ("next", "observation"))
            )
        row = 0
        expected = []
        for k, length in enumerate(LENGTHS[replica]):
            for t in range(length):
                total = 0.0
                for j in range(t, length):
                    over = k % 2 == 0 and j == length - 1
                    at = row + j
                    delta = (
                        float(rewards[replica, at]) + (0 if over else DISCOUNT * float(behind[at])) - float(value[at])
                    )
                    total += (DISCOUNT * TRACE) ** (j - t) * delta
                expected.append(total)
            row += length
        found = judged(loss, data)
        torch.testing.assert_close(found["advantage"].squeeze(-1), torch.tensor(expected))
        torch.testing.assert_close(found["value_target"].squeeze(-1), torch.tensor(expected) + value)
        assert len(found) == sum(LENGTHS[replica])


def test_episodes_cut_into_windows_are_still_episodes() -> None:
    """Two windows an episode, or one: advantages are the same, and rows of an open episode are bootstrapped."""
    agent, problem = started(loss="ppo", gae_lambda=TRACE)
    windows, rewards = episodes(problem)
    last = torch.tensor([[1, 2, 3, 5, 7], [1, 4, 6, 8, 9]])
    cut = replace(windows, last=last, labels=torch.zeros(2, 5, dtype=FLOAT))
    for own, other, learner in zip(
        newest(windows, rewards, problem), newest(cut, rewards, problem), agent._learners, strict=True
    ):
        assert torch.equal(*(judged(learner.loss, data)["advantage"] for data in (own, other)))
    assert windows.ended is not None
    opened = replace(windows, ended=windows.ended & (torch.arange(10) < 7))
    data = list(newest(opened, rewards, problem))
    assert data[0]["next", "done"].flatten().tolist() == [False, False, True, True, False, False, False, True]
    assert data[1]["next", "done"].flatten().nonzero().flatten().tolist() == [1, 6, 9]


def test_log_probabilities_are_those_of_the_policy_that_acted() -> None:
    agent, problem = started(loss="ppo")
    states = torch.randn(2, 6, 2, generator=torch.Generator().manual_seed(0))
    actions = agent.act(states, torch.zeros(2, 6, dtype=torch.int64))
    windows = Windows.of_grid(
        *(part.unsqueeze(2) for part in (states, actions, states)), torch.zeros(2, 6, dtype=FLOAT)
    )
    for replica, data in enumerate(newest(windows, torch.zeros(2, 6), problem)):
        raw = agent._learners[replica].outputs(states[replica])
        loc, scale = agent._head._extract(raw)  # type: ignore[attr-defined]
        u = actions[replica].double().atanh()
        normal = torch.distributions.Normal(loc.double(), scale.double())
        expected = (normal.log_prob(u) - (1 - actions[replica].double().square()).log()).sum(-1)
        found = judged(agent._learners[replica].loss, data)["action_log_prob"]
        torch.testing.assert_close(found.double(), expected, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("n", [1, 3])
def test_targets_of_n_steps_by_hand(n: int) -> None:
    """Σ γᵏ r to n steps ahead or the end, then γⁿ Q⁻ of the target policy's action, unless it terminated there."""
    agent, problem = started(loss="td3", n_step=n, target_noise=0.0)
    windows, rewards = episodes(problem)
    replay = Replay(problem, n, DISCOUNT)
    replay.relabel(windows, rewards)
    (batch,) = replay.sample(40)
    for replica, learner in enumerate(agent._learners):
        data, loss = drawn(batch, replica, problem, DISCOUNT), learner.loss
        _, told = loss.value_loss(data)
        starts = [sum(LENGTHS[replica][:k]) for k in range(3)]
        for b in range(40):
            same = (windows.states[replica] == batch.observation[replica, b]).all(-1)
            row = int(same.nonzero()[0])
            k = max(i for i in range(3) if starts[i] <= row)
            end = min(starts[k] + LENGTHS[replica][k], row + n)
            goal = sum(DISCOUNT ** (j - row) * float(rewards[replica, j]) for j in range(row, end))
            if not (k % 2 == 0 and end == starts[k] + LENGTHS[replica][k]):
                goal += DISCOUNT ** (end - row) * float(told["next_state_value"][b])
            assert float(told["target_value"][b]) == pytest.approx(goal, rel=1e-4, abs=1e-5)


def test_steps_from_powers() -> None:
    steps = torch.arange(1.0, 60)
    for discount in (0.3, 0.9, 0.999):
        power = (discount ** steps.double()).float()
        assert torch.equal(steps_spanned(power, discount), steps)
    for discount in (0.0, 1.0):
        assert steps_spanned(torch.tensor([0.0, 1.0]), discount).tolist() == [1, 1]
    assert steps_spanned(torch.tensor([0.0]), 0.9).isfinite().all()


@pytest.mark.parametrize(("batch", "sizes"), [(4, [5, 5]), (3, [4, 3, 3]), (100, [10]), (10, [10])])
def test_minibatches_take_every_row_once_an_epoch(batch: int, sizes: list[int]) -> None:
    _, problem = started(loss="ppo")
    windows, rewards = episodes(problem)
    data = list(newest(windows, rewards, problem))[1]
    parts = list(minibatches(data, batch, 2))
    assert [len(part) for part in parts] == 2 * sizes
    for epoch in (parts[: len(sizes)], parts[len(sizes) :]):
        found = torch.cat([part["action"].flatten() for part in epoch])
        assert torch.equal(found.sort().values, data["action"].flatten().sort().values)
        assert not torch.equal(found, data["action"].flatten())
