"""Environments of TorchRL: spaces, seeds, ends, what goes wrong, and going on in mid-episode."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Space
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import (
    Binary,
    Bounded,
    Categorical,
    Composite,
    MultiCategorical,
    MultiOneHot,
    NonTensor,
    OneHot,
    TensorSpec,
    Unbounded,
)
from torchrl.envs import Compose, EnvBase, PendulumEnv, RewardSum, SerialEnv, StepCounter, TransformedEnv

from credit.config import registry
from credit.core.errors import RunError, UserError
from credit.core.streams import reset_seed
from credit.envs.torchrl.environment import TorchRLEnvironment
from credit.envs.torchrl.specs import space
from credit.runs.checkpoint import only_data

SEEDS = (3, 4)
PENDULUM: dict[str, Any] = {"target": "torchrl.envs.PendulumEnv", "keys": ["thdot", "th"], "max_steps": 6}


class Drift(EnvBase):
    """Five places on a ring; action 1 goes on, and noise of torch's global generator, too; it misbehaves on demand.

    It terminates at place 4 with a reward of 1, and is cut short after six steps.
    """

    def __init__(self, trouble: str = "none", batch: tuple[int, ...] = (), succeeds: bool = False) -> None:
        super().__init__(batch_size=batch)
        self.trouble, self.succeeds = trouble, succeeds
        told = {"is_success": Categorical(2, shape=(*batch, 1), dtype=torch.bool)} if succeeds else {}
        self.observation_spec = Composite(place=OneHot(5, shape=(*batch, 5), dtype=torch.int64), **told, shape=batch)
        self.action_spec = Categorical(2, shape=batch)
        self.reward_spec = Unbounded((*batch, 2 if trouble == "rewards" else 1))
        flags = {name: Categorical(2, shape=(*batch, 1), dtype=torch.bool) for name in ("done", "terminated")}
        self.done_spec = Composite(**flags, truncated=flags["done"].clone(), shape=batch)

    def _set_seed(self, seed: int | None) -> None:
        pass

    def _found(self, **more: Tensor) -> TensorDict:
        place = torch.nn.functional.one_hot(torch.tensor(self._place), 5)
        told = {"is_success": torch.tensor([self._place == 4])} if self.succeeds else {}
        return TensorDict({"place": place, **told, **more}, ())

    def _reset(self, tensordict: TensorDictBase | None = None, **kwargs: Any) -> TensorDict:
        self._place, self._t = int(torch.randint(3, ())), 0
        return self._found()

    def _step(self, tensordict: TensorDictBase) -> TensorDict:
        self._t += 1
        if self.trouble == "raises" and self._t == 3:
            raise ArithmeticError("no third step")
        self._place = min(self._place + int(tensordict["action"]) * int(torch.randint(2, ())), 4)
        there, late = torch.tensor([self._place == 4]), torch.tensor([self._t == 6])
        flags = {"terminated": there, "truncated": late, "done": there | late}
        return self._found(reward=there.float(), **flags)


def counted(most: int) -> EnvBase:
    """A function as a target."""
    return TransformedEnv(Drift(), Compose(RewardSum(), StepCounter(max_steps=most)))


def lists() -> list[int]:
    return [1]


def many(count: int) -> EnvBase:
    return Drift(batch=(count,))


def serial(count: int) -> EnvBase:
    return SerialEnv(count, Drift)


@pytest.fixture(autouse=True)
def _quiet(recwarn: pytest.WarningsRecorder) -> None:
    """TorchRL looks for the old gym, which warns."""


def drift(**keys: Any) -> TorchRLEnvironment:
    return TorchRLEnvironment(f"{__name__}.Drift", **({"max_steps": 9} | keys))


@pytest.mark.parametrize(
    ("spec", "expected"),
    [
        (OneHot(4), Discrete(4)),
        (OneHot(4, shape=(2, 4)), MultiDiscrete([4, 4])),
        (Categorical(3), Discrete(3)),
        (Categorical(3, shape=(2,)), MultiDiscrete([3, 3])),
        (MultiOneHot([2, 3]), MultiDiscrete([2, 3])),
        (MultiCategorical([2, 3]), MultiDiscrete([2, 3])),
        (Binary(3), MultiBinary([3])),
        (Bounded(-2.0, 1.0, (2,)), Box(-2.0, 1.0, (2,))),
        (Bounded(0, 5, (2,), dtype=torch.int64), Box(0, 5, (2,), np.int64)),
        (Unbounded((3,)), Box(-np.inf, np.inf, (3,))),
        (Composite(a=OneHot(2), b=Composite(c=Unbounded((1,)))), Dict(a=Discrete(2), b=Dict(c=Box(-np.inf, np.inf)))),
    ],
)
def test_values_go_to_and_fro(spec: TensorSpec, expected: Space[Any]) -> None:
    found = space(spec)
    assert isinstance(spec, Composite) or found == expected
    assert type(found) is type(expected)
    value = spec.rand()
    assert found.contains(spec.to_numpy(value)) or spec.to_numpy(value).shape == ()
    if not isinstance(spec, Composite):
        assert torch.equal(spec.encode(np.asarray(spec.to_numpy(value))), value)


@pytest.mark.parametrize("spec", [NonTensor(()), Categorical(-1)])
def test_what_is_no_number_is_refused(spec: TensorSpec) -> None:
    with pytest.raises(UserError, match="learners see and do numbers"):
        space(spec)


def test_steps_are_those_of_the_environment_driven_by_hand() -> None:
    env = TorchRLEnvironment(**PENDULUM)
    problem = env.problem(None, SEEDS)
    assert (problem.observations, problem.actions, problem.horizon) == (2, 1, 6)
    env.start(problem, copies=2)
    alone = PendulumEnv()
    actions = torch.rand(6, 2, 2, 1, generator=torch.Generator().manual_seed(0)) * 2 - 1
    for episode in range(2):
        states = env.reset()
        alone.set_seed(reset_seed(4, "environment", 1, episode))
        now = alone.reset()
        for t, action in enumerate(actions):
            assert torch.equal(states[1, 1], torch.stack([now["thdot"], now["th"]]))
            out = env.step(action)
            then = alone.step(now.set("action", 2 * action[1, 1]))
            assert float(out.rewards[1, 1]) == float(then["next", "reward"])
            assert out.terminated is not None
            assert out.truncated is not None
            assert (bool(out.terminated.any()), bool(out.truncated.all())) == (False, t == 5)
            states, now = out.states, alone.step_mdp(then)


def test_numbers_are_numbers_and_both_ends_are_told_apart() -> None:
    env = drift(kwargs={"succeeds": True})
    problem = env.problem(None, SEEDS)
    assert (problem.states, problem.actions) == (5, 2)
    assert env.facts == ("success",)
    env.start(problem, copies=20)
    states, ones = env.reset(), torch.ones(2, 20, dtype=torch.int64)
    assert set(states.unique().tolist()) == {0, 1, 2}
    awake, ends = torch.ones(2, 20, dtype=torch.bool), []
    for step in range(6):
        out = env.step(ones, awake)
        assert out.terminated is not None
        assert out.truncated is not None
        there = (out.states == 4) & awake
        assert torch.equal(out.terminated, there)
        assert torch.equal(out.truncated, awake & ~there & (step == 5))
        assert torch.equal(out.facts["success"], there)
        assert torch.equal(out.rewards, there.double())
        ends.append((int(out.terminated.sum()), int(out.truncated.sum())))
        awake = awake & ~out.terminated & ~out.truncated
    assert not awake.any()
    assert all(sum(kind) > 0 for kind in zip(*ends, strict=True))


def test_episodes_depend_on_their_seeds_and_leave_torchs_generator_alone() -> None:
    """Also where an environment draws from it."""

    def lived(copies: int, stir: bool) -> list[Tensor]:
        env = drift()
        env.start(env.problem(None, SEEDS), copies)
        found = [env.reset()]
        for _ in range(5):
            if stir:
                torch.rand(3)
            found.append(env.step(torch.ones(2, copies, dtype=torch.int64)).states)
        return found

    before = torch.get_rng_state()
    plain = lived(3, stir=False)
    assert torch.equal(torch.get_rng_state(), before)
    for one, other in zip(plain, lived(5, stir=True), strict=True):
        assert torch.equal(one, other[:, :3])


def test_an_open_episode_is_played_again() -> None:
    one, other = drift(kwargs={"succeeds": True}), drift(kwargs={"succeeds": True})
    problem = one.problem(None, SEEDS)
    for env in (one, other):
        env.start(problem)
    actions = torch.tensor([[1], [0]])
    one.reset()
    for _ in range(8):
        out = one.step(actions)
        if (over := out.terminated | out.truncated).any():  # type: ignore[operator]
            one.reset(over)
    state = one.state_dict()
    only_data(state, "")
    other.load_state_dict(state)
    for _ in range(3):
        for mine, theirs in zip(one.step(actions)[:4], other.step(actions)[:4], strict=True):
            assert mine is not None
            assert theirs is not None
            assert torch.equal(mine, theirs)


@pytest.mark.parametrize(
    ("target", "keys", "horizon"),
    [
        ("torchrl.envs.GymEnv", {"kwargs": {"env_name": "CartPole-v1"}}, 500),
        (f"{__name__}:counted", {"kwargs": {"most": 7}}, 7),
        (f"{__name__}.Drift", {"max_steps": 4}, 4),
    ],
)
def test_a_time_limit_is_found(target: str, keys: dict[str, Any], horizon: int) -> None:
    env = TorchRLEnvironment(target, **keys)
    assert env.horizon == horizon
    assert env.twin().horizon == horizon


@pytest.mark.parametrize(
    ("target", "keys", "said"),
    [
        ("GymEnv", {}, r"env\.target='GymEnv' is no dotted path; give .*torchrl\.envs\.GymEnv"),
        ("torchrl.envs.NoEnv", {}, r"is not there: module 'torchrl\.envs' has no attribute 'NoEnv'"),
        ("nowhere.Env", {}, "is not there: No module named 'nowhere'"),
        (f"{__name__}.SEEDS", {}, "is a tuple, which makes nothing"),
        (f"{__name__}.lists", {}, r"gave a list, which is no torchrl\.envs\.EnvBase"),
        (f"{__name__}.many", {"kwargs": {"count": 3}}, r"already many \(batch_size \[3\].*env\.copies=3"),
        (f"{__name__}.serial", {"kwargs": {"count": 2}}, r"already many \(batch_size \[2\]"),
        (f"{__name__}.counted", {"kwargs": {"most": 3}, "keys": ["episode_reward"]}, "repeats the reward, which no"),
        (f"{__name__}.Drift", {"kwargs": {"trouble": "rewards"}}, r"has a reward of 2 numbers \[2\]"),
        (f"{__name__}.Drift", {"kwargs": {"nope": 1}}, r"made with \{'nope': 1\} cannot be made: TypeError"),
        (f"{__name__}.Drift", {"max_steps": None}, r"comes without a time limit.*env\.max_steps.*env\.horizon"),
        (f"{__name__}.Drift", {"keys": ["plase"]}, r"env\.keys: 'plase' is no observation.*did you mean 'place'"),
        (f"{__name__}.Drift", {"horizon": 5}, r"env\.max_steps=9 ends episodes, and env\.horizon=5.*one of the two"),
    ],
)
def test_what_cannot_be_made_is_said_before_the_start(target: str, keys: dict[str, Any], said: str) -> None:
    with pytest.raises(UserError, match=said):
        TorchRLEnvironment(target, **({"max_steps": 9} | keys)).problem(None, SEEDS)


def test_trouble_in_mid_episode_is_named() -> None:
    env = drift(kwargs={"trouble": "raises"})
    env.start(env.problem(None, SEEDS))
    env.reset()
    nothing = torch.zeros(2, 1, dtype=torch.int64)
    env.step(nothing)
    env.step(nothing)
    with pytest.raises(RunError, match=r"env\.target='.*Drift' raised in step, seed 3, copy 0 .*step 2: Arithmetic"):
        env.step(nothing)


def test_what_transforms_count_and_sum_up_is_not_seen() -> None:
    env = TorchRLEnvironment(f"{__name__}.counted", {"most": 4})
    assert env.problem(None, SEEDS).states == 5
    two = TorchRLEnvironment(f"{__name__}.counted", {"most": 4}, keys=["place", "step_count"])
    assert two.problem(None, SEEDS).observations == 5 + 1


@pytest.mark.thorough
def test_the_generic_experiment_goes_by_the_spaces() -> None:
    """And its folder by the target."""
    for keys, agent in ((["env.target=torchrl.envs.PendulumEnv", "env.max_steps=6"], "SAC"), (
        ["env.target=torchrl.envs.GymEnv", "env.kwargs={env_name: CartPole-v1}"], "DQN"), (
        ["env.target=torchrl.envs.GymEnv", "env.kwargs={env_name: FrozenLake-v1}"], "FiniteHorizon")):  # fmt: skip
        config = registry.compose(["env=torchrl", *keys, "method=reference"])
        assert config["agent"]["_target_"].rpartition(".")[2] == agent
        assert config["experiment"] == keys[0].partition("=")[2]


@pytest.mark.slow
def test_workers_step_what_this_process_would() -> None:
    def lived(workers: int) -> Tensor:
        env = TorchRLEnvironment(**PENDULUM, workers=workers)
        env.start(env.problem(None, SEEDS), copies=2)
        return torch.stack([env.reset(), *(env.step(torch.ones(2, 2, 1)).states for _ in range(5))])

    assert torch.equal(lived(0), lived(2))


def test_the_face_is_one_of_gymnasium() -> None:
    """Whoever likes may wrap it."""
    face = drift()._one
    assert isinstance(face, gymnasium.Env)
    first, info = face.reset(seed=1)
    assert (face.observation_space.contains(int(first)), info) == (True, {})
