"""Late labels for any agent: the same as our collector's, where windows end, and nothing that repeats the reward."""

from __future__ import annotations

import copy
import subprocess
import sys
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, ClassVar

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Discrete
from gymnasium.utils.env_checker import check_env
from torch import Tensor

from credit.agents.random import Random
from credit.core.errors import RunError, UserError
from credit.core.problem import Problem
from credit.core.seams import Feedback
from credit.core.streams import reset_seed
from credit.envs import DelayedReward
from credit.envs.collect import Collector
from credit.envs.feedback import BlockSum, Labels, Success, Terminal
from credit.envs.gymnasium.environment import Gymnasium


class Rising(gymnasium.Env[Any, Any]):
    """Rewards 1, 2, 3, …, which `info` repeats; over after so many steps."""

    def __init__(self, steps: int = 7, reward: float | None = None) -> None:
        self.observation_space, self.action_space = Box(-1e6, 1e6, (1,)), Discrete(2)
        self.steps, self.reward = steps, reward

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self._t = 0
        return np.zeros(1, np.float32), {"reward_before": 0.0, "mask": 3}

    def step(self, action: Any) -> Any:
        self._t += 1
        reward = float(self._t) if self.reward is None else self.reward
        info = {"reward_run": reward, "speed": reward, "success": self._t == 5, "mask": 4}
        return np.full(1, self._t, np.float32), reward, self._t == self.steps, False, info


class Sum(Feedback):
    """The sum of a whole episode, or none where it is too small."""

    objective: ClassVar = "sum"

    def __init__(self, least: float = 0.0) -> None:
        self.window, self.least = None, least  # type: ignore[assignment]

    def start(self, problem: Problem) -> None:
        """There is no noise."""

    def __call__(self, rewards: Tensor) -> Tensor:
        total = rewards.sum(-1)
        return torch.where(total >= self.least, total, torch.nan)


def told(env: gymnasium.Env[Any, Any], steps: int) -> list[tuple[float, dict[str, Any]]]:
    """Rewards and `info` of some steps, from a beginning."""
    env.reset(seed=0)
    found = []
    for _ in range(steps):
        _, reward, terminated, truncated, info = env.step(0)
        found.append((float(reward), info))
        if terminated or truncated:
            env.reset()
    return found


GOES_ON: dict[str, Any] = {"window_end": False, "censored": False}
NONE: dict[str, Any] = {"window_end": True, "censored": True}


def ended(label: float) -> dict[str, Any]:
    return {"window_end": True, "censored": False, "label": label}


@pytest.mark.parametrize(
    ("feedback", "last"),
    [
        (BlockSum(3, 0.0), {2: 6.0, 5: 15.0, 6: 7.0, 9: 6.0}),
        (BlockSum(3, 0.0, cut="drop"), {2: 6.0, 5: 15.0, 6: None, 9: 6.0}),
        (Terminal(3), {2: 3.0, 5: 6.0, 6: 7.0, 9: 3.0}),
        (Success(3), {2: 0.0, 5: 1.0, 6: 0.0, 9: 0.0}),  # what the environment says, though rewards are positive
        (Sum(), {6: 28.0}),
        (Sum(least=30.0), {6: None}),
    ],
)
def test_labels_stand_where_windows_end(feedback: Feedback, last: dict[int, float | None]) -> None:
    found = told(DelayedReward(Rising(), feedback), 10)
    for step, (reward, info) in enumerate(found):
        label = last.get(step)
        assert reward == (label or 0.0)
        assert info == (GOES_ON if step not in last else NONE if label is None else ended(label))


class Played(Random):
    """Random, and remembers what it did."""

    actions: ClassVar[Any] = "any"

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        self.done: list[Tensor] = [*getattr(self, "done", []), super().act(states, step)]
        return self.done[-1]


@pytest.mark.parametrize("feedback", [BlockSum(30, 0.3), BlockSum(200, 0.1)])
def test_labels_are_those_of_our_collector(feedback: BlockSum) -> None:
    seed, env = 5, Gymnasium("CartPole-v1", max_steps=feedback.window, evaluation_episodes=1)
    problem, random = env.problem(None, (seed,)), Played()
    for part in (env, feedback, random):
        part.start(problem)
    windows, _ = Collector(env, feedback, problem).collect(random, 6)
    assert len(set(windows.lengths[0].tolist())) > 1
    single = DelayedReward(gymnasium.make("CartPole-v1", max_episode_steps=feedback.window), feedback, seed)
    labels, actions = [], iter(random.done)
    for episode in range(6):
        single.reset(seed=reset_seed(seed, "environment", 0, episode))
        over = False
        while not over:
            _, reward, terminated, truncated, info = single.step(int(next(actions)))
            over = terminated or truncated
        labels.append(info["label"])
        assert reward == labels[-1]
    assert labels == windows.labels[0].tolist()


