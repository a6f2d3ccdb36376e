"""Episodes of one step with a best action that is known, in any kind of spaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from credit.agents.torchrl.agent import TorchRL
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Agent
from credit.core.store import Store
from credit.core.windows import Windows
from credit.rivals.rules import Delayed

SIDES = torch.tensor([[-1.0], [1.0]])  # the two states as vectors


def bandit(seeds: Sequence[int] = (0, 1), states: str = "finite", actions: str = "finite") -> Problem:
    """Two states; two actions, or vectors of one number."""
    numbers, vectors = Problem.finite(2, 2, 1, tuple(seeds), episodic=True), Problem.vectors(1, 1, 1, tuple(seeds))
    space = (numbers if actions == "finite" else vectors).action_space
    return replace(numbers if states == "finite" else vectors, action_space=space)


def seen(problem: Problem, which: Tensor) -> Tensor:
    """States [R, K], 0 or 1, as the problem has them."""
    return which if problem.finite_states else SIDES[which]


def best(problem: Problem, which: Tensor) -> Tensor:
    """The best action in each state: the other number, or .9 against the state's sign."""
    return 1 - which if problem.finite_actions else -0.9 * SIDES[which]


def played(agent: Agent, problem: Problem, copies: int = 32) -> Windows:
    """One episode of each copy. The label is 1 for the best action, less the squared distance from it."""
    which = (torch.arange(copies) % 2).expand(problem.replicas, -1)
    states, step = seen(problem, which), torch.zeros(problem.replicas, copies, dtype=torch.int64)
    actions = agent.act(states, step)
    gap = (actions - best(problem, which)).to(FLOAT)
    labels = 1 - gap.square().flatten(2).sum(2) if gap.dim() == 3 else 1 - gap.square()
    return Windows.of_grid(*(part.unsqueeze(2) for part in (states, actions, states)), labels)


def lived(problem: Problem, rounds: int, copies: int = 32, **keys: Any) -> tuple[TorchRL, Store]:
    """An agent after some rounds, and what it has seen."""
    agent, store = TorchRL(**keys), Store(problem)
    agent.start(problem)
    go_on(agent, store, problem, rounds, copies)
    return agent, store


def go_on(agent: TorchRL, store: Store, problem: Problem, rounds: int, copies: int = 32) -> None:
    """Some more rounds."""
    for _ in range(rounds):
        store.append(played(agent, problem, copies))
        agent.improve(store, Delayed())


def weights(agent: TorchRL, replica: int) -> list[Tensor]:
    """All weights and targets of a replica."""
    return [value.detach().clone() for value in agent._learners[replica].loss.state_dict().values()]
