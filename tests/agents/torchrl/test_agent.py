"""PPO, TD3 and discrete SAC by TorchRL's losses: they learn, go on, and refuse what does not go together."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch import nn

from credit.agents.torchrl.agent import TorchRL
from credit.config import schema
from credit.core.errors import RunError, UserError
from credit.core.problem import FLOAT, Problem
from credit.core.store import Store
from credit.core.windows import Episode, Windows
from credit.networks.modules import Network, Perceptron
from credit.rivals.rules import Delayed
from credit.runs.checkpoint import only_data

from .bandits import bandit, best, go_on, lived, played, seen, weights

QUICK: dict[str, Any] = {"hidden": (16,), "batch": 32, "activation": "relu", "learning_rate": 0.03}
PPO: dict[str, Any] = QUICK | {"loss": "ppo", "epochs": 4, "entropy": 0.0}
TD3: dict[str, Any] = QUICK | {"loss": "td3", "updates_per_step": 0.4, "policy_delay": 2, "noise": 0.5}
TD3 |= {"learning_rate": 0.02}
SAC: dict[str, Any] = QUICK | {"loss": "discrete_sac", "updates_per_step": 0.25, "target_entropy": 0.2}
EACH = [
    pytest.param(PPO, "finite", id="ppo, numbers"),
    pytest.param(PPO, "vector", id="ppo, vectors"),
    pytest.param(TD3, "vector", id="td3"),
    pytest.param(SAC, "finite", id="discrete_sac"),
]
each = pytest.mark.parametrize(("keys", "actions"), EACH)


@each
@pytest.mark.parametrize("states", ["finite", "vector"])
def test_it_finds_the_best_action(keys: dict[str, Any], actions: str, states: str) -> None:
    problem = bandit((0,), states, actions)
    agent, _ = lived(problem, 8, **keys)
    which = torch.tensor([[0, 1]])
    chosen = agent.policies()["behaviour"].act(seen(problem, which), torch.zeros_like(which))
    torch.testing.assert_close(chosen, best(problem, which), atol=0.2, rtol=0)
    told = agent.diagnostics()
    assert all(value.shape == (1,) and value.isfinite().all() for value in told.values()), told
    chances = agent.executed().probabilities(seen(problem, which[0]), 0)
    if actions == "finite":
        assert chances is not None
        torch.testing.assert_close(chances.sum(-1), torch.ones(1, 2, dtype=FLOAT))
        assert (chances.argmax(-1) == best(problem, which)).all()
        assert chances.max() < 1
        sure = agent.policies()["behaviour"].probabilities(seen(problem, which[0]), 0)
        assert sure is not None
        assert sure.tolist() == [[[0, 1], [1, 0]]]
    else:
        assert chances is None


@each
def test_a_replica_alone_does_as_in_a_batch(keys: dict[str, Any], actions: str) -> None:
    together, _ = lived(bandit((5, 6, 7), actions=actions), 2, 16, **keys)
    for replica, seed in enumerate((5, 6, 7)):
        alone, _ = lived(bandit((seed,), actions=actions), 2, 16, **keys)
        for mine, theirs in zip(weights(alone, 0), weights(together, replica), strict=True):
            torch.testing.assert_close(mine, theirs, rtol=0, atol=1e-4)
    assert (
        max(float((a - b).abs().max()) for a, b in zip(weights(together, 0), weights(together, 1), strict=True)) > 0.01
    )


def walks(lengths: list[list[int]]) -> Windows:
    """Episodes of some lengths, of steps that mean little."""

    def one(length: int, seed: int) -> Episode:
        path = torch.randn(length + 1, 1, generator=torch.Generator().manual_seed(seed))
        return Episode(path[:-1], path[:-1].sign() * 0.5, path[1:], True)

    every = [[one(n, k) for k, n in enumerate(own)] for own in lengths]
    return Windows.of_episodes(every, torch.ones(len(lengths), len(lengths[0]), dtype=FLOAT))


@pytest.mark.parametrize(("keys", "updates"), [(PPO, [4, 12]), (TD3, [5, 36])], ids=["ppo", "td3"])
def test_each_replica_learns_from_its_own_steps(keys: dict[str, Any], updates: list[int]) -> None:
    """However many others have: 12 and 90 of them, in the same round."""
    together, alone = (TorchRL(**keys) for _ in range(2))
    for agent, seeds, lengths in ((together, (5, 6), [[10, 2], [70, 20]]), (alone, (5,), [[10, 2]])):
        problem = Problem.vectors(1, 1, 90, seeds)
        store = Store(problem)
        agent.start(problem)
        for _ in range(2):
            agent.act(torch.zeros(len(seeds), 1, 1), torch.zeros(len(seeds), 1, dtype=torch.int64))
            store.append(walks(lengths))
            agent.improve(store, Delayed())
    assert [learner.updates for learner in together._learners] == [2 * count for count in updates]
    for mine, theirs in zip(weights(alone, 0), weights(together, 0), strict=True):
        torch.testing.assert_close(mine, theirs, rtol=0, atol=1e-4)


@each
def test_a_state_goes_on_to_the_bit(keys: dict[str, Any], actions: str) -> None:
    problem = bandit(actions=actions)
    one, store = lived(problem, 2, copies=6, **keys)
    state, held = one.state_dict(), store.state_dict()
    only_data(state, "")
    other, again = TorchRL(**keys), Store(problem)
    other.start(problem)
    assert not torch.equal(weights(other, 0)[-3], weights(one, 0)[-3])
    other.load_state_dict(state)
    again.load_state_dict(held)
    for agent, memory in ((one, store), (other, again)):
        go_on(agent, memory, problem, 2, copies=6)
    assert torch.equal(store.windows.actions, again.windows.actions)
    for replica in range(2):
        assert all(torch.equal(*pair) for pair in zip(weights(one, replica), weights(other, replica), strict=True))
    assert one.diagnostics().keys() == other.diagnostics().keys()
    assert all(torch.equal(value, other.diagnostics()[name]) for name, value in one.diagnostics().items())


def test_ppo_learns_from_the_newest_round_alone() -> None:
    problem = bandit()
    after = []
    for labels in (0.0, 100.0):  # of windows that were there before it acted
        agent, store = TorchRL(**PPO), Store(problem)
        agent.start(problem)
        past = torch.zeros(2, 5, 1, dtype=torch.int64)
        store.append(Windows.of_grid(past, past, past, torch.full((2, 5), labels, dtype=FLOAT)))
        before = weights(agent, 0)
        agent.improve(store, Delayed())  # it did not act in those
        assert all(torch.equal(*pair) for pair in zip(before, weights(agent, 0), strict=True))
        go_on(agent, store, problem, 2)
        after.append(weights(agent, 1))
    assert all(torch.equal(*pair) for pair in zip(*after, strict=True))
    assert not torch.equal(after[0][-3], before[-3])


def test_off_policy_losses_learn_from_what_they_did_not_do() -> None:
    problem = bandit()
    agent, store = TorchRL(**SAC), Store(problem)
    agent.start(problem)
    past = torch.zeros(2, 5, 1, dtype=torch.int64)
    store.append(Windows.of_grid(past, past, past, torch.ones(2, 5, dtype=FLOAT)))
    agent.improve(store, Delayed())
    assert [learner.updates for learner in agent._learners] == [1, 1]


@each
def test_pytorchs_own_random_numbers_neither_matter_nor_change(keys: dict[str, Any], actions: str) -> None:
    found = []
    for seed in (1, 2):
        torch.manual_seed(seed)
        before = torch.get_rng_state()
        agent, _ = lived(bandit((0,), actions=actions), 2, copies=4, **keys)
        assert torch.equal(torch.get_rng_state(), before)
        found.append(weights(agent, 0))
    assert all(torch.equal(*pair) for pair in zip(*found, strict=True))


@pytest.mark.parametrize("delay", [1, 3])
def test_the_actor_and_the_targets_wait_for_the_critics(delay: int) -> None:
    keys = TD3 | {"policy_delay": delay, "updates_per_step": 1.0}
    agent, store = TorchRL(**keys), Store(problem := bandit((0,), actions="vector"))
    agent.start(problem)
    before = agent._learners[0].loss.state_dict()
    before = {name: value.clone() for name, value in before.items()}
    store.append(played(agent, problem, 2))  # two updates
    agent.improve(store, Delayed())
    now = agent._learners[0].loss.state_dict()
    moved = {name for name, value in now.items() if not torch.equal(value, before[name])}
    assert {name.partition(".")[0] for name in moved} == (
        {"qvalue_network_params"}
        if delay == 3
        else {
            "actor_network_params",
            "qvalue_network_params",
            "target_actor_network_params",
            "target_qvalue_network_params",
        }
    )


@pytest.mark.parametrize(
    ("loss", "actions", "said"),
    [
        ("td3", "finite", r"agent.loss='td3'.*vectors \(Box\).*numbers.*agent.loss=ppo, agent.loss=discrete_sac$"),
        ("discrete_sac", "vector", r"agent.loss='discrete_sac'.*numbers \(Discrete\).*agent.loss=ppo, agent.loss=td3$"),
    ],
)
def test_actions_that_a_loss_does_not_take_are_refused_at_the_start(loss: Any, actions: str, said: str) -> None:
    with pytest.raises(UserError, match=said):
        TorchRL(loss).start(bandit(actions=actions))


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (("agent=td3",), ["TorchRL needs actions that are vectors", "goes with it: ", "discrete_sac, dqn"]),
        (("agent=torchrl", "agent.loss=a2c"), ["agent.loss='a2c'", "ppo, td3, discrete_sac"]),
        (("agent=ppo", "agent.clip=1.5"), ["agent.clip=1.5", "< 1"]),
        (("agent=ppo", "agent.activation=swish"), ["agent.activation='swish'", "relu, tanh"]),
        (("agent=ppo", "agent.hidden=[0]"), ["agent.hidden=[0]", "≥ 1"]),
        (("agent=ppo", "+agent.network._target_=torch.nn.Linear"), ["agent.network", "torch.nn.Linear"]),
    ],
)
def test_bad_input(composed: Callable[..., dict[str, Any]], overrides: tuple[str, ...], words: list[str]) -> None:
    with pytest.raises(UserError) as refused:
        composed("experiment=sepsis", "method=delayed", *overrides)
    assert all(word in str(refused.value) for word in words)


def test_a_loss_that_does_not_fit_is_not_advised(composed: Callable[..., dict[str, Any]]) -> None:
    with pytest.raises(UserError) as refused:
        composed("env=gymnasium", "env.id=Pendulum-v1", "method=delayed", "agent=dqn")
    assert "ppo, random, sac" in str(refused.value)
    assert "discrete_sac" not in str(refused.value)


@each
def test_weights_that_are_not_finite_end_the_run_with_the_seed(keys: dict[str, Any], actions: str) -> None:
    problem = bandit((5, 6), actions=actions)
    agent, store = lived(problem, 1, copies=4, **keys)
    with torch.no_grad():
        next(agent._learners[1].loss.parameters()).fill_(torch.nan)
    agent._acted = True
    with pytest.raises(RunError, match=rf"agent.loss={keys['loss']}: a weight of seed 6 is not finite"):
        agent.improve(store, Delayed())


class Wide(Network):
    """A user's own."""

    def make(self, inputs: int, outputs: int, device: torch.device) -> nn.Module:
        return nn.Sequential(nn.Linear(inputs, 9), nn.SiLU(), nn.LayerNorm(9), nn.Linear(9, outputs)).to(device)


