"""What SAC's updates are measured against: matrix products alone, plain PyTorch, TorchRL's and other people's loops.

Each function returns one that does `UPDATES` updates of 256×256 networks on batches of 256, drawn from 10,000
transitions of 4 observed numbers and 2 actions.
"""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium
import numpy as np
import torch
import torch.nn.functional as F
from tensordict import TensorDict
from torch import Tensor, nn
from torchrl.data import Bounded, LazyTensorStorage, TensorDictReplayBuffer
from torchrl.objectives import SACLoss, SoftUpdate, ValueEstimators

from credit.agents.sac.networks import CRITICS, actor_module, critic_module
from credit.core.windows import Windows
from credit.networks.stack import Shape

ROWS, LENGTH, BATCH, WIDTH, UPDATES = 10_000, 100, 256, 256, 64
KEYS = ("observation", "action", ("next", "observation"))
ACTOR, CRITIC = Shape(4, 4, WIDTH, 2), Shape(6, 1, WIDTH, 2)
RATE, TAU, GAMMA = 3e-4, 0.005, 0.99

Updates = Callable[[], object]


def transitions() -> TensorDict:
    """Random rows; 1 in 100 ends at the goal."""
    generator = torch.Generator().manual_seed(0)
    end = (torch.arange(ROWS) % 100 == 99).unsqueeze(-1)
    ends = {"done": end, "terminated": end, "truncated": torch.zeros_like(end), "success": end}
    following = {"observation": torch.randn(ROWS, 4, generator=generator), "reward": end.float(), **ends}
    observation, action = torch.randn(ROWS, 4, generator=generator), torch.rand(ROWS, 2, generator=generator) * 2 - 1
    ids = {"traj_ids": torch.arange(ROWS) // 100}
    return TensorDict({"observation": observation, "action": action, "next": following, "collector": ids}, [ROWS])


def windows(rows: TensorDict, replicas: int) -> Windows:
    """Those rows as trajectories of `LENGTH` steps, the same for all replicas; only the last step is a success."""
    states, actions, arrivals = (rows[key].expand(replicas, -1, -1).unflatten(1, (-1, LENGTH)) for key in KEYS)
    return Windows.of_grid(states, actions, arrivals, torch.ones(replicas, ROWS // LENGTH))


def repeated(update: Callable[[], None]) -> None:
    """`UPDATES` of them."""
    for _ in range(UPDATES):
        update()


def products() -> Updates:
    """The matrix products of an update, with results in memory that is there already: the floor."""
    jobs: list[tuple[Tensor, Tensor, Tensor]] = []

    def product(members: int, rows: int, inner: int, columns: int) -> None:
        shapes = (rows, inner), (inner, columns), (rows, columns)
        jobs.append(tuple(torch.randn(members, *shape) for shape in shapes))  # type: ignore[arg-type]

    def forward(shape: Shape, members: int) -> None:
        for inputs, outputs in shape.sizes:
            rows, columns = (BATCH, outputs) if outputs > 1 else (1, BATCH)
            product(members, rows, inputs, columns)

    def backward(shape: Shape, members: int, weights: bool, inputs: int) -> None:
        for place, (below, above) in enumerate(shape.sizes):
            if weights:
                product(members, above, BATCH, below)
            if place or inputs:
                product(members, BATCH, above, below if place else inputs)

    for shape, members in ((ACTOR, 1), (CRITIC, CRITICS), (CRITIC, CRITICS), (ACTOR, 1), (CRITIC, CRITICS)):
        forward(shape, members)  # target: actor and critics; critics; actor's loss: actor and critics
    backward(CRITIC, CRITICS, weights=True, inputs=0)
    backward(CRITIC, CRITICS, weights=False, inputs=2)
    backward(ACTOR, 1, weights=True, inputs=0)

    def work() -> None:
        for _ in range(UPDATES):
            for a, b, out in jobs:
                torch.bmm(a, b, out=out)

    return work


def plain() -> Updates:
    """What one would write with PyTorch alone, with its fused Adam."""

    def mlp(inputs: int, outputs: int) -> nn.Sequential:
        hidden = nn.Sequential(nn.Linear(inputs, WIDTH), nn.ReLU(), nn.Linear(WIDTH, WIDTH), nn.ReLU())
        return hidden.append(nn.Linear(WIDTH, outputs))

    actor, critics, targets = mlp(4, 4), [mlp(6, 1) for _ in range(2)], [mlp(6, 1) for _ in range(2)]
    weights = [p for critic in critics for p in critic.parameters()]
    followers = [p for target in targets for p in target.parameters()]
    log_alpha = torch.zeros((), requires_grad=True)
    by_actor, by_critic, by_alpha = (
        torch.optim.Adam(parameters, RATE, fused=True)
        for parameters in (list(actor.parameters()), weights, [log_alpha])
    )
    data = transitions()
    state, action, ahead = data["observation"], data["action"], data["next", "observation"]
    reward, going = data["next", "reward"], (~data["next", "terminated"]).float()

    def sample(states: Tensor) -> tuple[Tensor, Tensor]:
        loc, raw = actor(states).chunk(2, -1)
        scale = F.softplus(raw) + 1e-4
        noise = torch.randn_like(loc)
        u = loc + scale * noise
        density = -0.5 * noise.square() - scale.log() - 0.5 * math.log(2 * math.pi)
        return u.tanh(), (density - 2 * (math.log(2) - u - F.softplus(-2 * u))).sum(-1, keepdim=True)

    def update() -> None:
        rows = torch.randint(ROWS, (BATCH,))
        s = state[rows]
        with torch.no_grad():
            alpha = log_alpha.exp()
            following, log_prob = sample(ahead[rows])
            x = torch.cat([ahead[rows], following], -1)
            q = torch.minimum(*(target(x) for target in targets))
            y = reward[rows] + GAMMA * going[rows] * (q - alpha * log_prob)
        x = torch.cat([s, action[rows]], -1)
        loss: Any = sum(F.mse_loss(critic(x), y) for critic in critics)
        by_critic.zero_grad()
        loss.backward()
        by_critic.step()
        sampled, log_prob = sample(s)
        for p in weights:
            p.requires_grad_(False)
        x = torch.cat([s, sampled], -1)
        by_actor.zero_grad()
        (alpha * log_prob - torch.minimum(*(critic(x) for critic in critics))).mean().backward()
        by_actor.step()
        for p in weights:
            p.requires_grad_(True)
        by_alpha.zero_grad()
        (-log_alpha * (log_prob.detach() - 2).mean()).backward()
        by_alpha.step()
        with torch.no_grad():
            torch._foreach_lerp_([*followers], [*weights], TAU)

    return partial(repeated, update)


def torchrl() -> Updates:
    """TorchRL's replay buffer and SACLoss, as its examples have them: one summed loss, Adam, SoftUpdate."""
    loss = SACLoss(
        actor_module(ACTOR),
        critic_module(CRITIC),
        num_qvalue_nets=2,
        loss_function="l2",
        delay_qvalue=True,
        target_entropy=-2.0,
        action_spec=Bounded(-1, 1, (2,)),
    )
    loss.make_value_estimator(ValueEstimators.TD0, gamma=GAMMA)
    updater = SoftUpdate(loss, tau=TAU)
    optimizer = torch.optim.Adam(loss.parameters(), RATE)
    buffer = TensorDictReplayBuffer(storage=LazyTensorStorage(ROWS), batch_size=BATCH)
    buffer.extend(transitions())

    def update() -> None:
        values = loss(buffer.sample())
        (values["loss_actor"] + values["loss_qvalue"] + values["loss_alpha"]).backward()
        optimizer.step()
        optimizer.zero_grad()
        updater.step()

    return partial(repeated, update)


class Box(gymnasium.Env):
    """Spaces, for a library that wants an environment to learn sizes from."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (4,), np.float32)
    action_space = gymnasium.spaces.Box(-1, 1, (2,), np.float32)


def stable_baselines() -> Updates | None:
    """Stable-Baselines3, or None where it is not installed."""
    if importlib.util.find_spec("stable_baselines3") is None:
        return None
    from stable_baselines3 import SAC
    from stable_baselines3.common.logger import Logger

    model = SAC("MlpPolicy", Box(), RATE, ROWS, batch_size=BATCH, tau=TAU, gamma=GAMMA, device="cpu")
    model.set_logger(Logger(None, []))
    rows = transitions()
    parts = [rows[key].numpy() for key in ("observation", ("next", "observation"), "action")]
    reward, done = rows["next", "reward"][:, 0].numpy(), rows["next", "terminated"][:, 0].numpy()
    for k in range(ROWS):
        model.replay_buffer.add(*(part[k : k + 1] for part in parts), reward[k : k + 1], done[k : k + 1], [{}])
    return lambda: model.train(gradient_steps=UPDATES, batch_size=BATCH)