@pytest.mark.parametrize(
    ("name", "keys"),
    [("CartPole-v1", {}), ("Pendulum-v1", {}), ("FrozenLake-v1", {}), ("HalfCheetah-v5", {"max_episode_steps": 50})],
)
@pytest.mark.filterwarnings("ignore::UserWarning")  # of wrappers and infinite bounds, whatever they are
def test_gymnasiums_checker_is_content(name: str, keys: dict[str, Any]) -> None:
    for feedback in (BlockSum(4), Sum()):
        env = DelayedReward(gymnasium.make(name, **keys), feedback)
        check_env(env, skip_render_check=True)
        env.close()


def test_an_environment_that_is_made_anew_from_its_spec_has_the_same_labels() -> None:
    env = DelayedReward(gymnasium.make("CartPole-v1"), BlockSum(4), seed=3)
    assert env.spec is not None
    assert told(gymnasium.make(env.spec), 30) == told(env, 30)


def test_nothing_in_info_repeats_the_reward() -> None:
    env = DelayedReward(gymnasium.make("HalfCheetah-v5"), BlockSum(3, 0.0))
    assert env.reset(seed=0)[1] == {}
    env.action_space.seed(0)
    for step in range(1, 7):
        info = env.step(env.action_space.sample())[-1]
        assert {*info} == {"window_end", "censored", *(["label"] if step % 3 == 0 else [])}
    kept = DelayedReward(Rising(), BlockSum(3), keep=("mask", "none"))
    assert kept.reset()[1] == {"mask": 3}
    assert kept.step(0)[-1] == {"mask": 4, **GOES_ON}
    with pytest.raises(UserError, match=r"keep=\['label', 'mask'\]: \['label'\] are told by"):
        DelayedReward(Rising(), BlockSum(3), keep=("label", "mask"))


def test_another_reward_with_the_same_labels_tells_the_same() -> None:
    class Shifted(gymnasium.RewardWrapper[Any, Any]):
        def reward(self, reward: Any) -> Any:
            return float(reward) + (1, -2, 1)[int(reward - 1) % 3]

    def lived(env: gymnasium.Env[Any, Any]) -> Any:
        return told(DelayedReward(env, BlockSum(3, 0.2, cut="drop")), 20)

    assert lived(Shifted(Rising(30))) == lived(Rising(30))


def test_one_feedback_serves_several_environments() -> None:
    feedback = BlockSum(2, 1.0)
    alone = told(DelayedReward(Rising(), feedback, seed=1), 10)
    first, second = (DelayedReward(Rising(), feedback, seed=seed) for seed in (1, 2))
    other = told(second, 10)
    assert told(first, 10) == alone != other
    assert not hasattr(feedback, "_stream")
    assert [step[1].keys() for step in alone] == [step[1].keys() for step in other]


def test_a_new_episode_begins_a_new_window() -> None:
    env = DelayedReward(Rising(), BlockSum(3, 0.0))
    told(env, 2)
    assert [info.get("label") for _, info in told(env, 4)] == [None, None, 6.0, None]
    assert env.label_window == 3
    assert DelayedReward(Rising(), Sum()).label_window is None
    assert DelayedReward(gymnasium.make("CartPole-v1"), Sum()).label_window == 500


def test_a_reward_that_is_no_number_is_refused() -> None:
    env = DelayedReward(Rising(reward=np.nan), BlockSum(3))
    env.reset()
    with pytest.raises(RunError, match="reward nan in step 0 of a window: a label needs finite numbers"):
        env.step(0)


@pytest.mark.parametrize("reward", ["abc", np.ones(2), [None]])
def test_a_reward_that_is_not_one_number_is_refused(reward: Any) -> None:
    with pytest.raises(RunError, match=r"reward .* in step 0 of a window: a label needs finite numbers, one for each"):
        told(DelayedReward(Rising(reward=reward), BlockSum(3)), 1)
    one = DelayedReward(Rising(reward=np.array([2.0])), BlockSum(3, 0.0))  # type: ignore[arg-type]
    assert [reward for reward, _ in told(one, 3)] == [0.0, 0.0, 6.0]


