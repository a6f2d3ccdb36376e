"""Dueling networks against the equation written out, one replica and one state at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import torch

from credit.agents.dqn import DQN
from credit.core.problem import Problem
from credit.core.store import Store
from credit.core.windows import Windows
from credit.networks.perceptron import ReplicaDueling, ReplicaLinear, ReplicaMLP, dueling
from credit.rivals.rules import Uniform

PROBLEM = Problem.finite(5, 3, window=4, seeds=(3, 8), episodic=True)


def through(network: ReplicaMLP, replica: int, values: np.ndarray) -> np.ndarray:
    """A perceptron, layer by layer."""
    layers = [layer for layer in network if isinstance(layer, ReplicaLinear)]
    for number, layer in enumerate(layers):
        weight, bias = layer.weight[replica].detach().numpy(), layer.bias[replica, 0].detach().numpy()
        values = values @ weight + bias
        if number + 1 < len(layers):
            values = np.maximum(values, 0)
    return values


def test_by_hand() -> None:
    # V = 2; A = 1, 3, 5 with mean 3: Q = 0, 2, 4
    assert dueling(torch.tensor([[2.0]]), torch.tensor([[1.0, 3.0, 5.0]])).tolist() == [[0.0, 2.0, 4.0]]


@pytest.mark.parametrize("hidden", [(), (6,), (7, 6), (8, 7, 6)], ids=str)
def test_values_are_those_of_the_equation(hidden: Sequence[int]) -> None:
    network = ReplicaDueling(PROBLEM, 4, 3, hidden, "values")
    inputs = torch.randn(10, 4, generator=torch.Generator().manual_seed(0))
    found = network(inputs.expand(2, -1, -1)).detach()
    for replica in range(2):
        for row, q in zip(inputs.numpy(), found[replica].numpy(), strict=True):
            seen = np.maximum(through(network.trunk, replica, row), 0) if len(hidden) > 1 else row
            value, advantage = through(network.value, replica, seen), through(network.advantage, replica, seen)
            np.testing.assert_allclose(q, value + advantage - advantage.mean(), atol=1e-6)
    assert torch.equal(network.best(inputs), found.argmax(-1))


def test_weights_are_drawn_for_each_replica_by_its_seed() -> None:
    both = ReplicaDueling(PROBLEM, 4, 3, (6, 6), "values")
    alone = ReplicaDueling(replace(PROBLEM, seeds=(8,)), 4, 3, (6, 6), "values")
    for one, other in zip(both.parameters(), alone.parameters(), strict=True):
        assert torch.equal(one[1:], other)
        assert not torch.equal(one[0], one[1])


@pytest.mark.thorough
def test_dqn_finds_the_best_action_with_it() -> None:
    """Action 2 is worth 1 in every state, the others nothing."""
    agent = DQN(dueling=True, hidden=(16, 16), learning_rate=0.01, updates=40, target_sync=10, discount=0.5)
    agent.start(PROBLEM)
    states = torch.arange(20).remainder(5).view(1, 1, 20).expand(2, -1, -1)
    actions = torch.arange(20).remainder(3).view(1, 1, 20).expand(2, -1, -1)
    grid = [part.reshape(2, 5, 4) for part in (states, actions, states)]
    windows = Windows.of_grid(*grid, labels=torch.zeros(2, 5, dtype=torch.float64))
    store = Store(PROBLEM)
    store.append(windows)

    class Known(Uniform):
        def rewards(self, windows: Windows) -> torch.Tensor:
            return (windows.actions == 2).double()

    agent.improve(store, Known())
    for step in range(4):
        found = agent.policies()["greedy"].act(torch.arange(5).expand(2, -1), torch.full((2, 5), step))
        assert (found == 2).float().mean() > 0.75
