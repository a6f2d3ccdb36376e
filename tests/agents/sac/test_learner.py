"""The learner: replicas, streams and states to the last bit; and that it learns."""

from __future__ import annotations

import io
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import torch
from gymnasium.spaces import Discrete
from tensordict import TensorDict
from torch import Tensor
from torchrl.envs.utils import ExplorationType, set_exploration_type

from credit.agents.sac.learner import Learner
from credit.core.errors import RunError, UserError
from credit.core.problem import Problem
from credit.core.store import Store
from credit.core.windows import Episode, Windows
from credit.data.replay import Replay
from credit.networks.stack import Stack

Make = Callable[..., tuple[Learner, Replay]]
RECIPES: list[dict[str, Any]] = [
    {"batch": 37, "width": 18, "success_share": 0.5},
    {"layer_norm": False, "policy_delay": 1, "n_step": 1, "success_share": 0.0, "target_clip": False},
]


def members(stack: Stack, first: int, count: int) -> list[Tensor]:
    """The weights of some members."""
    return [block[first : first + count] for block in stack.blocks]


def same(a: list[Tensor], b: list[Tensor]) -> bool:
    return all(torch.equal(x, y) for x, y in zip(a, b, strict=True))


def close(a: list[Tensor], b: list[Tensor]) -> None:
    """Equal to rounding: within 1e-5, where another's noise makes 1e-3 of difference."""
    for x, y in zip(a, b, strict=True):
        torch.testing.assert_close(x, y, rtol=0, atol=1e-5)


@pytest.mark.parametrize("recipe", RECIPES)
def test_a_replica_learns_alone_as_in_a_batch(make_learner: Make, recipe: dict[str, Any]) -> None:
    together, replay = make_learner((0, 1, 2, 3), **recipe)
    first = [members(together.critic, 2 * r, 2) for r in range(4)]
    first = [[block.clone() for block in blocks] for blocks in first]
    values = together.fit(replay, 10)
    for r in (0, 2, 3):
        alone, own = make_learner((r,), **recipe)
        assert same(first[r], alone.critic.blocks)
        found = alone.fit(own, 10)
        close(members(together.actor, r, 1), alone.actor.blocks)
        close(members(together.average, r, 1), alone.average.blocks)
        close(members(together.critic, 2 * r, 2), alone.critic.blocks)
        close(members(together.target, 2 * r, 2), alone.target.blocks)
        torch.testing.assert_close(together.log_alpha[r], alone.log_alpha[0])
        for key in values:
            torch.testing.assert_close(values[key][r], found[key][0], rtol=1e-4, atol=1e-5)


def test_each_replica_has_noise_of_its_own(make_learner: Make) -> None:
    together, _ = make_learner((0, 1, 2))
    noise = together._noise.normal(5, 2, 8, 2, axis=2)
    for r in range(3):
        alone, _ = make_learner((r,))
        assert torch.equal(noise[:, :, r], alone._noise.normal(5, 2, 8, 2, axis=2)[:, :, 0])
    assert not torch.equal(noise[:, :, 0], noise[:, :, 1])


def test_seeds_and_purposes_differ(make_learner: Make) -> None:
    sac, _ = make_learner((0, 1))
    again, _ = make_learner((1,))
    weights = [sac.critic.layers[1].weight[j] for j in range(4)]
    assert not any(torch.equal(weights[i], weights[j]) for i in range(4) for j in range(i))
    assert torch.equal(again.critic.layers[1].weight, torch.stack(weights[2:]))
    bound = 1 / 16**0.5
    assert all(weight.abs().max() <= bound for weight in weights)
    assert torch.stack(weights).std() == pytest.approx(bound / 3**0.5, rel=0.1)


def test_two_runs_of_a_seed_are_equal_to_the_last_bit(make_learner: Make) -> None:
    finals = []
    for _ in range(2):
        sac, replay = make_learner((5,), width=32, batch=32)
        sac.fit(replay, 50)
        finals.append([sac.actor.flat, sac.critic.flat, sac.target.flat, sac.average.flat, sac.log_alpha])
    assert same(*finals)


