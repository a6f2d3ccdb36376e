"""Regret of executed policies in episodes, by hand: action a leads to state a, and state 1 pays 1."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from credit.agents.random import Random
from credit.core.belief import Belief
from credit.core.cells import Axis, Cells
from credit.core.errors import UserError
from credit.core.policy import Policy, TablePolicy
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Agent, CreditAssigner, Feedback
from credit.core.store import Store
from credit.core.windows import Windows
from credit.envs.exact.episodic import EpisodicEnvironment, SuccessorMDP
from credit.envs.feedback import BlockSum, Terminal
from credit.judges.exact import Episodic

ADDITIVE, TERMINAL = BlockSum(2, 0.0), Terminal(2)
# π_t(s) of two steps in two states, the same in both: values (sum, last) are (0, 0), (1, 0), (1, 1) and (2, 1).
NEVER, EARLY, LATE, ALWAYS = ([[a, a], [b, b]] for a, b in ((0, 0), (1, 0), (0, 1), (1, 1)))


def tensor(values: object) -> torch.Tensor:
    return torch.tensor(values, dtype=FLOAT)


class Levers(EpisodicEnvironment):
    """Two states, two actions, an episode starts in state 0."""

    mdp = SuccessorMDP(torch.tensor([[0], [1], [0], [1]]), torch.ones(4, 1).double(), tensor([0, 1]), tensor([1, 0]))


def judge_of(problem: Problem, feedback: Feedback) -> Episodic:
    return Episodic(problem, Levers().truth(feedback.objective, problem.window))


class Puppet(Agent):
    """Executes the policies that it is told."""

    def start(self, problem: Problem) -> None: ...

    def act(self, states: torch.Tensor, step: torch.Tensor) -> torch.Tensor:
        raise AssertionError("a judge that knows the truth does not act")

    def improve(self, store: Store, assigner: CreditAssigner) -> None: ...

    def policies(self) -> dict[str, Policy]:
        return {"behaviour": self.policy}

    def told(self, *policies: list[list[int]]) -> Puppet:
        self.policy: Policy = TablePolicy(torch.tensor(policies), 2)
        return self


def greedy(*policies: list[list[int]]) -> dict[str, Policy]:
    return {"greedy": TablePolicy(torch.tensor(policies), 2)}


@pytest.fixture
def problem(make_problem: Callable[..., Problem]) -> Problem:
    return make_problem((0, 1), states=2, actions=2, window=2)


def update(judge: Episodic, agent: Agent, labels: list[list[float]], complete: bool = True) -> None:
    steps = torch.zeros(2, len(labels[0]), 2, dtype=torch.int64)
    windows = Windows.of_grid(steps, steps, steps, tensor(labels))
    judge.update(windows, torch.zeros(2, len(windows)), agent, complete)


def test_regret_by_hand_for_the_sum_of_rewards(problem: Problem) -> None:
    judge, puppet = judge_of(problem, ADDITIVE), Puppet()
    # V* = 2, random 1. Gaps 2 and 1 for two episodes: cumulative (2, 4) and (1, 2).
    update(judge, puppet.told(NEVER, EARLY), [[7.0, 9.0], [1.0, 2.0]])
    values = judge.measure(puppet.policies(), None)
    assert values["regret/cumulative"].tolist() == [4, 2]
    assert values["regret/auc"].tolist() == [6, 3]
    assert values["regret/share"].tolist() == [2, 1]  # of 2 episodes with a gap of 1
    assert values["return/policy"].tolist() == [0, 1]
    assert values["return/label"].tolist() == [8, 1.5]
    # Gaps 0 and 2 for three episodes: cumulative (4, 4, 4) and (4, 6, 8).
    update(judge, puppet.told(ALWAYS, NEVER), [[1.0, 2.0, 6.0], [0.0, 0.0, 3.0]])
    values = judge.measure(puppet.policies() | greedy(LATE, ALWAYS), None)
    assert values["regret/cumulative"].tolist() == [4, 8]
    assert values["regret/auc"].tolist() == [18, 21]
    assert values["regret/share"].tolist() == pytest.approx([4 / 5, 8 / 5])
    assert values["return/policy"].tolist() == [2, 0]
    assert values["return/greedy"].tolist() == [1, 2]
    assert values["return/label"].tolist() == [3, 1]  # since the last call


def test_regret_by_hand_for_the_last_reward(problem: Problem) -> None:
    judge, puppet = judge_of(problem, TERMINAL), Puppet()
    # V* = 1, random .5. Gaps 1 and 0, then 0 and 1.
    update(judge, puppet.told(EARLY, LATE), [[0.0, 0.0], [1.0, 1.0]])
    update(judge, puppet.told(ALWAYS, NEVER), [[1.0, 1.0, 1.0], [0.0, 0.0, 0.0]])
    values = judge.measure(puppet.policies() | greedy(EARLY, LATE), None)
    assert values["regret/cumulative"].tolist() == [2, 3]
    assert values["regret/auc"].tolist() == [1 + 2 + 2 + 2 + 2, 1 + 2 + 3]
    assert values["regret/share"].tolist() == pytest.approx([2 / 2.5, 3 / 2.5])
    assert values["return/policy"].tolist() == [1, 0]
    assert values["return/greedy"].tolist() == [0, 1]
    assert values["return/label"].tolist() == pytest.approx([3 / 5, 2 / 5])


@pytest.mark.parametrize("feedback", [ADDITIVE, TERMINAL])
def test_uniform_actions_have_a_share_of_one(problem: Problem, feedback: Feedback) -> None:
    judge, random = judge_of(problem, feedback), Random()
    random.start(problem)
    update(judge, random, [[0.0] * 7] * 2)
    values = judge.measure(random.policies(), None)
    assert values["regret/share"].tolist() == pytest.approx([1, 1])
    assert "return/greedy" not in values


def test_an_episode_cut_short_has_no_regret(problem: Problem) -> None:
    judge, puppet = judge_of(problem, ADDITIVE), Puppet()
    update(judge, puppet.told(NEVER, EARLY), [[3.0, 3.0], [4.0, 4.0]])
    before = judge.measure({}, None)
    update(judge, puppet.told(ALWAYS, NEVER), [[9.0], [9.0]], complete=False)
    after = judge.measure({}, None)
    for name in before.keys() - {"return/label"}:
        assert torch.equal(before[name], after[name]), name


def test_episodes_at_once_or_one_by_one_are_the_same(problem: Problem) -> None:
    both = []
    for size in (12, 1):
        judge, puppet = judge_of(problem, TERMINAL), Puppet().told(EARLY, LATE)
        for start in range(0, 12, size):
            update(judge, puppet, [[float(start + k) for k in range(size)]] * 2)
        both.append(judge.measure({}, None))
    for name in both[0]:
        torch.testing.assert_close(both[0][name], both[1][name])


def test_before_the_first_episode_nothing_is_lost(problem: Problem) -> None:
    values = judge_of(problem, ADDITIVE).measure({}, None)
    assert values.pop("return/policy").isnan().all()  # none was executed
    assert all(value.tolist() == [0, 0] for value in values.values())


def test_the_reward_is_judged_by_its_expectation(problem: Problem) -> None:
    # r(s, a) = r(s' = a) = 0, 1, 0, 1; replica 0 misses one of four by 2, replica 1 knows it.
    judge = judge_of(problem, TERMINAL)
    assert judge.truth(problem.cells).tolist() == [0, 1, 0, 1]
    mixed = tensor([[0, 3, 0, 1], [0, 1, 0, 1]])
    weights = torch.ones(2, 1, 4, dtype=FLOAT)
    best = torch.zeros(2, 4, dtype=torch.int64)
    recovery = Belief(("ridge",), mixed, (), mixed, mixed, weights, best, mixed, {}, mixed, mixed, problem.cells)
    values = judge.measure({}, recovery)
    assert values["reward/mse"].tolist() == [1, 0]
    assert values["weight/ridge"].tolist() == values["best/ridge"].tolist() == [1, 1]


@pytest.mark.parametrize(
    ("axes", "sums", "ends"),
    [
        (("state", "action"), [0, 1, 0, 1], [0, 1, 0, 1]),
        (("next_state",), [0, 1], [0, 1]),
        # by step, a label that shows the last reward alone has no reward before it
        (("step", "next_state"), [0, 1, 0, 1], [0, 0, 0, 1]),
        (("step", "state", "action"), [0, 1, 0, 1] * 2, [0, 0, 0, 0, 0, 1, 0, 1]),
    ],
)
def test_the_truth_over_other_cells_by_hand(
    problem: Problem, axes: tuple[Axis, ...], sums: list[float], ends: list[float]
) -> None:
    cells = Cells.over(axes, 2, 2, 2)
    for feedback, expected in ((ADDITIVE, sums), (TERMINAL, ends)):
        judge = judge_of(problem, feedback)
        assert judge.truth(cells).tolist() == expected
        mixed = tensor(expected).repeat(2, 1)
        mixed[1, -1] += 3  # of the cells, one is wrong by 3
        ones, best = torch.ones(2, 1, len(expected), dtype=FLOAT), torch.zeros(2, len(expected), dtype=torch.int64)
        recovery = Belief(("ridge",), mixed, (), mixed, mixed, ones, best, mixed, {}, mixed, mixed, cells)
        assert judge.measure({}, recovery)["reward/mse"].tolist() == pytest.approx([0, 9 / len(expected)])


def test_what_a_table_cannot_say_is_not_judged(problem: Problem) -> None:
    judge, cells = judge_of(problem, ADDITIVE), Cells.over(("state",), 2, 2, 2)
    assert judge.truth(cells).isnan().all()
    mixed = tensor([[0, 1], [1, 0]])
    ones, best = torch.ones(2, 1, 2, dtype=FLOAT), torch.zeros(2, 2, dtype=torch.int64)
    values = judge.measure({}, Belief(("r",), mixed, (), mixed, mixed, ones, best, mixed, {}, mixed, mixed, cells))
    assert values["reward/mse"].isnan().all()
    assert values["reward/rank_correlation"].isnan().all()


class Mixed(Policy):
    """Draws: the second action with probability p, whatever the state, by step."""

    def __init__(self, *chances: float) -> None:
        self.chances = chances

    def act(self, states: torch.Tensor, step: torch.Tensor) -> torch.Tensor:
        raise AssertionError("a judge that knows the truth does not act")

    def probabilities(self, states: torch.Tensor, step: int) -> torch.Tensor | None:
        if not self.chances:
            return None
        p = self.chances[step]
        return tensor([1 - p, p]).expand(2, len(states), 2)


def test_policies_that_draw_are_worth_their_expectation(problem: Problem) -> None:
    for feedback, worth in ((ADDITIVE, 0.3 + 0.6), (TERMINAL, 0.6)):
        judge, agent = judge_of(problem, feedback), Puppet()
        agent.policy = Mixed(0.3, 0.6)
        update(judge, agent, [[0.0], [0.0]])
        assert judge.measure({}, None)["return/policy"].tolist() == pytest.approx([worth] * 2)


def test_a_policy_of_states_alone_is_followed_in_every_step(problem: Problem) -> None:
    judge = judge_of(problem, ADDITIVE)
    stationary = TablePolicy(torch.tensor([[1, 1], [1, 0]]), 2)  # 0 → 1 → 1, and 0 → 1 → 0
    assert judge.measure({"greedy": stationary}, None)["return/greedy"].tolist() == [2, 1]


def test_a_policy_that_cannot_say_what_it_does_is_refused(problem: Problem) -> None:
    agent = Puppet()
    agent.policy = Mixed()
    with pytest.raises(UserError, match="Mixed does not say the probabilities of its actions"):
        update(judge_of(problem, ADDITIVE), agent, [[0.0], [0.0]])
