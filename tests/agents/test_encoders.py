"""Running means and deviations against those of all rows at once, and in every agent that sees through them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from credit.agents.dqn import DQN
from credit.agents.encoders import Normalize
from credit.agents.moments import Vectors
from credit.agents.sac.agent import SAC
from credit.agents.torchrl.agent import TorchRL
from credit.config import registry, schema
from credit.core.capabilities import require
from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.store import Store
from credit.core.windows import Windows
from credit.recovery.features.flat import Flat
from credit.rivals.rules import Uniform
from credit.testing.runs import goes_on

PENDULUM = ("env=gymnasium", "env.id=Pendulum-v1", "encoder=normalize", "tracking=none", "trainer.random_steps=0")
CARTPOLE = ("env=gymnasium", "env.id=CartPole-v1", "encoder=normalize", "tracking=none", "trainer.random_steps=0")
SHORT = {"steps": 90, "steps_per_round": 30, "random_steps": 0, "log_every": 1}
AGENTS = {
    "dqn": (*CARTPOLE, "method=delayed", "agent.batch=8"),
    "sac": (*PENDULUM, "method=delayed", "agent.batch=8", "agent.width=8"),
    "ppo": (*CARTPOLE, "method=reference", "agent=ppo", "agent.epochs=1", "reference.width=8"),
    "td3": (*PENDULUM, "method=delayed", "agent=td3", "agent.hidden=[8]", "agent.batch=8"),
    "discrete_sac": (*CARTPOLE, "method=delayed", "agent=discrete_sac", "agent.hidden=[8]", "agent.batch=8"),
}


def windows(states: Any, count: list[int] | None = None) -> Windows:
    """One window of all rows [R, n, O]."""
    seen = torch.as_tensor(states, dtype=torch.float32)
    replicas, rows = seen.shape[:2]
    labels = torch.zeros(replicas, 1, dtype=torch.float64)
    last = torch.full((replicas, 1), rows - 1) if count is None else torch.tensor(count).unsqueeze(1) - 1
    return Windows(
        states=seen,
        actions=torch.zeros(replicas, rows, dtype=torch.int64),
        next_states=seen + 1,
        step=torch.arange(rows).expand(replicas, -1),
        labels=labels,
        last=last,
        ended=torch.zeros(replicas, rows, dtype=torch.bool),
        terminated=torch.zeros(replicas, rows, dtype=torch.bool),
        count=None if count is None else torch.tensor(count),
    )


def started(observations: int = 2, seeds: tuple[int, ...] = (0,), **keys: Any) -> Normalize:
    encoder = Normalize(**keys)
    encoder.start(Problem.vectors(observations, 1, window=9, seeds=seeds))
    return encoder


def test_by_hand() -> None:
    encoder = started()
    first = torch.tensor([[[0.0, 5.0], [4.0, 5.0]]])
    assert torch.equal(encoder(first), first)  # nothing was seen yet
    encoder.observe(windows(first))
    encoder.observe(windows([[[5.0, 5.0]]]))
    # 0, 4, 5: mean 3, deviation √(14/3); a constant is moved and not scaled
    expected = (torch.tensor([[[-3.0, 0.0], [1.0, 0.0]]])) / torch.tensor([(14 / 3) ** 0.5, 1.0])
    torch.testing.assert_close(encoder(first), expected)
    torch.testing.assert_close(encoder(torch.tensor([[[1e9, 5.5]]])), torch.tensor([[[10.0, 0.5]]]))
    torch.testing.assert_close(started(clip=2.0)(torch.tensor([[[3.0, -3.0]]])), torch.tensor([[[2.0, -2.0]]]))


def test_it_is_that_of_all_rows_of_each_replica_at_once() -> None:
    rng = np.random.default_rng(0)
    encoder = started(3, seeds=(4, 5))
    rows: list[list[np.ndarray]] = [[], []]
    for size in (7, 1, 30):
        counts = [size, max(0, size - 3)]
        block = (rng.normal(size=(2, size, 3)) * [1, 100, 1e-3] + [0, 1e4, 5]).astype(np.float32)
        encoder.observe(windows(block, counts))
        for own, part, count in zip(rows, block, counts, strict=True):
            own.append(part[:count])
    point = np.float32([1.0, 1e4, 5.0])
    found = encoder(torch.from_numpy(point).expand(4, 3))  # the same states for both
    assert found.shape == (2, 4, 3)
    for own, value in zip(rows, found, strict=True):
        every = np.concatenate(own).astype(np.float64)
        expected = (point - every.mean(0)) / every.std(0)
        np.testing.assert_allclose(value[0], expected, rtol=1e-4, atol=1e-4)


def test_a_replica_is_the_same_alone() -> None:
    block = torch.randn(2, 12, 3, generator=torch.Generator().manual_seed(0))
    both, alone = started(3, seeds=(4, 5)), started(3, seeds=(5,))
    both.observe(windows(block, [12, 9]))
    alone.observe(windows(block[1:, :9]))
    assert torch.equal(both(block)[1], alone(block[1:])[0])


def config(name: str) -> dict[str, Any]:
    found = registry.compose(AGENTS[name])
    return found | {"trainer": found["trainer"] | SHORT, "env": found["env"] | {"max_steps": 15}}


@pytest.mark.thorough
@pytest.mark.parametrize("name", AGENTS)
def test_what_is_learned_from_counts_and_evaluations_do_not(name: str) -> None:
    trainer = schema.build(config(name), "trainer")
    trainer.start((3, 4))
    trainer.run(lambda step, values: None)
    encoder, store = trainer.agent.encoder, trainer.store.windows
    held = encoder.state_dict()
    trainer.metrics()
    assert all(torch.equal(value, encoder.state_dict()[key]) for key, value in held.items())
    counts = [len(store)] * 2 if store.count is None else store.count.tolist()
    for replica, count in enumerate(counts):
        rows = store.states[replica, :count].double()
        torch.testing.assert_close(encoder._mean[replica], rows.mean(0))
        torch.testing.assert_close((encoder._squares[replica] / count).sqrt(), rows.std(0, correction=0))


@pytest.mark.thorough
@pytest.mark.parametrize("name", AGENTS)
def test_a_run_goes_on_to_the_bit(name: str, tmp_path: Path) -> None:
    goes_on(config(name), tmp_path, (3, 4), slice(0, 1))


MADE: dict[str, Callable[[], Any]] = {
    "dqn": lambda: DQN(encoder=Normalize(), hidden=(8,), batch=8),
    "sac": lambda: SAC(encoder=Normalize(), width=8, batch=8, updates=3, success_share=0.0),
    "ppo": lambda: TorchRL("ppo", encoder=Normalize(), hidden=(8,), batch=8, epochs=1),
    "td3": lambda: TorchRL("td3", encoder=Normalize(), hidden=(8,), batch=8, updates_per_step=0.1),
    "discrete_sac": lambda: TorchRL("discrete_sac", encoder=Normalize(), hidden=(8,), batch=8, updates_per_step=0.1),
}


@pytest.mark.parametrize("name", MADE)
def test_agents_act_and_learn_through_it(name: str) -> None:
    """States moved and stretched are seen as the same, so that everything that is learned is the same but for
    rounding."""
    plain, moved = acted(name, 0.0, 1.0), acted(name, 32.0, 4.0)
    torch.testing.assert_close(plain, moved, rtol=1e-3, atol=1e-3)


def acted(name: str, shift: float, scale: float) -> torch.Tensor:
    """What an agent does after two rounds in states that are moved and stretched."""
    agent = MADE[name]()
    vectors = Problem.vectors(3, 2, window=20, seeds=(3, 4))
    space = Problem.finite(2, 2, 4, ()).action_space
    finite = name in ("dqn", "ppo", "discrete_sac")
    problem = replace(vectors, action_space=space) if finite else vectors
    agent.start(problem)
    store, generator = Store(problem), torch.Generator().manual_seed(0)
    for number in range(3):
        drawn = torch.randn(2, 20, 3, generator=generator)
        chosen = torch.randint(2, (2, 20), generator=generator)
        found = replace(
            windows(drawn * scale + shift),
            actions=chosen if finite else chosen.unsqueeze(-1).repeat(1, 1, 2) - 0.5,
            next_states=(drawn + 1) * scale + shift,
            labels=drawn[:, :1, 0].double(),
        )
        store.append(found)
        if not number:  # nothing is learned from states as they are
            agent.look(store.new)
            continue
        agent.act(found.states[:, :1], torch.zeros(2, 1, dtype=torch.int64))
        agent.improve(store, Uniform())
    states = torch.linspace(-2, 2, 15).view(5, 3) * scale + shift
    policy = agent.policies()["behaviour"]
    actions = policy.act(states.expand(2, -1, -1), torch.zeros(2, 5, dtype=torch.int64)).float()
    chances = policy.probabilities(states, 0)
    if chances is not None:
        assert torch.equal(chances.argmax(-1).float(), actions)
    return actions


def test_it_is_kept_with_the_agent_and_only_where_there_is_one() -> None:
    with_one, without = DQN(encoder=Normalize()), DQN()
    problem = replace(
        Problem.vectors(2, 1, window=9, seeds=(0,)), action_space=Problem.finite(2, 3, 4, ()).action_space
    )
    for agent in (with_one, without):
        agent.start(problem)
    assert with_one.state_dict().keys() - without.state_dict().keys() == {"encoder"}


@pytest.mark.thorough
def test_ppo_learns_with_what_it_saw_when_it_acted() -> None:
    changes = list[float]()
    found = config("ppo")
    trainer = schema.build(found | {"agent": found["agent"] | {"batch": 1000}}, "trainer")
    trainer.start((3,))
    trainer.run(lambda step, values: changes.append(float(values["optimizer/kl"].abs().max())))
    assert max(changes) < 1e-4  # of the only update of a round: nothing has moved before it


def test_where_states_are_numbers_it_is_refused() -> None:
    problem = Problem.finite(4, 2, window=3, seeds=(0,), episodic=True)
    with pytest.raises(UserError, match="Normalize needs states that are vectors"):
        require({"agent": DQN(encoder=Normalize())}, problem)


def test_features_and_an_encoder_are_refused() -> None:
    with pytest.raises(UserError, match="both say what the network sees"):
        DQN(features=Flat(), encoder=Normalize())


def test_vectors_keep_the_clock() -> None:
    problem = Problem.vectors(2, 1, window=10, seeds=(0, 1))
    encoder = started(seeds=(0, 1))
    view = Vectors(problem, None, encoder)
    seen = view(torch.ones(3, 2), torch.full((3,), 5))
    assert seen.shape == (2, 3, 3)
    assert torch.equal(seen[..., -1], torch.full((2, 3), 0.5))