@each
def test_networks_of_ones_own(keys: dict[str, Any], actions: str) -> None:
    agent, _ = lived(bandit((0,), actions=actions), 1, copies=4, network=Wide(), **keys)
    kinds = [type(part) for part in agent._learners[0]._network]
    assert kinds == [nn.Linear, nn.SiLU, nn.LayerNorm, nn.Linear]


def test_a_network_is_named_in_yaml(composed: Callable[..., dict[str, Any]]) -> None:
    named = ("agent.network._target_=credit.networks.modules.Perceptron", "agent.network.hidden=[7]")
    config = composed("experiment=sepsis", "method=delayed", "agent=ppo", *(f"+{text}" for text in named))
    network = schema.build(config, "agent").network
    assert isinstance(network, Perceptron)
    assert (network.hidden, network.activation) == ((7,), "tanh")
    with pytest.raises(UserError, match=r"agent\.network\.hiden: unknown key.*did you mean 'hidden'"):
        composed("experiment=sepsis", "method=delayed", "agent=ppo", f"+{named[0]}", "+agent.network.hiden=[7]")


class Moody(Network):
    """A user's own, which draws numbers and looks at batches while it is in training mode."""

    def make(self, inputs: int, outputs: int, device: torch.device) -> nn.Module:
        layers = [nn.Linear(inputs, 9), nn.BatchNorm1d(9), nn.ReLU(), nn.Dropout(0.5), nn.Linear(9, outputs)]
        return nn.Sequential(*layers).to(device)


@each
def test_own_networks_are_in_evaluation_mode(keys: dict[str, Any], actions: str) -> None:
    """Acting, being judged and learning: no dropout is drawn, no batch is looked at, however small."""
    problem, found = bandit((0, 1), actions=actions), []
    for global_seed in (1, 2):
        torch.manual_seed(global_seed)
        agent, _ = lived(problem, 2, copies=1, network=Moody(), **keys)  # batches of one row
        drawn = torch.get_rng_state()
        which = torch.zeros(2, 3, dtype=torch.int64)
        acted = agent.policies()["behaviour"].act(seen(problem, which), which)
        assert torch.equal(torch.get_rng_state(), drawn)
        assert (acted == acted[:, :1]).all()  # the same for the same state
        found.append([*weights(agent, 0), *weights(agent, 1), acted])
        for learner in agent._learners:
            modes = {type(part): part.training for part in learner._network.modules()}
            assert not any(modes.values()), modes
            state = learner.loss.state_dict()
            still = {name: value for name, value in state.items() if name.endswith("running_mean")}
            assert not any(bool(value.any()) for value in still.values()), still
    assert all(torch.equal(*pair) for pair in zip(*found, strict=True))
