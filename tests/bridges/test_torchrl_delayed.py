"""Late labels as a TorchRL transform, beside the Gymnasium wrapper on the same seeds."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Discrete
from torchrl.envs import Compose, GymEnv, SerialEnv, StepCounter, TransformedEnv
from torchrl.envs.utils import check_env_specs

from credit.bridges.torchrl_delayed import DelayedReward
from credit.core.errors import UserError
from credit.core.seams import Feedback
from credit.envs import DelayedReward as Wrapper
from credit.envs.feedback import BlockSum, EpisodeSum, Success, Terminal

FEEDBACKS: list[tuple[Feedback, int | None]] = [
    (BlockSum(4, 0.3), None),
    (BlockSum([2, 5], 0.1, missing=0.3), None),
    (BlockSum(7, 0.0, cut="drop"), None),
    (Terminal(5), None),
    (EpisodeSum(noise=0.2), 500),
]


class Walk(gymnasium.Env[Any, Any]):
    """Four steps without a reward."""

    def __init__(self, key: str) -> None:
        self.observation_space, self.action_space, self.key = Box(-9, 9, (1,)), Discrete(2), key

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self.t = 0
        return np.zeros(1, np.float32), {self.key: np.array([False])}

    def step(self, action: Any) -> Any:
        self.t += 1
        return np.zeros(1, np.float32), 0.0, self.t == 4, False, {self.key: np.array([self.t == 4])}


gymnasium.register("tests/Walk-v0", entry_point=Walk)


def env(feedback: Feedback, seed: int = 3, **keys: Any) -> TransformedEnv:
    return TransformedEnv(GymEnv("CartPole-v1"), DelayedReward(feedback, seed, **keys))


@pytest.mark.parametrize(("feedback", "longest"), FEEDBACKS)
def test_it_tells_what_the_wrapper_tells(feedback: Feedback, longest: int | None) -> None:
    ours, theirs = env(feedback, longest=longest), Wrapper(gymnasium.make("CartPole-v1"), feedback, 3)
    ended = 0
    for episode in range(3):
        theirs.reset(seed=episode)
        state, over = ours.reset(seed=episode), False
        while not over:
            state["action"] = torch.tensor([0, 1])
            then = ours.step(state)["next"]
            _, reward, terminated, truncated, info = theirs.step(1)
            over = terminated or truncated
            assert bool(then["done"]) == over
            assert float(then["reward"]) == pytest.approx(reward, rel=1e-6)
            assert bool(then["window_end"]) == info["window_end"]
            assert bool(then["censored"]) == info["censored"]
            label = float(then["label"])
            assert label == pytest.approx(info["label"], rel=1e-6) if "label" in info else label != label
            ended += info["window_end"]
            state = then.exclude("reward")
    assert ended >= 3


def test_each_of_a_batch_has_windows_of_its_own() -> None:
    batch = TransformedEnv(SerialEnv(2, lambda: GymEnv("CartPole-v1")), DelayedReward(BlockSum(4, 0.0)))
    batch.set_seed(0)
    found = batch.rollout(60, break_when_any_done=False)
    ends, done = found["next", "window_end"][..., 0], found["next", "done"][..., 0]
    for copy in range(2):
        since = 0
        for step in range(60):
            since += 1
            assert bool(ends[copy, step]) == (since == 4 or bool(done[copy, step]))
            expected = float(since) if ends[copy, step] else 0.0  # a reward of CartPole is 1
            assert float(found["next", "reward"][copy, step]) == expected
            since = 0 if ends[copy, step] else since


def test_a_limit_before_it_closes_the_window() -> None:
    """As its page says; behind it, the same limit is not seen, and the window has no label."""
    late, limit = DelayedReward(BlockSum(20, 0.0)), StepCounter(6)
    found = TransformedEnv(GymEnv("CartPole-v1"), Compose(limit, late)).rollout(6)
    assert float(found["next", "label"][-1]) == 6.0
    late, limit = DelayedReward(BlockSum(20, 0.0)), StepCounter(6)
    found = TransformedEnv(GymEnv("CartPole-v1"), Compose(late, limit)).rollout(6)
    assert bool(found["next", "done"][-1])
    assert not found["next", "window_end"].any()


def test_specs_are_right_and_keys_can_be_named() -> None:
    named = env(BlockSum(3), label_key="y", end_key="end", censored_key="none")
    check_env_specs(named)
    assert {"y", "end", "none"} <= {*named.rollout(5)["next"].keys()}


def chased(feedback: Feedback, key: str, count: int = 1, **keys: Any) -> TransformedEnv:
    """A walk that tells under some key, in its last step alone, that it is one; it gives no reward."""

    def one() -> GymEnv:
        return GymEnv("tests/Walk-v0", key=key).auto_register_info_dict()

    return TransformedEnv(one() if count == 1 else SerialEnv(count, one), DelayedReward(feedback, **keys))


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize(("key", "success"), [("is_success", "auto"), ("won", "won")])
def test_success_is_told_under_the_key_that_is_named(key: str, success: str, count: int) -> None:
    found = chased(Success(None), key, count, success=success).rollout(8, break_when_any_done=False)
    labels = found["next", "label"].reshape(count, 8)
    assert labels[:, [3, 7]].eq(1).all()
    assert labels.nansum() == 2 * count


def test_a_success_that_nobody_tells_is_an_error() -> None:
    with pytest.raises(UserError, match=r"no step told success or is_success .* success=KEY names another"):
        chased(Success(None), "won").rollout(4)
    with pytest.raises(UserError, match=r"no step told wonn .* success=KEY names another"):
        chased(Success(None), "won", success="wonn").rollout(4)
    rewarded = env(Success(None), success="reward").rollout(500)
    assert float(rewarded["next", "label"][-1]) == 1.0


def test_what_cannot_be_is_said_at_once() -> None:
    with pytest.raises(UserError, match="a label comes with the last step of its window"):
        DelayedReward(BlockSum(3, delay=2))
    with pytest.raises(UserError, match="give three names"):
        DelayedReward(BlockSum(3), label_key="reward")
    twice = env(BlockSum(3))
    twice.append_transform(DelayedReward(BlockSum(3)))
    with pytest.raises(UserError, match="give DelayedReward other keys"):
        twice.reset()
