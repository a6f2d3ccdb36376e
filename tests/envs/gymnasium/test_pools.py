"""Environments of EnvPool: each episode is that of a pool with its seed; limits, and going on in mid-episode."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from credit.core.errors import UserError
from credit.core.streams import reset_seed
from credit.envs.gymnasium.environment import Gymnasium
from credit.envs.gymnasium.pools import LARGEST

SEEDS = (3, 4)
installed = pytest.mark.skipif("not __import__('importlib').util.find_spec('envpool')", reason="envpool is not there")
pytestmark = [pytest.mark.thorough]


def pooled(id: str = "CartPole-v1", **keys: Any) -> Gymnasium:
    return Gymnasium(id, backend="envpool", **keys)


@installed
@pytest.mark.filterwarnings("ignore:.*precision lowered")
def test_steps_are_those_of_a_pool_driven_by_hand() -> None:
    import envpool

    env = pooled()
    problem = env.problem(None, SEEDS)
    assert (problem.observations, problem.actions, problem.horizon) == (4, 2, 500)
    env.start(problem, copies=2)
    for episode in range(2):
        seed = reset_seed(4, "environment", 1, episode) % LARGEST
        alone = envpool.make("CartPole-v1", env_type="gymnasium", num_envs=1, seed=seed)
        states, (seen, _), steps, over = env.reset(), alone.reset(), 0, False
        while not over:
            assert np.array_equal(states[1, 1].numpy(), seen[0])
            ones = torch.ones(2, 2, dtype=torch.int64)
            out = env.step(ones, torch.tensor([[False, False], [False, True]]))
            seen, reward, terminated, truncated, _ = alone.step(np.ones(1, dtype=np.int64))
            assert out.terminated is not None
            assert out.truncated is not None
            said = float(out.rewards[1, 1]), bool(out.terminated[1, 1]), bool(out.truncated[1, 1])
            assert said == (float(reward[0]), bool(terminated[0]), bool(truncated[0]))
            states, over, steps = out.states, bool(terminated[0]), steps + 1
        assert 5 < steps < 20


def lived(copies: int, **keys: Any) -> list[Tensor]:
    env = pooled("Pendulum-v1", **keys)
    env.start(env.problem(None, SEEDS), copies)
    found = [env.reset()]
    for _ in range(5):
        out = env.step(torch.ones(2, copies, 1))
        found.append(out.states)
        if (over := out.truncated) is not None and over.any():
            found.append(env.reset(over))
    return found


@installed
def test_an_episode_depends_on_its_seed_alone_and_ends_where_it_is_to() -> None:
    for one, other in zip(lived(2, max_steps=3), lived(3, max_steps=3), strict=True):
        assert torch.equal(one, other[:, :2])
    assert len(lived(1, max_steps=3)) == 7
    assert len(lived(1, horizon=3)) == 6


@installed
def test_an_open_episode_is_played_again() -> None:
    one, other = pooled("Pendulum-v1", max_steps=4), pooled("Pendulum-v1", max_steps=4)
    problem = one.problem(None, SEEDS)
    for env in (one, other):
        env.start(problem)
    actions = torch.tensor([[[0.5]], [[-1.0]]])
    one.reset()
    for _ in range(6):
        if (over := one.step(actions).truncated) is not None and over.any():
            one.reset(over)
    other.load_state_dict(one.state_dict())
    assert torch.equal(one.step(actions).states, other.step(actions).states)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        (
            {"wrappers": ["ClipReward"]},
            r"env\.wrappers=\['ClipReward'\]: EnvPool's environments are stepped in its own",
        ),
        ({"workers": 2}, r"env\.workers=2: EnvPool's environments"),
        ({"id": "CartPole-v9"}, r"EnvPool has no such environment; did you mean 'CartPole-v1'"),
        ({"kwargs": {"nope": 1}}, r"made with \{'nope': 1\} cannot be made"),
    ],
)
@installed
def test_what_cannot_be_is_said_before_the_start(keys: dict[str, Any], said: str) -> None:
    with pytest.raises(UserError, match=said):
        pooled(**keys).problem(None, SEEDS)


def test_where_it_is_not_installed_that_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "envpool", None)
    with pytest.raises(UserError, match=r"env\.backend=envpool needs the package envpool.*credit-rl\[envpool\]"):
        pooled().problem(None, SEEDS)
