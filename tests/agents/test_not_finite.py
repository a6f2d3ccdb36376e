"""Every agent that learns from rewards refuses those that are not finite, and ends a run by the name of what broke."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from credit.agents.block_ucb import BlockUCB
from credit.agents.dqn import DQN
from credit.agents.finite_horizon import FiniteHorizon
from credit.agents.q_learning import QLearning
from credit.agents.value_iteration import ValueIteration
from credit.core.checks import require_finite
from credit.core.errors import RunError
from credit.core.problem import Problem
from credit.core.seams import Agent
from credit.core.store import Store
from credit.core.windows import Windows
from credit.planning.counts import Counts
from credit.rivals.rules import Delayed

Make = Callable[..., Problem]
MakeWindows = Callable[..., Windows]


class Broken(Delayed):
    """One replica's rewards are NaN."""

    def rewards(self, windows: Windows) -> Tensor:
        found = super().rewards(windows).clone()
        found[1] = torch.nan
        return found


class Leaking(Counts):
    """A transition model with a row that is no distribution."""

    def probabilities(self) -> Tensor:
        found = super().probabilities().clone()
        found[1, 3] = torch.nan
        return found


@pytest.mark.parametrize(
    ("agent", "episodic", "said"),
    [
        (DQN(updates=2), True, "DQN: a weight of seed 6 is not finite after 6 updates; are the rewards finite"),
        (QLearning(), False, "Q-learning: a value of seed 6 is not finite"),
        (ValueIteration(Counts()), False, "planning: a reward of seed 6 is not finite"),
        (FiniteHorizon(Counts()), True, "planning: a reward of seed 6 is not finite"),
        (BlockUCB(), False, "Block-UCB: a value of seed 6 is not finite"),
    ],
)
def test_rewards_that_are_no_numbers(
    make_problem: Make, make_windows: MakeWindows, agent: Agent, episodic: bool, said: str
) -> None:
    problem = replace(make_problem((5, 6)), episodic=episodic)
    store = Store(problem)
    agent.start(problem)
    store.append(make_windows(problem, 3))
    with pytest.raises(RunError, match=said):
        agent.improve(store, Broken())


@pytest.mark.parametrize(
    ("agent", "episodic", "said"),
    [
        (ValueIteration(Leaking()), False, "planning: a probability of seed 6 is not finite; look at Leaking"),
        (FiniteHorizon(Leaking()), True, "planning: a value of seed 6 is not finite; are rewards and transitions"),
    ],
)
def test_transitions_that_are_no_numbers(
    make_problem: Make, make_windows: MakeWindows, agent: Agent, episodic: bool, said: str
) -> None:
    problem = replace(make_problem((5, 6)), episodic=episodic)
    store = Store(problem)
    store.append(make_windows(problem, 3))
    with pytest.raises(RunError, match=said):  # who plans before the first step is told so before it
        started(agent, problem).improve(store, Delayed())


def started(agent: Agent, problem: Problem) -> Agent:
    agent.start(problem)
    return agent


def test_a_learning_rate_at_which_weights_overflow(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = replace(make_problem((5,)), episodic=True)
    agent, store = DQN(learning_rate=1e20, updates=20), Store(problem)
    agent.start(problem)
    store.append(make_windows(problem, 3))
    with pytest.raises(RunError, match=r"seed 5 .* else try a smaller agent\.learning_rate"):
        agent.improve(store, Delayed())


def test_large_numbers_are_numbers() -> None:
    require_finite("a weight", torch.full((2, 9), 3e38), (0, 1), "")  # their sum is infinite
    with pytest.raises(RunError, match="a weight of seed 0, 1 is not finite"):
        require_finite(
            "a weight", [torch.ones(4, 2), torch.tensor([[1.0], [torch.inf], [0.0], [torch.nan]])], (0, 1), ""
        )
