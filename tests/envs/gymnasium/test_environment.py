"""Environments of Gymnasium by their ids: spaces, seeds, ends, what goes wrong, and going on in mid-episode."""

from __future__ import annotations

import re
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete
from torch import Tensor

from credit.agents.random import Random
from credit.core.errors import RunError, UserError
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Environment, Feedback
from credit.core.streams import reset_seed
from credit.core.windows import Windows
from credit.envs.collect import Collector
from credit.envs.feedback import BlockSum, EpisodeSum, Success
from credit.envs.gymnasium import making
from credit.envs.gymnasium.copies import out
from credit.envs.gymnasium.environment import Gymnasium
from credit.judges.choose import judge
from credit.judges.exact import Episodic
from credit.judges.rollouts import Rollouts
from credit.rounds import problem_of
from credit.runs.checkpoint import only_data

SEEDS = (3, 4)


class Odd(gymnasium.Env[Any, Any]):
    """A dictionary to see, with a counter in it, and two digits to do; six steps; it may misbehave in the third."""

    def __init__(self, trouble: str = "none", reports: bool | str = False) -> None:
        self.observation_space = Dict(here=MultiDiscrete([3, 2]), far=Box(-1.0, 1.0, (2,)))
        self.action_space = MultiDiscrete([2, 2])
        self.trouble, self.reports = trouble, reports

    def _seen(self) -> dict[str, Any]:
        far = self.np_random.random(2, dtype=np.float32)
        return {"here": np.array([self._t % 3, self._t % 2]), "far": far * np.nan if self._bad("observation") else far}

    def _bad(self, trouble: str) -> bool:
        return self.trouble == trouble and self._t == 3

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self._t = 0
        return self._seen(), {}

    def step(self, action: Any) -> Any:
        assert action.shape == (2,)
        self._t += 1
        if self._bad("raises"):
            raise ArithmeticError("no third step")
        info = {"is_success": self._t == 6, "reward": 7.0} if self.reports is True else {}
        if self.reports == "now and then" and self._t == 2:
            info = {"is_success": True}
        reward = np.inf if self._bad("reward") else float(action.sum())
        return self._seen(), reward, self._t == 6, False, info


gymnasium.register("tests/Odd-v0", entry_point=Odd, max_episode_steps=9)
gymnasium.register("tests/Endless-v0", entry_point=Odd)


def lived(env: Gymnasium, count: int = 3, copies: int = 1) -> tuple[Windows, Tensor, Problem]:
    problem = env.problem(None, SEEDS)
    feedback, random = BlockSum(env.horizon, 0.0), Random()
    for part in (env, feedback, random):
        part.start(problem)
    windows, rewards = Collector(env, feedback, problem).collect(random, count)
    return windows, rewards, problem


@pytest.mark.parametrize(
    ("name", "keys", "states", "actions"),
    [
        ("CartPole-v1", {}, (4,), 2),
        ("Pendulum-v1", {"max_steps": 30}, (3,), (1,)),
        ("FrozenLake-v1", {"kwargs": {"is_slippery": False}}, 16, 4),
        ("Blackjack-v1", {"max_steps": 10}, (45,), 2),
        ("tests/Odd-v0", {}, (7,), 4),
        ("FrozenLake-v1", {"view": "vector"}, (16,), 4),
        ("CartPole-v1", {"wrappers": ["FlattenObservation"]}, (4,), 2),
    ],
)
def test_spaces_are_encoded_and_episodes_end(name: str, keys: dict[str, Any], states: Any, actions: Any) -> None:
    env = Gymnasium(name, **keys)
    windows, rewards, problem = lived(env)
    assert isinstance(env, Environment)
    assert (problem.states if isinstance(states, int) else problem.observation_space.shape) == states
    assert (problem.actions if isinstance(actions, int) else problem.action_space.shape) == actions
    assert windows.labels.shape == (2, 3)
    inside = ~windows.final[0, :-1]  # what a step led to is where the next one begins
    assert torch.equal(windows.next_states[0, : len(inside)][inside], windows.states[0, 1 : len(inside) + 1][inside])
    assert ((windows.lengths >= 1) & (windows.lengths <= problem.window)).all()
    torch.testing.assert_close(windows.sums(rewards), windows.labels)
    again, _, _ = lived(Gymnasium(name, **keys))
    assert torch.equal(windows.states, again.states)
    assert torch.equal(windows.labels, again.labels)