def test_a_state_continues_bit_for_bit(make_learner: Make) -> None:
    sac, replay = make_learner((0, 1))
    requests = TensorDict({"observation": torch.randn(6, 4)}, [6])
    policy = sac.policy(copies=3, horizon=4)
    sac.fit(replay, 35)
    policy(requests)
    policy.restart()
    file = io.BytesIO()
    torch.save({"sac": sac.state_dict(), "replay": replay.state_dict()}, file)
    sac.fit(replay, 35)
    file.seek(0)
    state = torch.load(file, weights_only=True)  # tensors and plain data only
    other = Learner(width=16, batch=8, n_step=3)
    other.make(4, 2, (0, 1))
    refilled = other.replay(Problem.vectors(4, 2, 20, (0, 1)))
    other.load_state_dict(state["sac"])
    refilled.load_state_dict(state["replay"])
    refilled.relabel(replay.windows, replay.windows.states[..., 1])
    other.fit(refilled, 35)
    assert same(
        [sac.actor.flat, sac.average.flat, sac.log_alpha], [other.actor.flat, other.average.flat, other.log_alpha]
    )
    assert same([sac.critic.flat, sac.target.flat], [other.critic.flat, other.target.flat])
    continued = other.policy(copies=3, horizon=4)
    assert torch.equal(policy(requests)["action"].clone(), continued(requests)["action"])


def test_delay_targets_and_average(make_learner: Make) -> None:
    sac, replay = make_learner((0,), policy_delay=3, target_rate=0.25, average_rate=0.5)
    batches = replay.sample(8, 3)
    for number, batch in enumerate(batches, start=1):
        actor, target, average = sac.actor.flat.clone(), sac.target.flat.clone(), sac.average.flat.clone()
        sac.update(batch, torch.randn(2, 1, 8, 2))
        torch.testing.assert_close(sac.target.flat, target + 0.25 * (sac.critic.flat - target))
        torch.testing.assert_close(sac.average.flat, average + 0.5 * (sac.actor.flat - average))
        assert torch.equal(sac.actor.flat, actor) == (number < 3)


def test_the_temperature_moves_towards_the_target_entropy_unless_it_is_fixed(make_learner: Make) -> None:
    keys = {"policy_delay": 1, "temperature": 0.3}
    for target, sign in ((-20.0, -1), (20.0, 1)):
        sac, replay = make_learner((0,), target_entropy=target, **keys)
        values = sac.fit(replay, 5)
        assert sign * (values["temperature"].item() - 0.3) > 0
    fixed, replay = make_learner((0,), adapt_temperature=False, **keys)
    assert fixed.fit(replay, 5)["temperature"].item() == pytest.approx(0.3)


def bandit(states: Tensor, ends: bool = True, **keys: Any) -> tuple[Learner, Problem, Windows, Tensor]:
    """500 steps r = −|a − (.5, −.25)|², each an episode of its own."""
    sac = Learner(**({"width": 32, "batch": 32, "learning_rate": 3e-3, "policy_delay": 1, "n_step": 1} | keys))
    n = len(states)
    actions = torch.rand(n, 2, generator=torch.Generator().manual_seed(0)) * 2 - 1
    episodes = [[Episode(states[k : k + 1], actions[k : k + 1], states[k : k + 1], ends) for k in range(n)]]
    rewards = -(actions - torch.tensor([0.5, -0.25])).square().sum(-1)
    windows = Windows.of_episodes(episodes, rewards.unsqueeze(0))
    problem = Problem.vectors(states.shape[-1] if states.dim() > 1 else 1, 2, 1, (0,))
    if states.dim() == 1:  # they are numbers
        problem = replace(problem, observation_space=Discrete(3))
    return sac, problem, windows, rewards.unsqueeze(0)


