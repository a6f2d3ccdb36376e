"""Q-learning against a plain loop over the same steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch

from credit.agents.q_learning import QLearning
from credit.core.policy import TablePolicy
from credit.core.problem import Problem
from credit.core.seams import CreditAssigner
from credit.core.store import Store
from credit.core.windows import Episode, Windows
from credit.rivals.rules import Delayed, Uniform

Make = Callable[..., Problem]
MakeWindows = Callable[..., Windows]


def learned(problem: Problem, learner: QLearning, pieces: list[Windows], rule: CreditAssigner) -> torch.Tensor:
    store = Store(problem)
    learner.start(problem)
    for piece in pieces:
        store.append(piece)
        learner.improve(store, rule)
    return learner._q


def acted(learner: QLearning, states: torch.Tensor) -> torch.Tensor:
    """One action of each replica [R] in states [R]."""
    return learner.act(states.unsqueeze(1), torch.zeros_like(states).unsqueeze(1))[:, 0]


@pytest.mark.parametrize("rule", [Delayed(), Uniform()])
def test_updates_equal_a_plain_loop(make_problem: Make, make_windows: MakeWindows, rule: CreditAssigner) -> None:
    problem = make_problem((0, 1))
    pieces = [make_windows(problem, count, seed=count) for count in (1, 3, 9)]
    found = learned(problem, QLearning(learning_rate=0.3, discount=0.9), pieces, rule)
    for replica in range(2):
        q = [[0.0] * 3 for _ in range(10)]
        for piece in pieces:
            rewards = rule.rewards(piece)[replica]
            for row in range(len(piece)):
                s, a, then = (int(part[replica, row]) for part in (piece.states, piece.actions, piece.next_states))
                q[s][a] += 0.3 * (float(rewards[row]) + 0.9 * max(q[then]) - q[s][a])
        torch.testing.assert_close(found[replica], torch.tensor(q, dtype=torch.float64), atol=1e-12, rtol=1e-12)


def test_two_steps_by_hand(make_problem: Make) -> None:
    # lr 1/2, γ 1/2, label 4 on the second step: Q(0,0) = ½·(0 + ½·0) = 0, Q(1,1) = ½·4 = 2.
    # The same window again: Q(0,0) = ½·(½·2) = .5, Q(1,1) = ½·2 + ½·(4 + ½·.5) = 3.125.
    problem = make_problem((0,), states=2, actions=2, window=2)
    there, back = torch.tensor([[[0, 1]]]), torch.tensor([[[1, 0]]])
    window = Windows.of_grid(there, there, back, torch.tensor([[4.0]]).double())
    found = learned(problem, QLearning(0.5, 0.5), [window, window], Delayed())
    assert found.tolist() == [[[0.5, 0.0], [0.0, 3.125]]]


def test_exploration_falls_from_window_to_window_to_its_floor(make_problem: Make, make_windows: MakeWindows) -> None:
    # In 2,000 replicas the share of actions that are not greedy (action 0, Q = 0) is ε·2/3; its s.e. is at most .011.
    problem = make_problem(range(2000))
    learner = QLearning(epsilon=0.9, epsilon_decay=0.5, epsilon_floor=0.1)
    store = Store(problem)
    learner.start(problem)
    states = torch.zeros(2000, dtype=torch.int64)
    for expected, more in ((0.9, 1), (0.45, 2), (0.1125, 1), (0.1, 1), (0.1, 1)):
        table = learner.executed().probabilities(torch.arange(10), 0)
        assert table is not None
        torch.testing.assert_close(table[:, :, 1:], torch.full((2000, 10, 2), expected / 3).double())
        torch.testing.assert_close(table.sum(-1), torch.ones(2000, 10).double())
        share = float((acted(learner, states) != 0).double().mean())
        assert abs(share - expected * 2 / 3) < 0.045
        silent = make_windows(problem, more)
        store.append(replace(silent, labels=torch.zeros_like(silent.labels)))
        learner.improve(store, Delayed())


def test_without_exploration_it_is_greedy_and_the_first_of_ties(make_problem: Make) -> None:
    problem = make_problem((0, 1))
    learner = QLearning(epsilon=0.0, epsilon_floor=0.0)
    learner.start(problem)
    learner._q[0, 4] = torch.tensor([1.0, 3.0, 3.0])
    assert acted(learner, torch.tensor([4, 4])).tolist() == [1, 0]
    policies = learner.policies()
    assert isinstance(policies["behaviour"], TablePolicy)
    assert policies["behaviour"].actions[0].tolist() == [0, 0, 0, 0, 1, 0, 0, 0, 0, 0]
    assert policies["behaviour"] is policies["greedy"]


def test_exploring_actions_are_uniform(make_problem: Make) -> None:
    problem = make_problem(range(3000))
    learner = QLearning(epsilon=1.0)
    learner.start(problem)
    actions = acted(learner, torch.zeros(3000, dtype=torch.int64))
    shares = actions.bincount(minlength=3) / 3000
    assert (shares - 1 / 3).abs().max() < 5 * (2 / 9 / 3000) ** 0.5


def test_copies_explore_each_for_itself(make_problem: Make) -> None:
    # With ε = ½ and 4 copies, all four act greedily (action 0, or by chance) in (1 − ε·2/3)⁴ = .198 of the replicas.
    problem = make_problem(range(3000))
    learner, alone = QLearning(epsilon=0.5), QLearning(epsilon=0.5)
    learner.start(problem)
    alone.start(problem)
    actions = learner.act(torch.zeros(3000, 4, dtype=torch.int64), torch.zeros(3000, 4, dtype=torch.int64))
    assert actions.shape == (3000, 4)
    share = float((actions == 0).all(1).double().mean())
    assert abs(share - (2 / 3) ** 4) < 0.04
    one_by_one = [acted(alone, torch.zeros(3000, dtype=torch.int64)) for _ in range(4)]
    assert torch.equal(actions, torch.stack(one_by_one, dim=1))  # as the same many steps of one copy


def test_episodes_of_any_length_equal_a_plain_loop() -> None:
    problem = replace(Problem.finite(5, 2, 4, (0, 1), "cpu", True), even=False)
    generator = torch.Generator().manual_seed(3)

    def episode(length: int, terminated: bool) -> Episode:
        states = torch.randint(5, (length + 1,), generator=generator)
        return Episode(states[:-1], torch.randint(2, (length,), generator=generator), states[1:], terminated)

    ends = [[(2, True), (4, False)], [(4, True), (3, False)]]  # of 4 steps at most; the last one was cut short
    episodes = [[episode(*end) for end in own] for own in ends]
    labels = torch.tensor([[1.0, -2.0], [3.0, 0.5]], dtype=torch.float64)
    found = learned(problem, QLearning(0.3, 0.9), [Windows.of_episodes(episodes, labels)] * 2, Delayed())
    for replica, own in enumerate(episodes):
        q = [[0.0] * 2 for _ in range(5)]
        for _ in range(2):
            for part, label in zip(own, labels[replica].tolist(), strict=True):
                for t, (s, a, then) in enumerate(zip(*(column.tolist() for column in part[:3]), strict=True)):
                    last = t == len(part.states) - 1
                    behind = 0.0 if (last and part.terminated) or t == 3 else max(q[then])
                    q[s][a] += 0.3 * (label * last + 0.9 * behind - q[s][a])
        torch.testing.assert_close(found[replica], torch.tensor(q, dtype=torch.float64), atol=1e-12, rtol=1e-12)