def test_an_episode_is_that_of_its_seed_alone() -> None:
    """What Gymnasium itself gives for the seed of (seed, copy, purpose, episode)."""
    env = Gymnasium("CartPole-v1")
    problem = env.problem(None, SEEDS)
    env.start(problem, copies=2)
    first = env.reset()
    second = env.reset(torch.tensor([[False, True], [False, False]]))
    assert torch.equal(first[1], second[1])
    alone = gymnasium.make("CartPole-v1")
    for states, episode in ((first, 0), (second, 1)):
        seen, _ = alone.reset(seed=reset_seed(3, "environment", 1, episode))
        assert np.array_equal(states[0, 1].numpy(), seen)
    seeds = {reset_seed(s, p, k, e) for s in (3, 4) for p in ("a", "b") for k in (0, 1) for e in (0, 1)}
    assert len(seeds) == 16


def test_a_time_limit_is_no_end_of_the_task() -> None:
    windows, _, _ = lived(Gymnasium("Pendulum-v1", max_steps=7), 2)
    assert windows.lengths.tolist() == [[7, 7], [7, 7]]
    assert windows.ended is not None
    assert windows.terminated is not None
    assert windows.ended.sum(1).tolist() == [2, 2]
    assert not windows.terminated.any()


@pytest.mark.parametrize("reports", [True, False])
def test_info_reaches_nobody_but_for_success(reports: bool) -> None:
    env = Gymnasium("tests/Odd-v0", {"reports": reports})
    env.start(env.problem(None, SEEDS))
    env.reset()
    outs = [env.step(torch.zeros(2, 1, dtype=torch.int64)) for _ in range(6)]
    said = [out.facts["success"].tolist() for out in outs] if reports else []
    assert said == [[[False], [False]]] * 5 * reports + [[[True], [True]]] * reports
    assert all(out.facts.keys() == ({"success"} if reports else set()) for out in outs)


def test_a_package_that_is_not_there_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(making.PACKAGES, "Nowhere", "nowhere_envs")
    with pytest.raises(UserError, match="install the package nowhere_envs"):
        Gymnasium("Nowhere-v0").problem(None, SEEDS)


def test_success_is_told_or_refused() -> None:
    with pytest.raises(UserError, match=r"one of the keys success, is_success in the info of env\.id='CartPole-v1'"):
        problem_of(Gymnasium("CartPole-v1"), Success(None), SEEDS, "cpu", rolling=True)
    lake = Gymnasium("FrozenLake-v1", success="reward")
    problem_of(lake, Success(None), SEEDS, "cpu", rolling=True)
    assert lake.facts == ("success",)


@pytest.mark.parametrize("horizon", [None, 4])
def test_a_key_that_is_never_told_is_no_failure(horizon: int | None) -> None:
    """A misspelt key ends the run, and label 0 is no success that was not told."""
    said = r"tests/Odd-v0'.*had the key 'is_succes' in its info, seed 3, .*; did you mean 'is_success'\?"
    env = Gymnasium("tests/Odd-v0", {"reports": True}, success="is_succes", horizon=horizon)
    env.start(env.problem(None, SEEDS))
    env.reset()
    actions = torch.zeros(2, 1, dtype=torch.int64)
    for _ in range((horizon or 6) - 1):
        env.step(actions)
    with pytest.raises(RunError, match=said):
        env.step(actions)


@pytest.mark.parametrize(
    ("success", "reports", "said"),
    [
        ("is_succes", True, "env.success=is_succes: .*no such key in 6 steps.*did you mean 'is_success'"),
        ("won", False, r"env.success=won: .*no such key in 6 steps of a first try; \(there are none\); where it never"),
        ("is_success", "now and then", "^$"),
        ("auto", False, "^$"),
        ("reward", False, "^$"),
    ],
)
def test_a_key_that_a_first_try_does_not_hear_is_told_before_the_run(success: str, reports: Any, said: str) -> None:
    assert re.search(said, Gymnasium("tests/Odd-v0", {"reports": reports}, success=success).remark())
    raising = Gymnasium("tests/Odd-v0", {"trouble": "raises"}, success="won")
    assert raising.remark() == ""  # the run tells where that was