def test_it_learns_a_bandit_from_python_alone() -> None:
    """From a store that was filled by hand: the mean action moves to the best."""
    sac, problem, windows, rewards = bandit(torch.zeros(500, 1), target_entropy=-6.0, success_share=0.0)
    store = Store(problem)
    store.append(windows)
    sac.make(1, 2, seeds=(0,))
    replay = sac.replay(problem)
    replay.relabel(store.windows, rewards)
    sac.fit(replay, 400)
    for averaged in (False, True):
        mean = sac.mean(torch.zeros(1, 3, 1), averaged)
        assert mean.shape == (1, 3, 2)
        assert mean[0, 0].tolist() == pytest.approx([0.5, -0.25], abs=0.15)
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        same_mean = sac.policy(1, 1)(TensorDict({"observation": torch.zeros(1, 1)}, [1]))["action"][0]
    torch.testing.assert_close(same_mean, sac.mean(torch.zeros(1, 1, 1))[0, 0])


@pytest.mark.thorough
def test_the_clip_leaves_room_for_entropy() -> None:
    """Nothing is paid, nothing ends: a soft value is the entropy to come, and only that. Clipped to the returns it
    would be 0; it must come out as without the clip, and near α·H/(1 − γ)."""
    keys: dict[str, Any] = {"adapt_temperature": False, "temperature": 0.1, "discount": 0.8, "target_rate": 0.05}
    found = []
    for clip in (False, True):
        sac, problem, windows, rewards = bandit(
            torch.zeros(500, 1), ends=False, success_share=0.0, target_clip=clip, **keys
        )
        sac.make(1, 2, seeds=(0,))
        replay = sac.replay(problem)
        replay.relabel(windows, 0 * rewards)
        for _ in range(30):
            values = sac.fit(replay, 32)
        found.append((float(values["q"]), float(values["entropy"])))
    for q, entropy in found:
        assert entropy > 1.0  # of 2 log 2 at most
        assert q == pytest.approx(0.8 * 0.1 * entropy / (1 - 0.8), abs=0.1)
        assert q > 0.3
    assert found[0] == pytest.approx(found[1], abs=0.05)


def test_states_may_be_numbers() -> None:
    """A number is seen one-hot: the same updates as on one-hot vectors."""
    number = torch.arange(500) % 3
    runs = []
    for states in (number, torch.nn.functional.one_hot(number, 3).float()):
        sac, problem, windows, rewards = bandit(states, prefer="top")
        sac.make(3, 2, seeds=(0,))
        replay = sac.replay(problem)
        replay.relabel(windows, rewards)
        sac.fit(replay, 40)
        runs.append([sac.actor.flat, sac.critic.flat, sac.mean(states[None, :3])])
    assert same(*runs)


@pytest.mark.thorough
def test_importing_the_learner_loads_no_framework_of_runs() -> None:
    code = "import sys, credit.agents.sac.learner; print([m for m in ('hydra', 'mlflow') if m in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


def test_how_many_updates_a_round_takes() -> None:
    fixed = Learner(updates=7, first_updates=20)
    assert [fixed.round_updates(first, [100, 30]) for first in (True, False)] == [20, 7]
    ratio = Learner(update_ratio=0.5)
    assert ratio.round_updates(True, [101, 101]) == 50
    with pytest.raises(UserError, match=r"\[30, 100\] new transitions"):
        ratio.round_updates(False, [100, 30])


def test_a_weight_that_is_not_finite_stops_the_run(make_learner: Make) -> None:
    sac, replay = make_learner((3, 4))
    rewards = torch.zeros(2, len(replay.windows))
    rewards[1] = torch.nan
    replay.relabel(replay.windows, rewards, checked=True)
    with pytest.raises(
        RunError, match=r"critic of seed 4 is not finite after 20 updates|actor of seed 4 is not finite"
    ):
        sac.fit(replay, 20)


@pytest.mark.slow
def test_compiled_updates_are_the_same_updates(make_learner: Make) -> None:
    (eager, replay), (compiled, other) = (make_learner((0, 1), compile=value, **RECIPES[0]) for value in (False, True))
    eager.fit(replay, 6)
    compiled.fit(other, 6)
    torch.testing.assert_close(compiled.actor.flat, eager.actor.flat, rtol=1e-3, atol=1e-5)
    torch.testing.assert_close(compiled.critic.flat, eager.critic.flat, rtol=1e-3, atol=1e-5)
