"""Actors side by side as a collector's policy."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from tensordict import TensorDict
from torchrl.envs.utils import ExplorationType, set_exploration_type

from credit.agents.sac.learner import Learner
from credit.agents.sac.networks import extract_actor
from credit.agents.sac.policy import Policy
from credit.data.replay import Replay

Make = Callable[..., tuple[Learner, Replay]]


def acts(policy: Policy, observations: torch.Tensor) -> torch.Tensor:
    return policy(TensorDict({"observation": observations}, observations.shape[:1]))["action"]


def test_the_mean_action_is_that_of_the_torchrl_module(make_learner: Make) -> None:
    sac, replay = make_learner((0, 1))
    sac.fit(replay, 20)
    observations = torch.randn(10, 4)
    for averaged, stack in ((False, sac.actor), (True, sac.average)):
        with set_exploration_type(ExplorationType.DETERMINISTIC):
            actions = acts(sac.policy(5, 3, averaged), observations)
            for r in range(2):
                rows = slice(5 * r, 5 * r + 5)
                expected = extract_actor(stack, r)(TensorDict({"observation": observations[rows]}, [5]))["action"]
                torch.testing.assert_close(actions[rows], expected)
    assert not torch.equal(sac.actor.flat, sac.average.flat)


def test_sampled_actions_have_the_distribution_of_the_torchrl_module(make_learner: Make) -> None:
    sac, _ = make_learner((0,))
    observations = torch.randn(1, 4).expand(4000, 4)
    with set_exploration_type(ExplorationType.RANDOM):
        actions = acts(sac.policy(4000, 1), observations)
    normal = extract_actor(sac.actor, 0).get_dist(TensorDict({"observation": observations[:1]}, [1]))
    u = actions.atanh()
    torch.testing.assert_close(u.mean(0), normal.loc[0].detach(), rtol=0, atol=0.06)
    torch.testing.assert_close(u.std(0), normal.scale[0].detach(), rtol=0.05, atol=0)


def test_noise_does_not_depend_on_how_long_the_rounds_of_others_last(make_learner: Make) -> None:
    observations = torch.randn(6, 4)
    together, alone = make_learner((0, 1))[0].policy(3, 8), make_learner((1,))[0].policy(3, 8)
    with set_exploration_type(ExplorationType.RANDOM):
        for lasts, needed in ((8, 3), (5, 5), (2, 1)):
            ours = torch.stack([acts(together, observations)[3:] for _ in range(lasts)])
            theirs = torch.stack([acts(alone, observations[3:]) for _ in range(needed)])
            assert torch.equal(ours[:needed], theirs)
            assert not torch.equal(ours[0], ours[1])
            together.restart()
            alone.restart()


def test_evaluation_draws_no_noise(make_learner: Make) -> None:
    observations = torch.randn(3, 4)
    explored = []
    for evaluates in (False, True):
        sac, _ = make_learner((0,))
        if evaluates:
            with set_exploration_type(ExplorationType.DETERMINISTIC):
                acts(sac.policy(3, 8, averaged=True), observations)
        with set_exploration_type(ExplorationType.RANDOM):
            explored.append(acts(sac.policy(3, 8), observations))
    assert torch.equal(*explored)


def test_rows_must_be_copies_of_all_replicas(make_learner: Make) -> None:
    policy = make_learner((0, 1))[0].policy(copies=3, horizon=2)
    with pytest.raises(RuntimeError, match="shape"):
        acts(policy, torch.randn(5, 4))