def test_a_key_that_was_told_need_not_be_told_again() -> None:
    """Some tell a success where it is one, and nothing elsewhere; and who goes on knows that it was told."""
    one, other = (Gymnasium("tests/Odd-v0", {"reports": "now and then"}, success="is_success") for _ in range(2))
    problem = one.problem(None, SEEDS)
    for env in (one, other):
        env.start(problem)
    one.reset()
    actions = torch.zeros(2, 1, dtype=torch.int64)
    found = [one.step(actions).facts["success"].tolist() for _ in range(6)]
    assert found == [[[False], [False]], [[True], [True]], *[[[False], [False]]] * 4]
    one.reset()
    other.load_state_dict(one.state_dict())
    assert other.step(actions).facts["success"].tolist() == [[False], [False]]
    assert other.state_dict()["heard"]


@pytest.mark.parametrize(
    ("feedback", "rolling", "said"),
    [
        (
            BlockSum(600),
            True,
            r"feedback\.window=600: the longest episode of Gymnasium has 500 steps; take at most 500",
        ),
        (BlockSum(20), False, "windows of 20 steps inside episodes need rounds of steps"),
        (EpisodeSum(missing=0.5), False, "missing labels need rounds of steps"),
        (EpisodeSum(delay=3), False, "late labels need rounds of steps"),
    ],
)
def test_windows_that_do_not_go_with_episodes_are_refused(feedback: Feedback, rolling: bool, said: str) -> None:
    with pytest.raises(UserError, match=said):
        problem_of(Gymnasium("CartPole-v1"), feedback, SEEDS, "cpu", rolling=rolling)


@pytest.mark.parametrize(
    ("name", "keys", "said"),
    [
        ("CartPole-v9", {}, r"env.id='CartPole-v9'.*did you mean 'CartPole-v1'"),
        ("Pendulm-v1", {}, "did you mean 'Pendulum-v1'"),
        ("MiniGrid-Empty-5x5-v0", {}, r"different sizes.*env\.wrappers=\[minigrid\.wrappers:ImgObsWrapper\]"),
        ("FetchReach-v4", {}, "does not know MuJoCo 4"),
        ("nopackage:Thing-v0", {}, "needs a package that is not installed.*nopackage"),
        ("tests/Endless-v0", {}, r"without a time limit.*env\.max_steps"),
        ("CartPole-v1", {"kwargs": {"nope": 1}}, r"made with \{'nope': 1\} cannot be made: TypeError"),
        ("CartPole-v1", {"wrappers": ["FlattenObs"]}, "no 'FlattenObs'.*did you mean 'FlattenObservation'"),
    ],
)
def test_what_cannot_be_made_is_said_before_the_start(name: str, keys: dict[str, Any], said: str) -> None:
    with pytest.raises(UserError, match=said):
        Gymnasium(name, **keys).problem(None, SEEDS)


