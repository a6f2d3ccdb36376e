"""Rewards in the replay buffer of Stable-Baselines3's agents, beside a naive computation of what they must be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Dict, Discrete

from credit.core.errors import Misfit, UserError
from credit.core.problem import FLOAT, Problem
from credit.core.seams import CreditAssigner
from credit.core.steps import Steps
from credit.core.store import Store
from credit.core.windows import Windows
from credit.envs import DelayedReward
from credit.envs.feedback import BlockSum
from credit.recovery.features.motion import Motion
from credit.recovery.features.tabular import Identity
from credit.recovery.models.linear import LinearModel
from credit.recovery.recovery import Recovery
from credit.recovery.scaler import Standard
from credit.recovery.uncertainty.bootstrap import Analytic, Bootstrap
from credit.rivals.rules import Delayed, Uniform

sb3 = pytest.importorskip("stable_baselines3")
from stable_baselines3.common.callbacks import BaseCallback  # noqa: E402
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize  # noqa: E402

from credit.bridges.sb3 import Relabel  # noqa: E402

Rows = list[tuple[Any, Any, Any, float, bool, bool, dict[str, Any]]]


class Walk(gymnasium.Env[Any, Any]):
    """A place and a push; over after 11 to 15 steps, every second time by a time limit. It notes all that happens."""

    def __init__(self, finite: bool = False, start: int = 0) -> None:
        self.observation_space = Discrete(6) if finite else Box(-np.inf, np.inf, (2,), np.float32)
        self.action_space = Discrete(3) if finite else Box(-2.0, 3.0, (1,), np.float32)
        self.finite, self._episode, self.rows = finite, start, Rows()

    def _seen(self) -> Any:
        return int(abs(self._at)) % 6 if self.finite else np.array([self._at, self._t / 10], np.float32)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self._episode += 1
        self._at, self._t = float(self._episode % 3), 0
        self._last = self._seen()
        return self._last, {}

    def step(self, action: Any) -> Any:
        push = float(action) if self.finite else float(action[0])
        self._at, self._t = 0.9 * self._at + push, self._t + 1
        reward, over = 0.25 * round(4 * self._at) + 0.5, self._t == 10 + self._episode % 5 + 1
        limit = over and self._episode % 2 == 0
        row = self._last, action, self._seen(), reward, over and not limit, limit, {}
        self.rows.append(row)
        self._last = row[2]
        return row[2], reward, row[4], row[5], {"reward_walk": reward}


def recovery(finite: bool = False) -> Recovery:
    if finite:
        return Recovery(LinearModel("ridge", Identity(), Bootstrap(4)))
    return Recovery(LinearModel("linear", Motion(), Analytic(noise=0.1)))


def agent(envs: Sequence[gymnasium.Env[Any, Any]], **keys: Any) -> Any:
    vector = DummyVecEnv([lambda env=env: env for env in envs])
    finite = isinstance(vector.action_space, Discrete)
    policy = "MultiInputPolicy" if isinstance(vector.observation_space, Dict) else "MlpPolicy"
    keys = {"learning_starts": 180, "batch_size": 8, "buffer_size": 1_000, **keys}
    small = {"net_arch": [8]}
    return (sb3.DQN if finite else sb3.SAC)(policy, vector, seed=0, policy_kwargs=small, device="cpu", **keys)


def cut(rows: Rows, length: int | None) -> list[tuple[int, int]]:
    """(first, end) of the windows of rows, in their order; one that is open is left out."""
    found, first = [], 0
    for n, row in enumerate(rows):
        if row[4] or row[5] or n + 1 - first == length:
            found.append((first, n + 1))
            first = n + 1
    return found


def stacked(rows: Rows, finite: bool) -> tuple[torch.Tensor, ...]:
    if finite:
        return tuple(torch.tensor([int(row[n]) for row in rows])[None] for n in range(3))
    states, actions, then = (torch.tensor(np.stack([row[n] for row in rows])).float()[None] for n in range(3))
    return states, 2 * (actions + 2) / 5 - 1, then


def expected(envs: Sequence[Walk], length: int | None, every: int, assigner: CreditAssigner, most: int) -> np.ndarray:
    """Rewards [steps, envs] of all rows, by loops: windows in the order in which they end, fitted every so often."""
    finite, count = envs[0].finite, len(envs[0].rows)
    kind = Problem.finite(6, 3, most, (0,)) if finite else Problem.vectors(2, 1, most, (0,))
    problem = Problem(
        kind.observation_space, kind.action_space, most, (0,), torch.device("cpu"), episodic=length is None
    )
    store = Store(problem)
    assigner.start(problem)
    ends = sorted((end, e, first) for e, env in enumerate(envs) for first, end in cut(env.rows, length))
    found, places, since = np.zeros((count, len(envs))), list[tuple[int, int]](), 0
    done = 0
    for step in range(1, count + 1):
        since += len(envs)
        if since < every or step % (4 if finite else 1):  # DQN learns in every fourth step
            continue
        since, new = 0, [one for one in ends[done:] if one[0] <= step]
        done += len(new)
        rows = [row for end, e, first in new for row in envs[e].rows[first:end]]
        places += [(n, e) for end, e, first in new for n in range(first, end)]
        lengths = torch.tensor([end - first for end, _, first in new])
        labels = [sum(row[3] for row in envs[e].rows[first:end]) for end, e, first in new]
        last = (lengths.cumsum(0) - 1)[None]
        flags = {name: torch.tensor([[bool(row[4] or row[n]) for row in rows]]) for name, n in
                 (("ended", 5), ("terminated", 4))}  # fmt: skip
        times = torch.cat([_times(envs[e].rows)[first:end] for end, e, first in new])[None]
        label = torch.tensor([labels], dtype=FLOAT)
        store.append(Windows(*stacked(rows, finite), times, labels=label, last=last, **flags))
        assigner.observe(store)
        rewards = assigner.rewards(store.windows)[0]
        for (n, e), reward in zip(places, rewards.tolist(), strict=True):
            found[n, e] = reward
    for e, env in enumerate(envs):  # of windows that are open, or not yet fitted
        for n in {*range(count)} - {n for n, copy in places if copy == e}:
            if isinstance(assigner, Recovery):
                one = [part[0] for part in stacked(env.rows[n : n + 1], finite)]
                found[n, e] = float(assigner.believe(Steps(*one, _times(env.rows)[n : n + 1])).plan[0])
            else:
                found[n, e] = float(store.windows.labels.mean() * len(store) / len(places))
    return found


def _times(rows: Rows) -> torch.Tensor:
    found, t = [], 0
    for row in rows:
        found.append(t)
        t = 0 if row[4] or row[5] else t + 1
    return torch.tensor(found)


CASES: list[tuple[bool, int, int | None, dict[str, Any]]] = [
    (False, 1, 5, {}),
    (False, 3, 4, {"buffer_size": 3 * 60}),  # rows are overwritten
    (True, 1, 5, {"buffer_size": 70}),
    (True, 2, None, {}),
    (False, 1, None, {"optimize_memory_usage": True, "buffer_size": 90,
                      "replay_buffer_kwargs": {"handle_timeout_termination": False}}),
    (False, 1, 5, {"n_steps": 3}),
]  # fmt: skip


@pytest.mark.parametrize(("finite", "copies", "length", "keys"), CASES)
@pytest.mark.parametrize("make", [recovery, lambda finite: Uniform()])
def test_rewards_are_the_assigners(
    finite: bool, copies: int, length: int | None, keys: dict[str, Any], make: Callable[..., CreditAssigner]
) -> None:
    envs = [Walk(finite, start) for start in range(copies)]
    model, relabel = agent(envs, **keys), Relabel(make(finite), length, every=50, longest=15)
    model.learn(240, callback=relabel)
    buffer, wanted = model.replay_buffer, expected(envs, length, 50, make(finite), length or 15)
    count = len(envs[0].rows)
    assert count == 240 // copies
    assert buffer.full == (buffer.buffer_size < count)
    kept = range(max(0, count - buffer.buffer_size), count)
    for n in kept:
        assert buffer.rewards[n % buffer.buffer_size] == pytest.approx(wanted[n], abs=1e-6), n
    assert (wanted[-5:] != 0).all()  # still open, or not yet fitted
    assert np.abs(wanted).sum() > 10
    assert len(relabel.store) > 5
    windows = relabel.store.windows
    assert windows.terminated is not None
    assert windows.ended is not None
    assert 0 < int(windows.terminated.sum()) < int(windows.ended.sum())


def test_the_true_reward_never_reaches_the_buffer() -> None:
    class Watch(BaseCallback):
        """Looks at all that was ever in the buffer."""

        def _on_step(self) -> bool:
            seen.update(np.unique(self.model.replay_buffer.rewards).tolist())
            return True

    class Loud(gymnasium.RewardWrapper[Any, Any]):
        """Another reward with the same sums over windows of 5 steps, and labels."""

        def reward(self, reward: Any) -> Any:
            self.n = getattr(self, "n", 0) + 1
            return reward + (1_000, -2_000, 0, 500, 500)[(self.unwrapped._t - 1) % 5]  # type: ignore[attr-defined]

    found = []
    for wrap in (lambda env: env, Loud):
        seen: set[float] = set()
        env = DelayedReward(wrap(Walk()), BlockSum(5, 0.0, cut="drop"))
        model = agent([env], learning_starts=80)
        model.learn(150, callback=[Watch(), Relabel(recovery(), every=40)])
        assert max(map(abs, seen)) < 100
        found.append((model.replay_buffer.rewards.copy(), model.replay_buffer.actions.copy(), seen))
    assert np.array_equal(found[0][0], found[1][0])
    assert np.array_equal(found[0][1], found[1][1])


def test_labels_of_the_wrapper_are_those_that_are_fitted() -> None:
    plain, wrapped = Walk(), Walk()
    one, other = Relabel(recovery(), 5, every=50), Relabel(recovery(), every=50)
    first = agent([plain]).learn(200, callback=one)
    second = agent([DelayedReward(wrapped, BlockSum(5, 0.0))]).learn(200, callback=other)
    assert torch.equal(one.store.windows.labels, other.store.windows.labels)
    assert np.array_equal(first.replay_buffer.rewards, second.replay_buffer.rewards)


@pytest.mark.parametrize(("assigner", "predicts"), [(recovery(), True), (Delayed(), False)])
def test_rows_without_a_label_get_what_is_predicted(assigner: CreditAssigner, predicts: bool) -> None:
    env = Walk()
    model, relabel = agent([DelayedReward(env, BlockSum(5, 0.0, cut="drop"))]), Relabel(assigner, every=100)
    model.learn(200, callback=relabel)
    rows = env.rows[:200]
    for first, end in cut(rows, 5):
        found = model.replay_buffer.rewards[first:end, 0]
        if end - first < 5 and predicts:
            states, actions, then = (part[0] for part in stacked(rows[first:end], False))
            wanted = assigner.believe(Steps(states, actions, then)).plan[0]  # type: ignore[attr-defined]
            assert found == pytest.approx(wanted.numpy(), abs=1e-6)
        elif end - first < 5:
            assert (found == 0).all()
    assert len(relabel.store) == sum(end - first == 5 for first, end in cut(rows, 5))


def test_learning_goes_on_where_it_was_or_from_a_reset() -> None:
    envs = [Walk(True), Walk(True)]
    model = agent([envs[0]])
    relabel = Relabel(recovery(True), 5, every=50)
    model.learn(103, callback=relabel)
    assert len(relabel.store) > 0
    model.learn(97, callback=relabel, reset_num_timesteps=False)
    whole = agent([envs[1]])
    whole.learn(200, callback=(other := Relabel(recovery(True), 5, every=50)))
    assert torch.equal(relabel.store.windows.labels[:, :10], other.store.windows.labels[:, :10])
    before = len(relabel.store)
    model.learn(100, callback=relabel)  # from a reset: the open window has no label
    assert len(relabel.store) > before
    fresh = agent([Walk(True)])
    fresh.learn(60, callback=relabel)
    assert len(relabel.store) < 20  # another buffer


@pytest.mark.parametrize("wrapped", [False, True])
def test_a_row_that_another_callback_keeps_out_of_the_buffer_spoils_no_label(wrapped: bool) -> None:
    class Stop(BaseCallback):
        """Ends the training between a step and the buffer."""

        def _on_step(self) -> bool:
            return self.num_timesteps not in (63, 114)

    env = DelayedReward(Walk(), BlockSum(5, 0.0)) if wrapped else Walk()
    model, relabel = agent([env]), Relabel(recovery(), None if wrapped else 5, every=20)
    for _ in range(3):
        model.learn(80, callback=[relabel, Stop()], reset_num_timesteps=False)
    windows = relabel.store.windows
    rewards = 0.25 * (4 * windows.next_states[..., 0].double()).round() + 0.5
    assert windows.labels.shape[1] > 30
    assert torch.equal(windows.sums(rewards), windows.labels)


def test_dictionaries_are_seen_as_vectors() -> None:
    class Named(gymnasium.ObservationWrapper[Any, Any, Any]):
        def __init__(self, env: Walk) -> None:
            super().__init__(env)
            self.observation_space = Dict(a=Discrete(3), b=env.observation_space)

        def observation(self, observation: Any) -> Any:
            return {"a": 1, "b": observation}

    env = Walk()
    model, relabel = agent([Named(env)]), Relabel(recovery(), 5, every=50)
    model.learn(100, callback=relabel)
    windows = relabel.store.windows
    assert windows.states.shape[2] == 5
    assert windows.states[0, :, :3].tolist() == [[0, 1, 0]] * len(windows)
    assert torch.equal(windows.states[0, :, 3:], stacked(env.rows[: len(windows)], False)[0][0])


def test_what_cannot_be_done_is_said_before_the_first_step() -> None:
    def learn(model: Any, *given: Any, **keys: Any) -> None:
        model.learn(10, callback=Relabel(*given, **keys))

    with pytest.raises(UserError, match=r"PPO has NoneType for a replay buffer.*use SAC, TD3, DDPG or DQN"):
        learn(sb3.PPO("MlpPolicy", Walk(), device="cpu", n_steps=8, batch_size=8), recovery(), 5)
    with pytest.raises(UserError, match="DelayedReward tells where windows end; leave window out"):
        learn(agent([DelayedReward(Walk(), BlockSum(5))]), recovery(), 5)
    with pytest.raises(UserError, match="there is no time limit: give longest="):
        learn(agent([Walk()]), recovery())
    with pytest.raises(UserError, match="a window has up to 40 steps, and the buffer holds 40"):
        learn(agent([Walk()], buffer_size=40), recovery(), 40)
    with pytest.raises(Misfit, match=r"assigner\.reference\.features: Identity needs states that are numbers"):
        learn(agent([Walk()]), recovery(True), 5)
    scaled = Recovery(LinearModel("linear", Motion(), Analytic(noise=0.1)), scaler=Standard())
    with pytest.raises(UserError, match="may have no label: the scaler of Recovery scales the rows of its windows"):
        learn(agent([DelayedReward(Walk(), BlockSum(5))]), scaled)
    vector = VecNormalize(DummyVecEnv([Walk]))
    with pytest.raises(UserError, match="give it norm_reward=False"):
        learn(sb3.SAC("MlpPolicy", vector, device="cpu"), recovery(), 5)
    with pytest.raises(UserError, match=r"Relabel\(every=0\): it is a number of steps, at least 1"):
        Relabel(recovery(), every=0)
