"""Block-UCB: which macro-action is tried next, and what it is worth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import pytest
import torch

from credit.agents.block_ucb import BlockUCB
from credit.core.errors import UserError
from credit.core.policy import TablePolicy
from credit.core.problem import Problem
from credit.core.store import Store, Windows
from credit.rivals.rules import Delayed

Make = Callable[..., Problem]


def play(
    learner: BlockUCB, problem: Problem, blocks: int, label: Callable[[int], float], state: int = 0
) -> list[list[int]]:
    """The macro-actions [R][blocks] taken by a learner that always starts from one state and returns to it."""
    store = Store(problem)
    taken: list[list[int]] = [[] for _ in problem.seeds]
    states = torch.full((problem.replicas,), state)
    for _ in range(blocks):
        clock = torch.arange(problem.window).view(-1, 1, 1).expand(-1, problem.replicas, 1)
        actions = torch.cat([learner.act(states.unsqueeze(1), step) for step in clock], dim=1)
        macros = [number(row, problem.actions) for row in actions.tolist()]
        for mine, macro in zip(taken, macros, strict=True):
            mine.append(macro)
        everywhere = states[:, None, None].expand(-1, 1, problem.window)
        labels = torch.tensor([[label(macro)] for macro in macros], dtype=torch.float64)
        store.append(Windows.of_grid(everywhere, actions[:, None], everywhere, labels))
        learner.improve(store, Delayed())
    return taken


def number(digits: Sequence[int], base: int) -> int:
    """A macro-action's number: its first action is the highest digit."""
    value = 0
    for digit in digits:
        value = value * base + digit
    return value


def started(problem: Problem, **parameters: Any) -> BlockUCB:
    learner = BlockUCB(**parameters)
    learner.start(problem)
    return learner


def test_untried_macro_actions_in_lexicographic_order(make_problem: Make) -> None:
    problem = make_problem((0, 1), window=3)
    taken = play(started(problem, ties="lexicographic"), problem, 27, lambda macro: 0.0)
    assert taken == [list(range(27))] * 2


def test_untried_macro_actions_in_a_random_order(make_problem: Make) -> None:
    problem = make_problem((0, 1), window=3)
    taken = play(started(problem, ties="random"), problem, 27, lambda macro: 0.0)
    for order in taken:
        assert sorted(order) == list(range(27))  # none twice while untried ones are worth more
        assert order != list(range(27))
    assert taken[0] != taken[1]


def test_the_order_is_that_of_the_seed(make_problem: Make) -> None:
    problem, alone = make_problem((3, 4), window=3), make_problem((4,), window=3)
    batch = play(started(problem), problem, 12, lambda macro: 0.0)
    assert play(started(alone), alone, 12, lambda macro: 0.0) == [batch[1]]


def test_a_macro_action_that_pays_is_repeated(make_problem: Make) -> None:
    # An untried one promises c/√λ = 1. Macro-action 3 pays 5, so after it there is no reason to try another.
    problem = make_problem((0,), window=2)
    taken = play(started(problem, ties="lexicographic"), problem, 10, lambda macro: 5.0 if macro == 3 else 0.0)
    assert taken == [[0, 1, 2, 3, 3, 3, 3, 3, 3, 3]]


def test_when_all_are_tried_the_best_is_taken(make_problem: Make) -> None:
    problem = make_problem((0,), actions=2, window=2)
    # small c: after one try each, the mean decides
    learner = started(problem, ties="lexicographic", scale=0.01)
    taken = play(learner, problem, 60, lambda macro: [0.0, 0.3, 1.0, 0.5][macro] - 2.0)
    assert taken[0][:4] == [0, 1, 2, 3]
    assert taken[0][4:] == [2] * 56


def test_states_have_orders_of_their_own(make_problem: Make) -> None:
    problem = make_problem((0,), window=2)
    learner = started(problem, ties="lexicographic")
    assert play(learner, problem, 2, lambda macro: 0.0, state=3) == [[0, 1]]
    assert play(learner, problem, 2, lambda macro: 0.0, state=8) == [[0, 1]]
    assert play(learner, problem, 2, lambda macro: 0.0, state=3) == [[2, 3]]


def test_values_by_hand(make_problem: Make) -> None:
    # One state, one action, T = 1: one macro-action. V₀ = 1/(1 − .5) = 2. A block of reward 3 and count 1:
    # V = 3 + 1/√2 + .5·V, one backup from 2: 4 + 1/√2.
    problem = make_problem((0,), states=1, actions=1, window=1)
    learner = started(problem, discount=0.5, backups=1)
    assert learner._value.tolist() == [[2.0]]
    play(learner, problem, 1, lambda macro: 3.0)
    torch.testing.assert_close(learner._value, torch.tensor([[4 + 0.5**0.5]], dtype=torch.float64))
    # a second block of reward 1: mean 2, count 2: 2 + 1/√3 + .5·V
    before = float(learner._value)
    play(learner, problem, 1, lambda macro: 1.0)
    expected = 2 + 3**-0.5 + 0.5 * before
    torch.testing.assert_close(learner._value, torch.tensor([[expected]], dtype=torch.float64))


def test_memory_grows_with_what_was_tried(make_problem: Make) -> None:
    # 700 macro-actions pass the first 256 slots twice, and none is forgotten: all are different
    problem = make_problem((0,), window=6)
    taken = play(started(problem, backups=1), problem, 700, lambda macro: -1.0)
    assert len(set(taken[0])) == 700


def test_the_policy_is_the_first_action(make_problem: Make) -> None:
    problem = make_problem((0,), window=2)
    learner = started(problem, ties="lexicographic")
    play(learner, problem, 9, lambda macro: 9.0 if macro == 7 else 0.0)
    policy = learner.policies()["behaviour"]
    assert isinstance(policy, TablePolicy)
    assert policy.actions.shape == (1, 10)
    assert policy.actions[0].tolist() == [2, 0, 0, 0, 0, 0, 0, 0, 0, 0]  # 7 = (2, 1); elsewhere nothing was tried


def test_a_window_too_long_is_refused(make_problem: Make) -> None:
    started(make_problem(window=10))  # 3^10 = 59,049
    with pytest.raises(UserError, match=r"feedback\.window=11.*3\^11 = 177147.*at most 100000"):
        started(make_problem(window=11))