@pytest.mark.thorough
def test_it_is_imported_when_it_is_asked_for() -> None:
    code = "import sys, credit, credit.envs; assert not {'torch', 'gymnasium'} & {*sys.modules}; "
    code += "from credit.envs import DelayedReward; assert DelayedReward.__module__ == 'credit.envs.delayed'"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    import credit.envs

    with pytest.raises(AttributeError, match="no attribute 'Delayed'"):
        _ = credit.envs.Delayed


def test_it_can_be_copied_in_mid_window() -> None:
    env = DelayedReward(Rising(), BlockSum(3, 0.5))
    told(env, 2)
    other = copy.deepcopy(env)
    found: Sequence[Any] = [one.step(0)[1] for one in (env, other)]
    assert found[0] == found[1] != 0


def test_what_is_missing_has_no_label_and_lengths_are_drawn() -> None:
    found = [info for _, info in told(DelayedReward(Rising(), BlockSum([2, 3], 0.0, missing=0.5), seed=4), 300)]
    ends = [step for step, info in enumerate(found) if info["window_end"]]
    gaps = {b - a for a, b in pairwise(ends)}
    assert gaps == {1, 2, 3}  # 1 at an episode's end
    assert 0.3 < sum(info["censored"] for info in found) / len(ends) < 0.7


class Median(Labels):
    objective: ClassVar = "median"

    def rule(self, rewards: Tensor) -> Tensor:
        return rewards.median(-1).values


def test_a_window_that_is_cut_short_has_a_rule_of_its_own_steps() -> None:
    found = [info["label"] for _, info in told(DelayedReward(Rising(20, 1.0), Median(15)), 20) if info["window_end"]]
    assert found == [1.0, 1.0]


class Late(Rising):
    """Tells in its last step alone that it was a success, under some key; its rewards say something else."""

    def __init__(self, key: str, reward: float = 0.0) -> None:
        super().__init__(reward=reward)
        self.key = key

    def step(self, action: Any) -> Any:
        seen, reward, over, cut, _ = super().step(action)
        return seen, reward, over, cut, {self.key: np.array([True])} if over else {"speed": 1.0}


@pytest.mark.parametrize(("key", "success"), [("is_success", "auto"), ("success", "auto"), ("won", "won")])
def test_a_success_may_be_told_by_the_last_step_alone(key: str, success: str) -> None:
    env = DelayedReward(Late(key), Success(window=None), success=success)
    assert [reward for reward, _ in told(env, 14)] == [*[0.0] * 6, 1.0] * 2
    assert env.spec is None or env.spec.kwargs["success"] == success
    inside = DelayedReward(Late("won"), Success(window=3), success="won")
    assert [reward for reward, _ in told(inside, 7)] == [*[0.0] * 6, 1.0]


@pytest.mark.parametrize(("reward", "label"), [(0.5, 1.0), (0.0, 0.0), (-1.0, 0.0)])
def test_a_positive_reward_is_a_success_where_that_is_said(reward: float, label: float) -> None:
    env = DelayedReward(Late("is_success", reward), Success(window=None), success="reward")
    assert told(env, 7)[-1][0] == label


@pytest.mark.parametrize("reward", [0.0, 1.0])
@pytest.mark.parametrize(
    ("success", "said"),
    [
        ("auto", r"no step told success or is_success \(the last step told won\); success=KEY names another"),
        ("wonn", r"no step told wonn \(the last step told won\); success=KEY names another, and success='reward'"),
    ],
)
def test_a_success_that_nobody_tells_is_never_guessed(success: str, said: str, reward: float) -> None:
    env = DelayedReward(Late("won", reward), Success(window=None), success=success)
    with pytest.raises(UserError, match=said):
        told(env, 7)


def test_a_key_that_no_feedback_reads_is_refused() -> None:
    with pytest.raises(UserError, match="success='won': BlockSum does not read whether a step is one"):
        DelayedReward(Rising(), BlockSum(3), success="won")


def test_labels_that_come_late_are_refused() -> None:
    with pytest.raises(UserError, match="a label comes with the last step of its window"):
        DelayedReward(Rising(), BlockSum(3, delay=2))
