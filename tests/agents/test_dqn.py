"""Deep Q-learning against networks, gradients and Adam written out in NumPy, one replica and one step at a time."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import pytest
import torch

from credit.agents.dqn import DQN, clip_each, targets
from credit.agents.moments import Moments
from credit.core.errors import UserError
from credit.core.policy import TablePolicy, tabulate
from credit.core.problem import FLOAT, Problem
from credit.core.seams import CreditAssigner, FeatureMap
from credit.core.steps import Steps
from credit.core.store import Store
from credit.core.streams import generators
from credit.core.windows import Episode, Windows
from credit.data.replay import Replay
from credit.networks.perceptron import ReplicaLinear
from credit.rivals.rules import Delayed, Uniform

Make = Callable[..., Problem]
MakeWindows = Callable[..., Windows]
STATES, ACTIONS, WINDOW = 6, 3, 4
SMALL: dict[str, Any] = {"hidden": (7, 5), "batch": 9, "learning_rate": 0.01}


def test_a_table_of_all_that_may_be_seen_is_not_made_where_it_is_too_large() -> None:
    problem = Problem.finite(20_000, 2, 20, (0,), torch.device("cpu"), episodic=True)
    with pytest.raises(UserError, match=r"20000 states at 20 steps one-hot .* 8\.0e\+09 numbers.*agent\.timed=false"):
        Moments(problem, None)


class OneHot(FeatureMap):
    """The state alone, one-hot."""

    def start(self, problem: Problem) -> None:
        self._states = problem.states

    def __call__(self, steps: Steps) -> torch.Tensor:
        return torch.nn.functional.one_hot(steps.states, self._states).to(FLOAT)


class Changing(CreditAssigner):
    """A redistribution without a table that gives old steps other rewards after every refit: (s·A + a) times refits."""

    learns = True

    def start(self, problem: Problem) -> None:
        self._actions, self._count = problem.actions, 0

    def observe(self, store: Store) -> None:
        self._count += 1

    def rewards(self, windows: Windows) -> torch.Tensor:
        return windows.pairs(self._actions).to(FLOAT) * self._count


def episodic(problem: Problem) -> Problem:
    return replace(problem, episodic=True)


@pytest.fixture
def problem(make_problem: Make) -> Problem:
    return episodic(make_problem((3, 8, 5), states=STATES, actions=ACTIONS, window=WINDOW))


def greedy(learner: DQN) -> torch.Tensor:
    """The best actions [R, T, S]."""
    policy = learner.policies()["greedy"]
    assert isinstance(policy, TablePolicy)
    return policy.actions


def acted(learner: DQN, states: torch.Tensor, step: int) -> torch.Tensor:
    """One action of each replica [R] in states [R]."""
    return learner.act(states.unsqueeze(1), torch.full((len(states), 1), step))[:, 0]


def learned(problem: Problem, learner: DQN, pieces: list[Windows], rule: CreditAssigner) -> DQN:
    store = Store(problem)
    learner.start(problem)
    rule.start(problem)
    for piece in pieces:
        store.append(piece)
        rule.observe(store)
        learner.improve(store, rule)
    return learner


def layers(learner: DQN, replica: int) -> list[np.ndarray]:
    """Weights and biases of one replica, in order."""
    linear = [layer for layer in learner._online if isinstance(layer, ReplicaLinear)]
    parameters = [parameter for layer in linear for parameter in (layer.weight, layer.bias)]
    return [p.detach()[replica].double().numpy() for p in parameters]


def forward(net: list[np.ndarray], values: np.ndarray) -> list[np.ndarray]:
    """Input and output of every layer."""
    found = [values]
    for weight, bias in zip(net[::2], net[1::2], strict=True):
        values = values @ weight + bias
        found.append(values if weight is net[-2] else np.maximum(values, 0))
        values = found[-1]
    return found


def moment(state: int, step: int) -> np.ndarray:
    return np.concatenate([np.eye(STATES)[state], np.eye(WINDOW)[step]])


class Plain:
    """The same learner for one seed: lists, loops and the chain rule."""

    def __init__(self, learner: DQN, net: list[np.ndarray], seed: int) -> None:
        self.keys, self.net, self.old = learner, net, [p.copy() for p in net]
        self.mean, self.square = [np.zeros_like(p) for p in net], [np.zeros_like(p) for p in net]
        self.memory: list[tuple[int, int, int, int, float, float]] = []
        self.stream = generators((seed,), "replay")[0]
        self.steps = 0

    def remember(self, states: Any, actions: Any, arrivals: Any, rewards: Any) -> None:
        for t in range(WINDOW):
            outcome = sum(self.keys.discount ** (k - t) * rewards[k] for k in range(t, WINDOW))
            self.memory.append((t, states[t], actions[t], arrivals[t], rewards[t], outcome))

    def goal(self, t: int, arrival: int, reward: float, outcome: float) -> float:
        ahead = 0.0
        if t + 1 < WINDOW:
            values = forward(self.old, moment(arrival, t + 1))[-1][0]
            chosen = forward(self.net, moment(arrival, t + 1))[-1][0] if self.keys.double else values
            ahead = values[chosen.argmax()]
        share = self.keys.monte_carlo
        return (1 - share) * (reward + self.keys.discount * ahead) + share * outcome

    def fit(self) -> None:
        drawn = [self.memory[int(u * len(self.memory))] for u in self.stream.random(self.keys.batch)]
        gradient = [np.zeros_like(p) for p in self.net]
        for t, state, action, arrival, reward, outcome in drawn:
            passed = forward(self.net, moment(state, t)[None])
            error = passed[-1][0, action] - self.goal(t, arrival, reward, outcome)
            slope = np.zeros_like(passed[-1])
            slope[0, action] = (2 * error if self.keys.loss == "l2" else np.clip(error, -1, 1)) / len(drawn)
            for layer in reversed(range(len(self.net) // 2)):
                gradient[2 * layer] += passed[layer].T @ slope
                gradient[2 * layer + 1] += slope
                slope = slope @ self.net[2 * layer].T * (passed[layer] > 0)
        self.steps += 1
        for p, g, m, v in zip(self.net, gradient, self.mean, self.square, strict=True):
            m += 0.1 * (g - m)
            v += 0.001 * (g * g - v)
            corrected = m / (1 - 0.9**self.steps), v / (1 - 0.999**self.steps)
            p -= self.keys.learning_rate * corrected[0] / (np.sqrt(corrected[1]) + 1e-8)
        if self.steps % self.keys.target_sync == 0:
            self.old = [p.copy() for p in self.net]


@pytest.mark.parametrize(
    ("spread", "keys"),
    [
        ("delayed", {}),
        ("delayed", {"double": False}),
        ("delayed", {"monte_carlo": 0.5, "loss": "smooth_l1"}),
        ("uniform", {"discount": 0.8, "monte_carlo": 0.25}),
        ("uniform", {"hidden": (), "target_sync": 1}),
    ],
    ids=str,
)
def test_learning_equals_plain_loops(
    problem: Problem, make_windows: MakeWindows, spread: str, keys: dict[str, Any]
) -> None:
    rule: CreditAssigner = {"delayed": Delayed, "uniform": Uniform}[spread]()
    keys = {**SMALL, "updates": 3, "target_sync": 5, **keys}
    learner = DQN(OneHot(), **keys)
    learner.start(problem)
    before = [layers(learner, replica) for replica in range(3)]
    pieces = [make_windows(problem, count, seed=count) for count in (1, 4, 2)]
    learned(problem, learner, pieces, rule)
    for replica, seed in enumerate(problem.seeds):
        plain = Plain(learner, before[replica], seed)
        for piece in pieces:
            columns = (piece.states, piece.actions, piece.next_states, rule.rewards(piece))
            for k in range(piece.labels.shape[1]):
                plain.remember(*(piece.grid(column)[replica, k].tolist() for column in columns))
            for _ in range(3 * piece.labels.shape[1]):
                plain.fit()
        assert plain.steps == 21
        for found, expected in zip(layers(learner, replica), plain.net, strict=True):
            np.testing.assert_allclose(found, expected, atol=2e-5)
        moments = [[forward(plain.net, moment(s, t))[-1][0].argmax() for s in range(STATES)] for t in range(WINDOW)]
        assert greedy(learner)[replica].tolist() == moments


def test_targets_by_hand() -> None:
    # r + γ·ahead = 1 + .5·2 = 2 and 3 + .5·0 = 3; G = 4 and 3: three quarters of the one, a quarter of the other.
    parts = (torch.tensor(part).double() for part in ([1.0, 3.0], [2.0, 0.0], [4.0, 3.0]))
    assert targets(*parts, discount=0.5, monte_carlo=0.25).tolist() == [2.5, 3.0]


@pytest.mark.parametrize(
    "keys",
    [
        {},
        {"hidden": (17, 5), "batch": 13},
        {"hidden": (64, 1), "batch": 16},
        {"hidden": (), "batch": 1},
        pytest.param({"hidden": (7, 5), "batch": 9, "dueling": True}, marks=pytest.mark.thorough),
    ],
    ids=str,
)
def test_a_replica_learns_and_acts_alone_as_in_a_batch(
    make_problem: Make, make_windows: MakeWindows, keys: dict[str, Any]
) -> None:
    problem = episodic(make_problem(range(7), states=STATES, actions=ACTIONS, window=WINDOW))
    windows = make_windows(problem, 12)

    def run(replicas: slice) -> list[torch.Tensor]:
        part = replace(problem, seeds=problem.seeds[replicas])
        columns = (column[replicas] for column in (windows.states, windows.actions, windows.next_states))
        mine = Windows(*columns, labels=windows.labels[replicas], length=WINDOW)
        learner = learned(part, DQN(OneHot(), updates=4, learning_rate=0.01, **keys), [mine, mine], Delayed())
        states = torch.arange(7)[replicas] % STATES
        acts = torch.stack([acted(learner, states, step) for step in range(WINDOW)], dim=1)
        return [*learner._online.parameters(), greedy(learner), acts]

    together = run(slice(None))
    for replicas in (slice(0, 1), slice(6, 7), slice(2, 4), slice(1, 6)):
        for alone, batch in zip(run(replicas), together, strict=True):  # a hundred updates
            torch.testing.assert_close(alone, batch[replicas], rtol=0, atol=1e-4)
    assert (together[0][0] - together[0][1]).abs().max() > 0.01


def test_random_numbers_come_from_streams_alone(problem: Problem, make_windows: MakeWindows) -> None:
    state = torch.get_rng_state()
    learner = learned(problem, DQN(OneHot(), **SMALL), [make_windows(problem, 2)], Delayed())
    acted(learner, torch.zeros(3, dtype=torch.int64), 0)
    assert torch.equal(torch.get_rng_state(), state)


def test_initial_weights_are_uniform_and_differ_from_layer_to_layer(make_problem: Make) -> None:
    learner = DQN(OneHot(), hidden=(64, 64))
    learner.start(make_problem((1, 2), states=20, actions=8, window=5))
    for replica in range(2):
        net = layers(learner, replica)
        scaled = [weight * len(weight) ** 0.5 for weight in net[::2]]
        for weight in scaled:
            assert 0.97 < np.abs(weight).max() <= 1
            assert abs(weight.std() - 3**-0.5) < 5 * 0.27 / weight.size**0.5
        assert np.isin(scaled[0].round(5), scaled[1].round(5)).mean() < 0.1  # by chance alone 2%
        assert np.abs(net[1]).max() <= 25**-0.5
        assert np.abs(net[3]).max() <= 64**-0.5


@pytest.mark.parametrize("capacity", [20, 5])
def test_recovered_rewards_are_replaced_wherever_they_are_stored(
    problem: Problem, make_windows: MakeWindows, capacity: int
) -> None:
    pieces = [make_windows(problem, count, seed=count) for count in (3, 4, 2)]
    learner = learned(problem, DQN(OneHot(), capacity=capacity, **SMALL), pieces, Changing())
    pairs = torch.cat([piece.pairs(ACTIONS) for piece in pieces], dim=1)
    belief = 3.0 * pairs  # three refits
    assert torch.equal(learner._replay.rewards, belief.to(FLOAT))
    kept = min(9, capacity) * WINDOW
    assert [learner._replay.span(r) for r in range(3)] == [(36 - kept, kept)] * 3
    for batch in learner._replay.sample(50, 3):
        assert torch.equal(batch.returns, 3.0 * (batch.observation * ACTIONS + batch.action).to(FLOAT))
        for r in range(3):
            assert set(batch.returns[r].tolist()) <= set(belief[r, 36 - kept :].tolist())


def test_rewards_that_do_not_change_are_asked_for_once(problem: Problem, make_windows: MakeWindows) -> None:
    class Counting(Delayed):
        asked: ClassVar[list[int]] = []

        def rewards(self, windows: Windows) -> torch.Tensor:
            self.asked.append(windows.labels.shape[1])
            return super().rewards(windows)

    learner = learned(
        problem, DQN(OneHot(), **SMALL), [make_windows(problem, count) for count in (3, 4, 2)], Counting()
    )
    assert Counting.asked == [3, 4, 2]
    assert learner._replay.rewards.shape == (3, 36)


def test_it_learns_a_chain_to_optimality(make_problem: Make) -> None:
    # Action 1 climbs, action 0 falls to the bottom. The top is worth 1 and is reached by climbing always; the bottom is
    # worth .3. Whoever cannot reach the top any more does best to end at the bottom.
    problem = episodic(make_problem(range(4), states=4, actions=2, window=3))
    actions = torch.tensor([[k >> t & 1 for t in range(3)] for k in range(8)]).repeat(4, 5, 1)
    states, now = [], torch.zeros(4, 40, dtype=torch.int64)
    for t in range(3):
        states.append(now)
        now = torch.where(actions[..., t] == 1, now + 1, 0)
    path = torch.stack(states, dim=-1)
    labels = (now == 3).double() + 0.3 * (now == 0).double()
    windows = Windows.of_grid(path, actions, torch.cat([path[..., 1:], now.unsqueeze(-1)], dim=-1), labels)
    keys: dict[str, Any] = {"hidden": (32,), "batch": 32, "learning_rate": 0.005, "updates": 20, "target_sync": 20}
    learner = learned(problem, DQN(OneHot(), **keys), [windows], Delayed())
    policy = greedy(learner)
    for replica in range(4):
        assert [int(policy[replica, t, t]) for t in range(3)] == [1, 1, 1]
        assert policy[replica, 2, :2].tolist() == [0, 0]
    values = learner._online(learner._view._inputs.expand(4, -1, -1)).detach().view(4, 3, 4, 2)
    torch.testing.assert_close(values[:, 0, 0], torch.tensor([[0.3, 1.0]]).expand(4, 2), atol=0.1, rtol=0)


def test_exploration_falls_linearly_and_is_what_is_executed(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = episodic(make_problem(range(500), states=4, actions=3, window=2))
    learner = DQN(OneHot(), epsilon=0.8, epsilon_floor=0.2, epsilon_windows=4, hidden=(2,), batch=2)
    store = Store(problem)
    learner.start(problem)
    states = torch.arange(500) % 4
    for seen, expected in ((0, 0.8), (1, 0.65), (2, 0.35), (1, 0.2), (3, 0.2)):
        if seen:
            store.append(make_windows(problem, seen))
            learner.improve(store, Delayed())
        best, table = greedy(learner), tabulate(learner.executed(), problem)
        assert table is not None
        assert table.shape == (500, 2, 4, 3)
        torch.testing.assert_close(table.sum(-1), torch.ones(500, 2, 4, dtype=FLOAT))
        chosen = table.gather(-1, best.unsqueeze(-1)).unique()
        assert chosen.tolist() == pytest.approx([1 - expected + expected / 3])
        assert table.unique().tolist() == pytest.approx([expected / 3, 1 - expected + expected / 3])
        best = best[torch.arange(500), 1, states]
        share = float(torch.stack([acted(learner, states, 1) == best for _ in range(4)]).double().mean())
        assert abs(share - (1 - expected * 2 / 3)) < 5 * 0.5 / 2000**0.5
    assert learner.policies()["behaviour"] is learner.policies()["greedy"]


def vectors(seeds: tuple[int, ...], actions: int = 2, window: int = 5) -> Problem:
    """Two numbers in a state, finite actions."""
    there = Problem.vectors(2, 1, window, seeds)
    return replace(there, action_space=Problem.finite(1, actions, window, seeds).action_space)


def walks(problem: Problem, count: int, seed: int = 0) -> Windows:
    """Episodes of at most T steps on a line, action 1 up, 0 down. The label is where one ended; the top ends it."""
    generator = torch.Generator().manual_seed(seed)
    episodes, labels = [], []
    for _ in problem.seeds:
        own, ends = [], []
        for _ in range(count):
            place, path, moves = 0.0, [0.0], []
            while len(moves) < problem.window and place < 0.5:
                moves.append(int(torch.randint(2, (1,), generator=generator)))
                place += 0.2 * (2 * moves[-1] - 1)
                path.append(place)
            states = torch.tensor(path).unsqueeze(1) * torch.tensor([[1.0, -1.0]])
            own.append(Episode(states[:-1], torch.tensor(moves), states[1:], place >= 0.5))
            ends.append(place)
        episodes.append(own)
        labels.append(ends)
    return Windows.of_episodes(episodes, torch.tensor(labels, dtype=FLOAT))


def test_it_learns_from_vectors() -> None:
    """States are vectors, episodes end early or are cut short: stepping up is best everywhere."""
    problem = vectors((0, 1))
    learner = DQN(learning_rate=0.005, hidden=(32,), batch=64, updates=5, target_sync=20)
    learned(problem, learner, [walks(problem, 60, seed) for seed in range(3)], Delayed())
    policy = learner.policies()["greedy"]
    for step, places in ((1, [-0.2]), (2, [-0.4, 0.0]), (3, [-0.2, 0.2]), (4, [-0.4, 0.0, 0.4])):  # no ties
        states = torch.tensor(places).unsqueeze(1) * torch.tensor([[1.0, -1.0]])
        chosen = policy.act(states.expand(2, -1, -1), torch.full((2, len(places)), step))
        assert (chosen == 1).all(), (step, chosen)
        table = policy.probabilities(states, step)
        assert table is not None
        assert torch.equal(table, torch.nn.functional.one_hot(chosen, 2).to(FLOAT))
    explored = learner.executed().probabilities(states, 0)
    assert explored is not None
    torch.testing.assert_close(explored.sum(-1), torch.ones(2, len(states), dtype=FLOAT))
    assert explored.max() < 1


def test_one_step_on_vectors_by_hand() -> None:
    """The target where an episode ended is r, where it was cut short r + γ·Q⁻: one update against autograd."""
    problem = vectors((0,), window=2)
    ends = [
        Episode(torch.tensor([[0.3, -0.1]]), torch.tensor([k]), torch.tensor([[0.5, 0.2]]), bool(k)) for k in (0, 1)
    ]
    windows = Windows.of_episodes([ends], torch.tensor([[2.0, 3.0]], dtype=FLOAT))
    learner = DQN(hidden=(3,), batch=40, updates=1, discount=0.5, learning_rate=0.1, target_sync=1000)
    learner.start(problem)
    net = deepcopy(learner._online)
    store = Store(problem)
    store.append(windows)
    draws = torch.from_numpy(np.stack([generators((0,), "replay")[0].random((2, 40))])[0] * 2).long()
    ahead = net(torch.tensor([[[0.5, 0.2, 0.5]]])).detach().max()
    goals = torch.stack([2.0 + 0.5 * ahead, torch.tensor(3.0)])
    adam = torch.optim.Adam(net.parameters(), lr=0.1)
    first = net(torch.tensor([[[0.3, -0.1, 0.0]]]))[0, 0]
    adam.zero_grad()
    (first[draws[0]] - goals[draws[0]]).square().mean().backward()
    adam.step()
    learner._fit(_relabelled(learner, store).sample(40, 2)[0])
    for ours, theirs in zip(learner._online.parameters(), net.parameters(), strict=True):
        torch.testing.assert_close(ours, theirs)
        torch.testing.assert_close(ours.grad, theirs.grad)  # Adam's first step hardly depends on its size


def _relabelled(learner: DQN, store: Store) -> Replay:
    learner._replay.update(store, Delayed())
    return learner._replay


def test_a_state_goes_on_to_the_bit(problem: Problem, make_windows: MakeWindows) -> None:
    for task, pieces, keys in (
        (problem, [make_windows(problem, 3, seed) for seed in range(2)], {"features": OneHot()}),
        (vectors((0, 1)), [walks(vectors((0, 1)), 4, seed) for seed in range(2)], {}),
    ):
        one, store = DQN(**keys, **SMALL), Store(task)
        one.start(task)
        store.append(pieces[0])
        one.improve(store, Delayed())
        other, again = DQN(**keys, **SMALL), Store(task)
        other.start(task)
        other.load_state_dict(one.state_dict())
        again.load_state_dict(store.state_dict())
        sight = torch.arange(STATES).expand(3, -1) if task.finite_states else torch.randn(2, STATES, 2)
        for step in range(task.window):  # before it learns again, too
            acts = [each.policies()["greedy"].act(sight, torch.full(sight.shape[:2], step)) for each in (one, other)]
            assert torch.equal(*acts)
        for each, memory in ((one, store), (other, again)):
            memory.append(pieces[1])
            each.improve(memory, Delayed())
        assert all(torch.equal(a, b) for a, b in zip(one._online.parameters(), other._online.parameters(), strict=True))
        now = torch.zeros(len(task.seeds), 1, dtype=torch.int64)
        states = now if task.finite_states else torch.zeros(len(task.seeds), 1, 2)
        for _ in range(5):
            assert torch.equal(one.act(states, now), other.act(states, now))


def test_without_features_a_number_is_seen_one_hot(problem: Problem, make_windows: MakeWindows) -> None:
    pieces = [make_windows(problem, 4)]
    plain, given = (learned(problem, DQN(features, **SMALL), pieces, Delayed()) for features in (None, OneHot()))
    assert torch.equal(greedy(plain), greedy(given))
    assert all(torch.equal(*pair) for pair in zip(plain._online.parameters(), given._online.parameters(), strict=True))


def test_copies_explore_each_for_itself(problem: Problem) -> None:
    learner = DQN(OneHot(), epsilon=1.0, **SMALL)
    learner.start(problem)
    actions = learner.act(torch.zeros(3, 400, dtype=torch.int64), torch.zeros(3, 400, dtype=torch.int64))
    shares = torch.stack([row.bincount(minlength=3) for row in actions]) / 400
    assert (shares - 1 / 3).abs().max() < 5 * (2 / 9 / 400) ** 0.5


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("agent.learning_rate=0", ["agent.learning_rate=0", "> 0"]),
        ("agent.hidden=[64,0]", ["agent.hidden=[64, 0]", "list of int ≥ 1"]),
        ("agent.loss=huber", ["agent.loss='huber'", "l2, smooth_l1"]),
        ("agent.discount=1.1", ["agent.discount=1.1", "≤ 1"]),
        ("agent.monte_carlo=-.5", ["agent.monte_carlo=-0.5", "≥ 0"]),
        ("agent.batch=0", ["agent.batch=0", "≥ 1"]),
        ("agent.epsilon_windows=0", ["agent.epsilon_windows=0", "≥ 1"]),
        ("agent.epsilon=.01", ["agent.epsilon_floor=0.05", "agent.epsilon=0.01"]),
        ("experiment=advertiser", ["DQN needs a task that is episodic", "continuing"]),
        ("experiment=advertiser agent.timed=false agent.monte_carlo=.5", ["agent.monte_carlo=0.5", "none ends"]),
    ],
)
def test_bad_input(composed: Callable[..., dict[str, Any]], override: str, words: list[str]) -> None:
    with pytest.raises(UserError) as refused:
        composed("experiment=sepsis", "method=delayed", "agent=dqn", *override.split())
    assert all(word in str(refused.value) for word in words)
    assert "\n" not in str(refused.value)


def test_the_gradient_of_each_replica_is_clipped_by_itself() -> None:
    generator = torch.Generator().manual_seed(0)
    weights = [torch.nn.Parameter(torch.zeros(3, *shape)) for shape in ((2, 4), (1, 4))]
    for weight in weights:
        weight.grad = torch.randn(weight.shape, generator=generator) * torch.tensor([0.01, 1.0, 100.0]).view(3, 1, 1)
    expected = []
    for replica in range(3):
        own = [torch.nn.Parameter(torch.zeros(weight.shape[1:])) for weight in weights]
        for one, weight in zip(own, weights, strict=True):
            one.grad = weight.grad[replica].clone()  # type: ignore[index]
        torch.nn.utils.clip_grad_norm_(own, 1.0)
        expected.append([one.grad for one in own])
    clip_each(weights, 1.0)
    for replica in range(3):
        torch.testing.assert_close([weight.grad[replica] for weight in weights], expected[replica])  # type: ignore[index]


@pytest.mark.parametrize("timed", [True, False])
def test_a_time_limit_is_no_end(make_problem: Make, timed: bool) -> None:
    # One state for ever, r = 1, γ = ½: without a clock it is worth 1/(1 − ½), with one 1 in the last step of four.
    problem = episodic(make_problem((0,), states=1, actions=1, window=4))
    nothing = torch.zeros(4, dtype=torch.int64)
    windows = Windows.of_episodes([[Episode(nothing, nothing, nothing)]], torch.full((1, 1), 4.0).double())
    learner = DQN(timed=timed, discount=0.5, updates=40, target_sync=10, hidden=(8,), learning_rate=0.02)
    learned(problem, learner, [windows] * 8, Uniform())
    last = learner._online(learner._view(torch.zeros(1, 1, dtype=torch.int64), torch.full((1, 1), 3)))
    assert float(last.detach()) == pytest.approx(1.0 if timed else 2.0, abs=0.1)
    assert learner.policies()["greedy"].probabilities(torch.zeros(1, dtype=torch.int64), 3) is not None
