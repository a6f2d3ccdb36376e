"""The learner on transitions that somebody has: what does not fit is refused by row and value, before it is learned."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from credit.agents.sac.learner import Learner
from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.windows import Episode, Windows

PROBLEM = Problem.vectors(observations=2, actions=1, window=5, seeds=(7,))
Spoil = Callable[[torch.Tensor, torch.Tensor, torch.Tensor], object]


def learner(observations: int = 2) -> Learner:
    made = Learner(width=8, batch=4, n_step=1, success_share=0.0)
    made.make(observations=observations, actions=1, seeds=PROBLEM.seeds)
    return made


def some(spoil: Spoil = lambda states, actions, rewards: None) -> tuple[Windows, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    states, actions = torch.randn(6, 2, generator=generator), torch.rand(5, 1, generator=generator) * 2 - 1
    rewards = torch.ones(1, 5)
    spoil(states, actions, rewards)
    episode = Episode(states[:-1], actions, states[1:])
    return Windows.of_episodes([[episode]], torch.zeros(1, 1, dtype=torch.float64)), rewards


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda s, a, r: a.mul_(0).add_(5), r"row 0 of seed 7 has the action \[5.0\]: .* in \[-1, 1\]"),
        (lambda s, a, r: a[3].fill_(torch.nan), r"row 3 of seed 7 has the action \[nan\]"),
        (lambda s, a, r: s[2].fill_(torch.inf), r"row 2 of seed 7 has the state \[inf, inf\]: states are finite"),
        (lambda s, a, r: r[0, 4].fill_(torch.nan), "row 4 of seed 7 has the reward nan: rewards are finite"),
    ],
)
def test_rows_that_do_not_fit_are_named(spoil: Spoil, said: str) -> None:
    replay = learner().replay(PROBLEM)
    with pytest.raises(UserError, match=said):
        replay.relabel(*some(spoil))


def test_what_is_missing_is_said() -> None:
    with pytest.raises(UserError, match=r"this learner was made for .* call make\(observations, actions, seeds\)"):
        Learner().replay(PROBLEM)
    with pytest.raises(UserError, match=r"made for seeds, observations and actions .*3, 1.*the problem has .*2, 1"):
        learner(observations=3).replay(PROBLEM)
    made = learner()
    replay = made.replay(PROBLEM)
    with pytest.raises(UserError, match="this replay has no rows yet"):
        made.fit(replay, updates=1)
    replay.relabel(*some())
    with pytest.raises(UserError, match="updates=0: at least 1"):
        made.fit(replay, updates=0)
    assert made.fit(replay, updates=1)["critic"].isfinite().all()
