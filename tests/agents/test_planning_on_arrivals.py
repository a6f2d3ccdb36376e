"""Planning with a pseudo-reward of s', or of the step, against loops."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
import torch

from credit.agents.finite_horizon import FiniteHorizon
from credit.agents.value_iteration import ValueIteration
from credit.core.cells import Axis, Cells
from credit.core.errors import UserError
from credit.core.policy import TablePolicy
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Agent, Transition
from credit.core.store import Store
from credit.core.windows import Windows
from credit.planning.counts import Counts, ObservedCounts
from credit.recovery.features.tabular import Identity
from credit.recovery.mixers import ReferenceOnly
from credit.recovery.models.linear import LinearModel
from credit.recovery.recovery import Recovery
from credit.recovery.uncertainty.bootstrap import Bootstrap

from .assigners import Believed

Make = Callable[..., Problem]
STATES, ACTIONS, WINDOW = 5, 3, 4
SIZES = {"step": WINDOW, "state": STATES, "action": ACTIONS, "next_state": STATES}
KINDS: list[tuple[Axis, ...]] = [
    ("state", "action"),
    ("step", "state", "action"),
    ("next_state",),
    ("step", "next_state"),
    ("state",),
    ("step", "action"),
]


def problem_of(make_problem: Make, episodic: bool) -> Problem:
    problem = make_problem((0, 1, 2), states=STATES, actions=ACTIONS, window=WINDOW)
    return replace(problem, episodic=episodic)


def planned(agent: Agent, problem: Problem, windows: Windows, believed: Believed) -> Agent:
    store = Store(problem)
    store.append(windows)
    agent.start(problem)
    agent.improve(store, believed)
    return agent


def followed(agent: Agent) -> dict[str, torch.Tensor]:
    """The policies as tables."""
    return {name: policy.actions for name, policy in agent.policies().items() if isinstance(policy, TablePolicy)}


def tables(problem: Problem, axes: tuple[Axis, ...]) -> tuple[Cells, torch.Tensor, torch.Tensor]:
    """Random mixed and planned rewards over some axes."""
    cells = Cells.over(axes, WINDOW, STATES, ACTIONS)
    generator = torch.Generator().manual_seed(3)
    mixed, plan = (torch.randn(problem.replicas, cells.count, dtype=FLOAT, generator=generator) for _ in range(2))
    return cells, mixed, plan


def reward(table: np.ndarray, axes: tuple[Axis, ...], **step: int) -> float:
    """The entry of a table [N] for one step."""
    return float(table.reshape([SIZES[axis] for axis in axes])[tuple(step[axis] for axis in axes)])


def counted(windows: Windows, replica: int) -> np.ndarray:
    """N(s, a, s')."""
    counts = np.zeros((STATES, ACTIONS, STATES))
    steps = (windows.states, windows.actions, windows.next_states)
    np.add.at(counts, tuple(part[replica].numpy().ravel() for part in steps), 1)
    return counts


def expected(transition: np.ndarray, table: np.ndarray, axes: tuple[Axis, ...], step: int) -> np.ndarray:
    """What a step pays on average, [S, A]. Of a zero row an arrival pays nothing, a pair pays its reward."""
    found = np.zeros((STATES, ACTIONS))
    for s, a in product(range(STATES), range(ACTIONS)):
        if "next_state" not in axes:
            found[s, a] = reward(table, axes, step=step, state=s, action=a)
            continue
        for then in range(STATES):
            found[s, a] += transition[s, a, then] * reward(table, axes, step=step, next_state=then)
    return found


@pytest.mark.parametrize("axes", KINDS, ids="-".join)
@pytest.mark.parametrize("transition", [ObservedCounts(), Counts("zero", 0.0), Counts()], ids=["seen", "zero", "prior"])
@pytest.mark.parametrize("seen", [2, 60])
def test_plans_in_episodes(
    make_problem: Make,
    make_windows: Callable[..., Windows],
    transition: Transition,
    axes: tuple[Axis, ...],
    seen: int,
) -> None:
    problem = problem_of(make_problem, episodic=True)
    windows = make_windows(problem, seen)
    cells, mixed, plan = tables(problem, axes)
    agent = planned(FiniteHorizon(transition), problem, windows, Believed(mixed, plan, cells))
    policies = followed(agent)
    for replica in range(3):
        counts = counted(windows, replica)
        if isinstance(transition, Counts) and transition.pseudo_counts:
            for s, move in product(range(STATES), (-1, 0, 1)):
                counts[s, :, min(max(s + move, 0), STATES - 1)] += 1 / 3
        model = counts / np.maximum(counts.sum(-1, keepdims=True), 1e-300)
        for name, table in (("behaviour", plan), ("greedy", mixed)):
            value = np.zeros(STATES)
            for step in reversed(range(WINDOW)):
                ahead = expected(model, table[replica].numpy(), axes, step) + model @ value
                value = ahead.max(-1)
                chosen = policies[name][replica, step].numpy()
                assert (value - ahead[np.arange(STATES), chosen] < 1e-8).all(), (name, replica, step)
    if seen == 60:
        assert not torch.equal(policies["behaviour"], policies["greedy"])


@pytest.mark.parametrize("axes", [axes for axes in KINDS if "step" not in axes], ids="-".join)
def test_plans_without_end(make_problem: Make, make_windows: Callable[..., Windows], axes: tuple[Axis, ...]) -> None:
    problem, discount = problem_of(make_problem, episodic=False), 0.9
    windows = make_windows(problem, 12)
    cells, mixed, plan = tables(problem, axes)
    agent = planned(ValueIteration(Counts("self_loop"), discount), problem, windows, Believed(mixed, plan, cells))
    policies = followed(agent)
    for replica in range(3):
        counts = counted(windows, replica)
        counts[np.arange(STATES), :, np.arange(STATES)] += 1
        model = counts / counts.sum(-1, keepdims=True)
        for name, table in (("behaviour", plan), ("greedy", mixed)):
            pays, value = expected(model, table[replica].numpy(), axes, 0), np.zeros(STATES)
            for _ in range(400):  # .9⁴⁰⁰ is 5e-19
                value = (pays + discount * model @ value).max(-1)
            ahead = pays + discount * model @ value
            chosen = policies[name][replica].numpy()
            assert (ahead.max(-1) - ahead[np.arange(STATES), chosen] < 1e-6).all(), (name, replica)
            assert ahead.max(-1).max() > ahead.min() + 0.1
    assert not torch.equal(policies["behaviour"], policies["greedy"])


def recovery_over(axes: tuple[Axis, ...], **parameters: Any) -> Recovery:
    model = LinearModel("ridge", Identity(axes), Bootstrap(3), 0.1, **parameters)
    return Recovery(model, {}, ReferenceOnly(), {})


def test_the_average_reward_of_arrivals(make_problem: Make, make_windows: Callable[..., Windows]) -> None:
    # What is learned from labels, planned for the average reward: π is compared with all 3⁵ policies.
    problem = problem_of(make_problem, episodic=False)
    recovery, agent = recovery_over(("next_state",)), ValueIteration(Counts())
    store = Store(problem)
    store.append(make_windows(problem, 40))
    for part in (recovery, agent):
        part.start(problem)
    recovery.observe(store)
    agent.improve(store, recovery)
    for replica in range(3):
        rows = store.windows.grid(store.windows.next_states)[replica].numpy()
        x = np.stack([np.bincount(row, minlength=STATES) for row in rows])
        y = store.windows.labels[replica].numpy()
        table = np.linalg.solve(x.T @ x + 0.1 * np.eye(STATES), x.T @ y)
        counts = counted(store.windows, replica)
        for s, move in product(range(STATES), (-1, 0, 1)):
            counts[s, :, min(max(s + move, 0), STATES - 1)] += 1 / 3
        model = counts / counts.sum(-1, keepdims=True)
        gains = {}
        for policy in product(range(ACTIONS), repeat=STATES):
            chain = model[np.arange(STATES), policy]
            stationary = np.linalg.matrix_power(chain, 1024)[0]
            gains[policy] = float(stationary @ table)
        mine = tuple(followed(agent)["behaviour"][replica].tolist())
        assert gains[mine] == pytest.approx(max(gains.values()), abs=1e-9)
        assert max(gains.values()) > min(gains.values()) + 0.01


@pytest.mark.parametrize(
    ("axes", "parameters"),
    [(("step", "state", "action"), {}), (("step", "next_state"), {}), (("state", "action"), {"credit": "last_step"})],
)
def test_the_step_is_refused_where_windows_follow_each_other(
    make_problem: Make, axes: tuple[Axis, ...], parameters: dict[str, Any]
) -> None:
    with pytest.raises(UserError, match=r"looks at the step.*follow each other.*states and actions alone"):
        recovery_over(axes, **parameters).start(problem_of(make_problem, episodic=False))
    recovery_over(axes, **parameters).start(problem_of(make_problem, episodic=True))
