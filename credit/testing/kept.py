"""What an agent owes to whoever comes after the run: its policy can be kept, for each seed by itself."""

from __future__ import annotations

from dataclasses import replace

import torch

from credit.config import schema
from credit.core.acting import alone, laid_over
from credit.core.capabilities import parts_of
from credit.core.knowledge import inform
from credit.core.policy import Policy, TablePolicy
from credit.core.problem import Problem
from credit.core.seams import Agent
from credit.core.store import Store
from credit.runs import checkpoint
from credit.testing.cases import Case
from credit.testing.expect import expect

HINT = "name in `acts` what its policies look at, as tensors [R, ...] or lists of R"
APART = 1e-4  # of actions that are vectors, by the rounding of networks beside others and alone


def kept(case: Case, part: Agent, problem: Problem, store: Store) -> None:
    """Policies of a finished run can be kept: one seed's part, laid over an agent made anew, does the same."""
    policies = part.policies()
    if all(type(policy) is TablePolicy for policy in policies.values()):
        return  # the tables themselves are kept
    try:
        checkpoint.only_data(state := part.acting(), "acting()")
    except TypeError as error:
        raise AssertionError(f"its policy cannot be kept: {error}") from None
    for replica, seed in enumerate(problem.seeds):
        fresh = _made(case, replace(problem, seeds=(seed,)))
        try:
            own = alone(state, replica, problem.replicas, fresh.acting())
        except ValueError as error:
            raise AssertionError(f"one seed's policy cannot be kept: {error}; {HINT}") from None
        fresh.load_state_dict(laid_over(fresh.state_dict(), own))
        states = store.windows.states[replica : replica + 1]
        for name, policy in fresh.policies().items():
            beside = _done(policies[name], store.windows.states)
            if torch.equal(beside, _done(policies[name], store.windows.states)):  # else it draws, and does so anew
                far = float((_done(policy, states) - beside[replica : replica + 1]).abs().max())
                expect(
                    far < APART,
                    f"the policy {name!r} of seed {seed}, kept and made anew, does something else than it did ({far:g} "
                    f"apart); {HINT}",
                )


def _made(case: Case, problem: Problem) -> Agent:
    agent: Agent = schema.build(case.config, "agent")
    inform(list(parts_of(agent, "agent")), case.experience()[2])
    agent.start(problem)
    return agent


def _done(policy: Policy, states: torch.Tensor) -> torch.Tensor:
    return policy.act(states, torch.zeros(states.shape[:2], dtype=torch.int64))
