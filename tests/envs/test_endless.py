"""Tasks that go on for ever: steps without an end, windows of steps, an evaluation with a horizon, and going on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from torch import Tensor

from credit.agents.random import Random
from credit.core.errors import RunError, UserError
from credit.core.seams import Environment
from credit.core.streams import reset_seed
from credit.envs.collect import Collector
from credit.envs.feedback import BlockSum, EpisodeSum
from credit.envs.gymnasium.environment import Gymnasium
from credit.envs.torchrl.environment import TorchRLEnvironment
from credit.rivals.rules import Delayed
from credit.rounds import problem_of
from credit.runs import checkpoint
from credit.trainer import Trainer

SEEDS = (3, 4)
PENDULUM = "torchrl.envs.PendulumEnv"
MORE = [("gymnasium", 2), ("torchrl", 1)]


class Ring(gymnasium.Env[Any, Any]):
    """Three places; at place 2 there is a reward. It has no end, but for one that is asked for."""

    def __init__(self, ends: int = 0) -> None:
        self.observation_space, self.action_space = gymnasium.spaces.Discrete(3), gymnasium.spaces.Discrete(2)
        self.ends = ends

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self._t, self._place = 0, int(self.np_random.integers(3))
        return self._place, {}

    def step(self, action: Any) -> Any:
        self._t += 1
        self._place = (self._place + int(action) * int(self.np_random.integers(2))) % 3
        return self._place, float(self._place == 2), self._t == self.ends, False, {}


gymnasium.register("tests/Ring-v0", entry_point=Ring)


def endless(**keys: Any) -> Gymnasium:
    return Gymnasium("tests/Ring-v0", **({"horizon": 12} | keys))


def begun(env: Environment, window: int = 5, rolling: bool = True) -> tuple[Collector, Random]:
    feedback, random = BlockSum(window, 0.0), Random()
    problem = problem_of(env, feedback, SEEDS, "cpu", rolling=rolling)
    for part in (env, feedback, random):
        part.start(problem)
    return Collector(env, feedback, problem), random


@pytest.mark.parametrize("copies", [1, 3])
def test_steps_are_those_of_one_episode_without_an_end(copies: int) -> None:
    collector, random = begun(endless(copies=copies))
    found = [collector.roll(random, 40 * copies) for _ in range(2)]
    purpose = "environment" if copies == 1 else f"environment, {copies} at once"
    parts = [(windows, rewards) for windows, rewards in filter(None, found)]
    for copy in range(copies):
        alone = gymnasium.make("tests/Ring-v0")
        seen, _ = alone.reset(seed=reset_seed(4, purpose, copy, 0))
        for round_, (windows, rewards) in enumerate(parts):  # copy after copy
            assert windows.labels.shape == (2, 8 * copies)
            torch.testing.assert_close(windows.sums(rewards), windows.labels)
            assert windows.terminated is not None
            assert not windows.terminated.any()
            for row in range(40 * copy, 40 * (copy + 1)):
                assert (int(windows.states[1, row]), int(windows.step[1, row])) == (seen, 40 * round_ + row % 40)  # type: ignore[index]
                seen, reward, *_ = alone.step(int(windows.actions[1, row]))
                assert (int(windows.next_states[1, row]), float(rewards[1, row])) == (seen, reward)


def test_rounds_may_be_of_windows() -> None:
    collector, random = begun(endless(), rolling=False)
    one, other = (collector.collect(random, 3)[0] for _ in range(2))
    assert one.length == 5
    assert torch.equal(one.next_states[:, -1], other.states[:, 0])


def test_the_time_limit_of_an_id_does_not_hold() -> None:
    collector, random = begun(Gymnasium("Pendulum-v1", horizon=30))
    found = collector.roll(random, 250)
    assert found is not None
    assert found[0].ended is not None
    assert not found[0].ended.any()
    evaluated = collector.evaluation(2)(random)
    assert evaluated.windows.lengths.tolist() == [[30, 30], [30, 30]]


@pytest.mark.parametrize(
    ("env", "feedback", "said"),
    [
        (
            endless(),
            EpisodeSum(),
            r"whole episode, and Gymnasium goes on for ever.*feedback=block_sum feedback\.window",
        ),
        (endless(), BlockSum(13), r"feedback\.window=13: an evaluation has env\.horizon=12 steps.*env\.horizon=130"),
        (endless(horizon=None), BlockSum(5), r"without a time limit.*if its episodes never end, env\.horizon="),
    ],
)
def test_what_does_not_go_with_it_says_why(env: Environment, feedback: Any, said: str) -> None:
    with pytest.raises(UserError, match=said):
        problem_of(env, feedback, SEEDS, "cpu", rolling=True)
    with pytest.raises(UserError, match=r"env\.max_steps=5 ends episodes, and env\.horizon=12"):
        endless(max_steps=5)


def test_many_copies_need_rounds_of_steps() -> None:
    with pytest.raises(UserError, match="Gymnasium goes on for ever and says copies=3"):
        begun(endless(copies=3), rolling=False)


def test_an_end_that_was_denied_is_named() -> None:
    collector, random = begun(endless(kwargs={"ends": 4}))
    with pytest.raises(
        RunError, match=r"ended an episode, seed 3, copy 0 for environment, episode 1, step 3.*max_steps"
    ):
        collector.roll(random, 10)


@pytest.mark.parametrize(
    ("kind", "copies"),
    [("gymnasium", 1), ("torchrl", 2), *(pytest.param(*case, marks=pytest.mark.thorough) for case in MORE)],
)
def test_a_run_is_gone_on_with_by_playing_all_again(kind: str, copies: int, tmp_path: Path) -> None:
    """In mid-episode, and in mid-window: a checkpoint is written, and another run goes on from it."""

    def started() -> tuple[Trainer, list[tuple[int, dict[str, Tensor]]]]:
        keys: dict[str, Any] = {"horizon": 7, "copies": copies, "evaluation_episodes": 1}
        env = Gymnasium("Pendulum-v1", **keys) if kind == "gymnasium" else TorchRLEnvironment(PENDULUM, **keys)
        trainer = Trainer(env, BlockSum(3, 0.1), Delayed(), Random(), steps=30, steps_per_round=10, log_every=1)
        trainer.start(SEEDS)
        return trainer, []

    path = tmp_path / checkpoint.NAME
    (one, whole), (other, rest) = started(), started()

    def save() -> None:
        if one.collected == 10:
            checkpoint.save(path, {"trainer": one.state_dict()})

    one.run(lambda step, values: whole.append((step, values)), between=save)
    other.load_state_dict(checkpoint.load(path)["trainer"])
    other.run(lambda step, values: rest.append((step, values)))
    assert [step for step, _ in rest] == [20, 30]
    for (_, expected), (_, found) in zip(whole[1:], rest, strict=True):
        for key, value in expected.items():
            np.testing.assert_array_equal(value.numpy(), found[key].numpy(), err_msg=key)
    for column in ("states", "actions", "labels"):
        assert torch.equal(getattr(one.store.windows, column), getattr(other.store.windows, column))
