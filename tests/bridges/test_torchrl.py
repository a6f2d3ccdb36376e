"""Recovered rewards in what a TorchRL replay buffer samples, and windows out of rollouts, beside loops."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from tensordict import TensorDict
from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer
from torchrl.envs import GymEnv

from credit.bridges.torchrl import Relabel, steps_of, windows_of
from credit.core.errors import Misfit, RunError, UserError
from credit.core.problem import Problem
from credit.core.steps import Steps
from credit.recovery.features.motion import Motion
from credit.recovery.features.tabular import Identity
from credit.recovery.models.linear import LinearModel
from credit.recovery.recovery import Recovery
from credit.recovery.scaler import Standard
from credit.recovery.uncertainty.bootstrap import Analytic, Bootstrap
from credit.rivals.rules import Uniform

VECTORS = Problem.vectors(3, 2, window=7, seeds=(0,))
NUMBERS = Problem.finite(5, 3, window=7, seeds=(0,))


def rollout(finite: bool = False, steps: int = 60) -> TensorDict:
    """What one environment did; episodes of 12 steps, of which every second one is cut by a time limit."""
    generator = torch.Generator().manual_seed(0)
    if finite:
        path = torch.nn.functional.one_hot(torch.randint(5, (steps + 1,), generator=generator), 5)
        actions = torch.nn.functional.one_hot(torch.randint(3, (steps,), generator=generator), 3)
        reward = path[:-1].argmax(-1) - actions.argmax(-1)
    else:
        path, actions = torch.randn(steps + 1, 3, generator=generator), torch.rand(steps, 2, generator=generator) - 0.5
        reward = path[:-1, 0] + actions[:, 1]
    done = (torch.arange(steps) % 12 == 11).unsqueeze(-1)
    terminated = done & (torch.arange(steps) % 24 == 11).unsqueeze(-1)
    ends = {"done": done, "terminated": terminated, "truncated": done & ~terminated}
    then = {"observation": path[1:], "reward": reward.float().unsqueeze(-1), **ends}
    return TensorDict({"observation": path[:-1], "action": actions, "next": then}, [steps])


def recovery(finite: bool = False, **keys: Any) -> Recovery:
    if finite:
        return Recovery(LinearModel("ridge", Identity(), Bootstrap(4)), **keys)
    return Recovery(LinearModel("linear", Motion(), Analytic(noise=0.1)), **keys)


@pytest.mark.parametrize("length", [1, 5, 7, None])
def test_windows_are_cut_as_by_hand(length: int | None) -> None:
    data, problem = rollout(), Problem.vectors(3, 2, window=12, seeds=(0,))
    windows = windows_of(data, problem, length)
    rewards, labels, lengths, run = data["next", "reward"][:, 0].tolist(), [], [], []
    for n, reward in enumerate(rewards):
        run.append(reward)
        if n % 12 == 11 or len(run) == length:
            labels.append(sum(run))
            lengths.append(len(run))
            run = []
    assert windows.labels[0].tolist() == pytest.approx(labels)
    assert windows.lengths[0].tolist() == lengths
    assert windows.times[0].tolist() == [n % 12 for n in range(sum(lengths))]
    assert windows.ended is not None
    assert windows.terminated is not None
    assert (windows.ended.sum(), windows.terminated.sum()) == (5, 3)
    recovery().fit(windows, problem)


def test_steps_behind_the_last_window_are_left_out() -> None:
    data = rollout()[:10]
    assert len(windows_of(data, VECTORS, 4)) == 8
    with pytest.raises(UserError, match="of these 10 steps no window of a whole episode is over"):
        windows_of(data, VECTORS)


@pytest.mark.parametrize("finite", [False, True])
def test_a_sample_has_the_assigners_rewards_and_the_buffer_keeps_its_own(finite: bool) -> None:
    data, problem = rollout(finite), NUMBERS if finite else VECTORS
    assigner = recovery(finite).fit(windows_of(data, problem, 4), problem)
    buffer = TensorDictReplayBuffer(storage=LazyTensorStorage(100), batch_size=32)
    buffer.extend(data)
    before = buffer[:]["next", "reward"].clone()
    buffer.append_transform(Relabel(assigner, problem))
    sample = buffer.sample()
    if finite:
        s, a, t = (sample[key].argmax(-1) for key in ("observation", "action", ("next", "observation")))
    else:
        s, a, t = (sample[key] for key in ("observation", "action", ("next", "observation")))
    wanted = assigner.believe(Steps(s, a, t)).plan[0]
    assert sample["next", "reward"].shape == (32, 1)
    assert sample["next", "reward"].dtype == torch.float32
    assert torch.equal(sample["next", "reward"][:, 0], wanted.float())
    windows = windows_of(data, problem, 4)
    every = buffer[:]["next", "reward"][:, 0]
    assert every.tolist() == pytest.approx(assigner.rewards(windows)[0].tolist(), abs=1e-5)
    assert torch.corrcoef(torch.stack([every, before[:, 0]]))[0, 1] > 0.9
    stored = buffer.storage[:]["next", "reward"] if hasattr(buffer, "storage") else buffer._storage[:]["next", "reward"]
    assert torch.equal(stored, before)


def test_a_new_fit_is_seen_by_the_next_batch() -> None:
    data = rollout()
    assigner = recovery().fit(windows_of(data, VECTORS, 4), VECTORS)
    relabel = Relabel(assigner, VECTORS)
    first = relabel(data)["next", "reward"]
    data["next", "reward"].mul_(3)
    assigner.fit(windows_of(data, VECTORS, 4), VECTORS)
    assert torch.allclose(relabel(data)["next", "reward"], 3 * first, atol=1e-4)


def test_batches_have_any_shape_and_may_be_read_by_a_function_of_ones_own() -> None:
    data = rollout()
    assigner = recovery().fit(windows_of(data, VECTORS, 4), VECTORS)
    flat = Relabel(assigner, VECTORS)(data)["next", "reward"]
    assert torch.equal(Relabel(assigner, VECTORS)(data.reshape(12, 5))["next", "reward"], flat.view(12, 5, 1))
    other = TensorDict({"s": data["observation"], "a": 9 * data["action"], "r": torch.zeros(60)}, [60])

    def read(batch: TensorDict) -> Steps:
        return Steps(batch["s"], batch["a"] / 9, batch["s"])

    assert torch.allclose(Relabel(assigner, VECTORS, read, "r")(other)["r"], flat[:, 0], atol=1e-6)


def test_a_rollout_of_an_environment_is_read_as_it_comes() -> None:
    env = GymEnv("CartPole-v1")
    env.set_seed(0)
    data = env.rollout(200, break_when_any_done=False)
    problem = Problem(env_space := Problem.vectors(4, 2, 20, (0,)).observation_space, NUMBERS.action_space, 20, (0,),
                      torch.device("cpu"))  # fmt: skip
    steps = steps_of(data, problem)
    assert env_space.shape == steps.states.shape[1:]
    assert steps.actions.unique().tolist() == [0, 1]
    windows = windows_of(data, problem, 20)
    assert torch.equal(windows.labels.long(), windows.lengths)  # every step is worth 1


def test_what_cannot_be_done_is_said() -> None:
    with pytest.raises(UserError, match="Uniform shares out the labels of windows, and knows no reward of other"):
        Relabel(Uniform(), VECTORS)
    with pytest.raises(UserError, match="the scaler of Recovery scales the rows of its windows"):
        Relabel(recovery(scaler=Standard()), VECTORS)
    with pytest.raises(Misfit, match=r"assigner\.reference\.features: Motion needs states that are vectors"):
        Relabel(recovery(), NUMBERS)
    with pytest.raises(UserError, match="has seen no windows yet"):
        Relabel(recovery(), VECTORS)(rollout())
    data = rollout()
    data["action"] = 4 * data["action"]
    with pytest.raises(UserError, match=r"an action has the number 1\.\d+, and here they lie in \[-1, 1\]"):
        windows_of(data, VECTORS, 4)
    env = GymEnv("Pendulum-v1").append_transform(Relabel(recovery(), VECTORS))
    with pytest.raises(RunError, match="Relabel works in replay buffers"):
        env.rollout(2)
