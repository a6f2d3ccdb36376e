"""TorchRL: what was collected becomes windows, and what the replay buffer samples has recovered rewards.

Run:  python examples/torchrl_buffer.py
"""

from __future__ import annotations

import torch
from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer
from torchrl.envs import GymEnv, StepCounter, TransformedEnv

from credit.bridges.torchrl import Relabel, windows_of
from credit.core.problem import Problem
from credit.recovery.features.tabular import Identity
from credit.recovery.models.linear import LinearModel
from credit.recovery.recovery import Recovery
from credit.recovery.uncertainty.bootstrap import Bootstrap

STATES, ACTIONS, STEPS, WINDOW = 48, 4, 4_000, 10


def main() -> dict[int, float]:
    """Random steps beside a cliff: 1 is lost with each, and 100 with one that falls; labels are sums of ten."""
    env = TransformedEnv(GymEnv("CliffWalking-v1"), StepCounter(max_steps=50))
    env.set_seed(0)
    torch.manual_seed(0)
    rollout = env.rollout(STEPS, break_when_any_done=False)

    problem = Problem.finite(STATES, ACTIONS, window=WINDOW, seeds=(0,))
    recovery = Recovery(LinearModel("table", Identity(), Bootstrap(draws=4)))
    recovery.fit(windows_of(rollout, problem, WINDOW), problem)  # fit it again whenever there is more

    buffer = TensorDictReplayBuffer(storage=LazyTensorStorage(STEPS), batch_size=1_000)
    buffer.extend(rollout)
    true = buffer[:]["next", "reward"][:, 0]
    buffer.append_transform(Relabel(recovery, problem))
    recovered = buffer[:]["next", "reward"][:, 0]  # and so has every `buffer.sample()`
    means = {reward: float(recovered[true == reward].mean()) for reward in (-1, -100)}
    for reward, mean in means.items():
        print(f"steps that are worth {reward:4d}: {mean:8.2f} on average, recovered from sums over {WINDOW} steps")
    return means


if __name__ == "__main__":
    main()
