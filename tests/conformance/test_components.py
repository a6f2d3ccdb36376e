"""What every registered component owes its kind, on every experiment that it goes with. A new YAML file is tested here
without an edit, and so is a new experiment."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from itertools import islice
from typing import Any

import pytest
import torch

from credit.agents.random import Random
from credit.config import files, schema
from credit.core.problem import FLOAT, Problem
from credit.core.seams import (
    Agent,
    Bonus,
    CreditAssigner,
    Environment,
    FeatureMap,
    Feedback,
    Mixer,
    RewardModel,
    Scaler,
    Transition,
)
from credit.core.store import Store
from credit.core.windows import Windows
from credit.envs.collect import Collector
from credit.judges.choose import judge

from .short import EXPERIMENTS, SEEDS, checked, composed, options, selection

Some = Callable[[str, str], list[tuple[str, ...]]]
SIGNED = {"thompson"}  # a posterior draw lies on either side of the mean


def goes_with(kind: str, name: str) -> Iterator[tuple[str, ...]]:
    """The overrides of every experiment that an option goes with."""
    for experiment in EXPERIMENTS:
        for way in (("method=disagreement",), ("method=reference",), ("method=reference", "reward@reference=linear")):
            words = (f"experiment={experiment}", *way, *selection(kind, name))
            problems, used = checked(*words)
            if not problems and {"reward": "reference", "features": "reference"}.get(kind, kind) in used:
                yield words
                break


@cache
def experienced(*words: str) -> tuple[Problem, Store, Any]:
    """The problem of a configuration with two replicas, windows of random actions in it, and what is known of it."""
    config = composed(*words)
    env, feedback, random = schema.build(config, "env"), schema.build(config, "feedback"), Random()
    problem = env.problem(feedback.window, SEEDS, "cpu")
    for part in (env, feedback, random):
        part.start(problem)
    windows, primitive = Collector(env, feedback, problem).collect(random, 15 if problem.tabular else 4)
    if not problem.tabular:  # labels that they did not earn
        windows = replace(windows, labels=torch.tensor([[0.0, 1.0, 1.0, 0.0]] * 2, dtype=FLOAT))
    store = Store(problem)
    store.append(replace(windows, primitive=primitive))
    return problem, store, env.knowledge()


def built(words: tuple[str, ...], slot: str) -> tuple[Any, Problem, Store]:
    """What a configuration has in a slot, informed and not yet started; and experience in its experiment."""
    from credit.core.capabilities import parts_of
    from credit.core.knowledge import inform

    problem, store, knowledge = experienced(words[0])
    part = schema.build(composed(*words), slot)
    inform(parts_of(part), knowledge)
    return part, problem, store


def assigned(words: tuple[str, ...]) -> tuple[Any, Problem, Store]:
    """A credit assigner that has seen some windows."""
    assigner, problem, store = built(words, "assigner")
    assigner.start(problem)
    assigner.observe(store)
    return assigner, problem, store


@pytest.fixture(params=["first", pytest.param("every", marks=pytest.mark.slow)])
def some(request: pytest.FixtureRequest) -> Some:
    """The first experiment that an option goes with, and among the slow tests every one; there must be one."""

    def of(kind: str, name: str) -> list[tuple[str, ...]]:
        found = list(islice(goes_with(kind, name), 1 if request.param == "first" else None))
        assert found, f"{kind}={name} goes with no experiment"
        return found

    return of


@pytest.mark.parametrize("name", sorted(files.options("mixer")))
@pytest.mark.parametrize("models", [1, 2, 3, 4])
def test_mixers(name: str, models: int) -> None:
    mixer = schema.build(composed(f"mixer={name}"), "mixer")
    assert isinstance(mixer, Mixer)
    random = torch.rand(2, models, 30, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    for mse in (random, torch.zeros_like(random), random * 1e-30, random * 1e30):
        before = mse.clone()
        weights = mixer.weights(mse, torch.eye(models, dtype=torch.float64).repeat(2, 1, 1))
        assert weights.shape == mse.shape
        assert (weights >= 0).all()
        torch.testing.assert_close(weights.sum(-2), torch.ones(2, 30, dtype=torch.float64))
        assert torch.equal(mse, before)


@pytest.mark.parametrize("name", options("bonus"))
def test_bonuses(some: Some, name: str) -> None:
    for words in some("bonus", name):
        assigner, _, _ = assigned(words)
        belief = assigner.belief()
        assert belief is not None
        assert belief.bonus or name == "none"
        for part, value in belief.bonus.items():
            assert isinstance(assigner.bonus[part], Bonus)
            assert value.shape == belief.mixed.shape
            assert torch.isfinite(value).all()
            assert name in SIGNED or (value >= 0).all()


@pytest.mark.parametrize("name", options("reward"))
def test_reward_models(some: Some, name: str) -> None:
    for words in some("reward", name):
        assigner, problem, store = assigned(words)
        model = assigner.models[0]
        assert isinstance(model, RewardModel)
        assert isinstance(model.name, str)
        for _ in range(2):
            estimate = model.estimate()
            assert estimate.mean.shape[0] == estimate.variance.shape[0] == problem.replicas
            assert estimate.mean.shape == estimate.variance.shape == assigner.belief().mixed.shape
            assert torch.isfinite(estimate.mean).all()
            assert torch.isfinite(estimate.variance).all()
            assert (estimate.variance >= 0).all()
            if estimate.draws is not None:
                assert estimate.draws.shape[::2] == estimate.mean.shape
            model.observe(store)
        assert model.sees_primitive or estimate.mean.abs().max() > 0


@pytest.mark.parametrize("name", options("features"))
def test_feature_maps(some: Some, name: str) -> None:
    for words in some("features", name):
        model, problem, store = built(words, "reference")
        features = model.features
        assert isinstance(features, FeatureMap)
        features.start(problem)
        windows = store.windows
        values = features(windows)
        assert values.shape[:2] == windows.states.shape[:2]
        assert values.ndim == 3
        assert torch.isfinite(values).all()
        assert features(problem.blank()).shape[-1] == values.shape[-1]
        order = torch.randperm(len(windows), generator=torch.Generator().manual_seed(0))
        shuffled = replace(
            windows,
            states=windows.states[:, order],
            actions=windows.actions[:, order],
            next_states=windows.next_states[:, order],
            step=windows.times[:, order],
        )
        torch.testing.assert_close(features(shuffled), values[:, order])  # a row is of its step alone


@pytest.mark.parametrize("name", options("uncertainty"))
def test_uncertainties(some: Some, name: str) -> None:
    for words in some("uncertainty", name):
        assigner, _, _ = assigned(words)
        reference = assigner.models[0].estimate()
        assert (reference.variance >= 0).all()
        assert reference.variance.max() > 0


@pytest.mark.parametrize("name", options("scaler"))
def test_scalers(name: str) -> None:
    scaler = schema.build(composed("experiment=pointmaze", f"scaler={name}"), "scaler")
    assert isinstance(scaler, Scaler)
    random = torch.randn(500, generator=torch.Generator().manual_seed(0)) * 3 - 1
    for rewards in (random, torch.zeros(7), torch.full((7,), 2.5), random * 1e-20, random * 1e20, random[:1]):
        before = rewards.clone()
        scaled, unit = scaler(rewards)
        assert scaled.shape == rewards.shape
        assert unit > 0
        assert torch.isfinite(scaled).all()
        assert torch.equal(rewards, before)
        assert (scaled[rewards.argsort()].diff() >= 0).all()  # never turns two steps around


@pytest.mark.parametrize("name", options("transition"))
def test_transition_models(some: Some, name: str) -> None:
    for words in some("transition", name):
        first, problem, store = built(words, "transition")
        second, _, _ = built(words, "transition")
        values = torch.rand(2, problem.states, dtype=FLOAT, generator=torch.Generator().manual_seed(0))
        for model in (first, second):
            assert isinstance(model, Transition)
            model.start(problem)
        for seen in (False, True):
            if seen:
                first.observe(store.windows)
            total = first.backup(torch.ones_like(values))
            assert total.shape == (2, problem.states, problem.actions)
            assert ((total - 1).abs().lt(1e-9) | total.eq(0)).all()
            found = first.backup(values)
            assert ((found >= 0) & (found <= values.amax() + 1e-9)).all()
            torch.testing.assert_close(first.backup(2 * values + 1), 2 * found + total)
        for piece in (slice(0, 10), slice(10, 15)):
            second.observe(part_of(store.windows, piece))
        torch.testing.assert_close(second.backup(values), found)


def part_of(windows: Windows, which: slice) -> Windows:
    steps = (windows.states, windows.actions, windows.next_states)
    states, actions, arrivals = (windows.grid(part)[:, which] for part in steps)
    return Windows.of_grid(states, actions, arrivals, windows.labels[:, which])


@pytest.mark.parametrize("name", options("assigner"))
def test_assigners(some: Some, name: str) -> None:
    for words in some("assigner", name):
        assigner, _, store = assigned(words)
        assert isinstance(assigner, CreditAssigner)
        windows = store.windows
        rewards = assigner.rewards(windows)
        assert rewards.shape == windows.states.shape[:2]
        assert torch.isfinite(rewards).all()
        if assigner.belief() is None:  # a redistribution gives out the label, no more and no less
            torch.testing.assert_close(windows.sums(rewards), windows.labels)


@pytest.mark.parametrize("name", options("agent"))
def test_agents(some: Some, name: str) -> None:
    for words in some("agent", name):
        agent, problem, store = built(words, "agent")
        assigner, _, _ = assigned(words)
        assert isinstance(agent, Agent)
        agent.start(problem)
        states = store.windows.states[:, :1]
        for learned in (False, True):
            if learned:
                agent.improve(store, assigner)
            policies = agent.policies()
            assert "behaviour" in policies
            acting = [agent] if problem.finite_actions and isinstance(agent, Random) else [agent, *policies.values()]
            for step in range(3):
                for one in acting:
                    actions = one.act(states, torch.full((2, 1), step))
                    if problem.finite_actions:
                        assert actions.shape == (2, 1)
                        assert actions.dtype == torch.int64
                        assert ((actions >= 0) & (actions < problem.actions)).all()
                    else:
                        assert actions.shape == (2, 1, problem.actions)
                        assert actions.dtype == torch.float32
                        assert (actions.abs() <= 1).all()
            if problem.tabular and problem.episodic:
                chances = agent.executed().probabilities(torch.arange(problem.states), 0)
                assert chances is not None
                torch.testing.assert_close(chances.sum(-1), torch.ones(2, problem.states, dtype=FLOAT))
        assert all(value.shape == (2,) for value in agent.diagnostics().values())


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_environments(experiment: str) -> None:
    config = composed(f"experiment={experiment}")
    env, feedback, random = schema.build(config, "env"), schema.build(config, "feedback"), Random()
    assert isinstance(env, Environment)
    assert isinstance(feedback, Feedback)
    problem = env.problem(feedback.window, SEEDS, "cpu")
    for part in (env, feedback, random):
        part.start(problem)
    collector = Collector(env, feedback, problem)
    judged = judge(env, feedback, problem, collector.evaluation)
    demonstrations = env.demonstrations()
    rounds = [collector.collect(random, 3), *([demonstrations] if demonstrations else [])]
    for windows, primitive in rounds:
        assert windows.labels.shape[0] == problem.replicas
        assert primitive.shape == windows.states.shape[:2]
        assert windows.primitive is None
        assert windows.states.shape == windows.next_states.shape
        if problem.finite_states:
            assert ((windows.states >= 0) & (windows.states < problem.states)).all()
        else:
            assert windows.states.shape[2] == problem.observations
        assert ((windows.lengths >= 1) & (windows.lengths <= problem.window)).all()
        assert torch.equal(windows.sums(windows.final.long()), torch.ones_like(windows.labels).long())
        if windows.terminated is not None:
            assert windows.ended is not None
            assert windows.ended[windows.terminated].all()
    judged.update(*rounds[0], random)
    values = judged.measure(random.policies(), None)
    assert judged.metric in values
    assert all(value.shape == (2,) for value in values.values())
    grid = env.grid()
    assert grid is None or len(grid.states) == len(grid.actions)
    assert isinstance(env.picture(1), dict)