@pytest.mark.parametrize("workers", [0, pytest.param(2, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("trouble", "said"),
    [
        ("raises", "raised in step, seed 3, copy 0 for environment, episode 1, step 2: ArithmeticError: no third step"),
        ("reward", r"reward inf at number 0, seed 3, copy 0 for environment, episode 1, step 3"),
        ("observation", r"observation nan at number \(\d,\), seed 3, copy 0 for environment, episode 1, step 3"),
    ],
)
def test_trouble_in_mid_episode_is_named(trouble: str, said: str, workers: int) -> None:
    with pytest.raises(RunError, match=said):
        lived(Gymnasium(f"{__name__}:tests/Odd-v0", {"trouble": trouble}, workers=workers))


class Loose(gymnasium.Env[Any, Any]):
    """Five places in a row, six steps; in its third step, or its second episode, it gives something else."""

    def __init__(self, what: str, value: Any = None, space: Any = None) -> None:
        self.observation_space, self.action_space = space or Discrete(5), Box(-3, 9, (2,), np.int32)
        self.what, self.value, self.episodes = what, value, 0

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self.t, self.episodes = 0, self.episodes + 1
        begun = (self.observation_space.sample() * 0, {})
        return self.value if self.what == "reset" and self.episodes == 2 else begun

    def step(self, action: Any) -> Any:
        assert self.action_space.contains(action), action
        self.t += 1
        if self.what == "exit" and self.t == 3:
            raise SystemExit(self.value)
        answer = [self.observation_space.sample() * 0, 1.0, self.t == 6, False, {}]
        if self.t == 3 and self.what in (names := ["observation", "reward", "terminated", "truncated", "info"]):
            answer[names.index(self.what)] = self.value
        return self.value if self.what == "step" and self.t == 3 else tuple(answer)


gymnasium.register("tests/Loose-v0", entry_point=Loose, max_episode_steps=9)
STEP = r"env\.id='.*tests/Loose-v0' {} step, seed 3, copy 0 for environment, episode 1, step 2: {}"
BROKE = "broke the rules of"
SEEN = (
    r"env\.id='.*tests/Loose-v0': observation {}, seed 3, copy 0 for environment, episode {}, step {}; it must be of {}"
)
LOOSE: list[tuple[dict[str, Any], str]] = [
    ({"what": "exit", "value": 3}, STEP.format("raised in", "SystemExit: 3")),
    ({"what": "reward"}, STEP.format(BROKE, "the reward None is not one number")),
    ({"what": "reward", "value": "abc"}, STEP.format(BROKE, "the reward 'abc' is not one number")),
    ({"what": "reward", "value": [1.0, 2.0]}, STEP.format(BROKE, r"the reward \[1\.0, 2\.0\] is not one number")),
    ({"what": "terminated"}, STEP.format(BROKE, "terminated None is not one number")),
    ({"what": "info"}, STEP.format(BROKE, r"gave None where info is a dictionary")),
    ({"what": "step", "value": (0, 1.0, False, {})}, STEP.format("raised in", "ValueError: not enough values")),
    ({"what": "observation", "value": 7}, SEEN.format(7, 1, 3, r"Discrete\(5\)")),
    ({"what": "observation", "value": -1}, SEEN.format(-1, 1, 3, r"Discrete\(5\)")),
    ({"what": "observation", "value": 0.5}, SEEN.format(0.5, 1, 3, r"Discrete\(5\)")),
    (
        {"what": "observation", "value": np.ones(3), "space": Box(-1, 1, (4,))},
        SEEN.format(r"\[1.0, 1.0, 1.0\], \[3\] of float64", 1, 3, r"Box\(.*\(4,\), float32\)"),
    ),
    (
        {"what": "observation", "value": np.array([0, 2]), "space": MultiBinary(2)},
        SEEN.format(r"\[0, 2\], \[2\] of int64", 1, 3, r"MultiBinary\(2\)"),
    ),
    (
        {"what": "reset", "value": 0},
        "broke the rules of reset, seed 3, copy 0 for environment, episode 2, step 0: gave 0, .* 2: .observation, info",
    ),
    ({"what": "reset", "value": (7, {})}, SEEN.format(7, 2, 0, r"Discrete\(5\)")),
]


@pytest.mark.parametrize(("keys", "said"), LOOSE, ids=[f"{keys['what']}-{keys.get('value')}" for keys, _ in LOOSE])
def test_what_breaks_gymnasiums_rules_is_named_with_its_place(keys: dict[str, Any], said: str) -> None:
    with pytest.raises(RunError, match=said):
        lived(Gymnasium("tests/Loose-v0", keys))


def test_the_api_of_before_is_named() -> None:
    """Where no wrapper stumbles over it."""
    with pytest.raises(RunError, match=r"step: gave a tuple of 4, and since Gymnasium 0\.26 it is a tuple of 5: \(obs"):
        out(0, (0, 1.0, False, {}))


@pytest.mark.thorough
@pytest.mark.parametrize(("keys", "said"), [LOOSE[0], LOOSE[1]], ids=["exit", "reward"])
def test_it_is_so_in_workers(keys: dict[str, Any], said: str) -> None:
    with pytest.raises(RunError, match=said):
        lived(Gymnasium(f"{__name__}:tests/Loose-v0", keys, workers=1))


@pytest.mark.parametrize("reward", [np.array([1.0]), np.array([[1]]), np.float32(1), True, torch.tensor([1.0])])
def test_one_number_is_a_reward_whatever_holds_it(reward: Any) -> None:
    windows, _, _ = lived(Gymnasium("tests/Loose-v0", {"what": "reward", "value": reward}))
    assert windows.labels.tolist() == [[6.0] * 3] * 2


def test_what_ends_python_where_it_is_made_is_said_before_the_start() -> None:
    with pytest.raises(UserError, match="cannot be made: SystemExit: no display"):
        Gymnasium("tests/Exits-v0").problem(None, SEEDS)


def exits() -> None:
    raise SystemExit("no display")


gymnasium.register("tests/Exits-v0", entry_point=exits)


@pytest.mark.parametrize("count", [10_000_000, 20_000])
def test_what_is_too_wide_is_refused_before_the_start(count: int) -> None:
    keys = {"what": "none", "space": Discrete(count)}
    with pytest.raises(
        UserError, match=rf"tests/Loose-v0'.*Discrete\({count}\).*one-hot.*at most 10000.*wrap"
    ) as error:
        Gymnasium("tests/Loose-v0", keys, view="vector").problem(None, SEEDS)
    assert ("env.view=number" in str(error.value)) == (count == 20_000)
    if count == 20_000:
        assert Gymnasium("tests/Loose-v0", keys).problem(None, SEEDS).states == count


def test_an_open_episode_is_played_again() -> None:
    one, other = (Gymnasium("tests/Odd-v0") for _ in range(2))
    problem = one.problem(None, SEEDS)
    for env in (one, other):
        env.start(problem)
    actions = torch.tensor([[1], [2]])
    one.reset()
    for _ in range(8):
        out = one.step(actions)
        if out.terminated is not None and out.terminated.any():
            one.reset(out.terminated)
    state = one.state_dict()
    only_data(state, "")
    other.load_state_dict(state)
    for _ in range(4):
        for mine, theirs in zip(one.step(actions)[:4], other.step(actions)[:4], strict=True):
            assert mine is not None
            assert theirs is not None
            assert torch.equal(mine, theirs)
    state["latest"][0] = state["latest"][1]  # of the other seed
    with pytest.raises(ValueError, match="cannot be gone on with in mid-episode"):
        other.load_state_dict(state)


@pytest.mark.slow
def test_workers_step_what_this_process_would() -> None:
    (here, _, _), (there, _, _) = (lived(Gymnasium("Pendulum-v1", copies=2, max_steps=5, workers=n), 4) for n in (0, 2))
    assert torch.equal(here.states, there.states)
    assert torch.equal(here.labels, there.labels)


def test_frozen_lake_is_judged_by_its_own_P() -> None:
    """Of a lake without slipping the best is sure; of a random walk Gymnasium's own episodes tell."""
    env = Gymnasium("FrozenLake-v1", {"is_slippery": False})
    _, _, problem = lived(env)
    truth = env.truth("sum", problem.window)
    assert truth is not None
    assert truth.best == pytest.approx(1.0)
    uniform = torch.full((1, problem.window, 16, 4), 0.25, dtype=FLOAT)
    assert float(truth.evaluate(uniform)) == pytest.approx(truth.random)
    windows, _, _ = lived(env, 400)
    found = windows.labels.mean()
    assert abs(float(found) - truth.random) < 5 * float(windows.labels.std() / windows.labels.numel() ** 0.5)


@pytest.mark.parametrize(("name", "kind"), [("Taxi-v4", Episodic), ("CartPole-v1", Rollouts)])
def test_the_judge_is_exact_where_P_is_offered(name: str, kind: type) -> None:
    env = Gymnasium(name)
    problem = env.problem(None, SEEDS)
    feedback = BlockSum(problem.window, 0.0)
    env.start(problem)
    assert isinstance(judge(env, feedback, problem, Collector(env, feedback, problem).evaluation), kind)
