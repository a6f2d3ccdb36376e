"""What registered components owe to problems with real-valued states and actions: the same as to tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import pytest
import torch
import yaml

from credit import job, registry, schema
from credit.continuous import Scaler, StepModel
from credit.interfaces import Bonus, CreditAssigner, Environment, FeatureMap, Feedback, Optimizer, Uncertainty
from credit.optimizers.random import Random
from credit.trainer import Trainer
from credit.trajectories import ContinuousProblem, Moves, Trajectories, TrajectoryDataset

H = 40
SEEDS = (3, 4)
SMALL = {  # what makes an experiment quick, by the name of its environment: two free cells, few demonstrations
    "PointMaze": {
        "env": {
            "maze": ["1111", "1001", "1111"],
            "start": [1, 1],
            "goal": [1, 2],
            "successes": 2,
            "partials": 0,
            "failures": 1,
            "evaluation_episodes": 2,
        },
        "feedback": {"window": H},
    }
}
FEW = {"first_steps": 4, "steps": 2, "updates": 4, "first_updates": 6, "width": 8, "batch": 8, "stride": 3}
TRAINER = {"steps": 4 * H, "windows_per_round": 2, "log_every": 2}


@cache
def composed(*overrides: str) -> dict[str, Any]:
    """The whole configuration, made small; not to be changed."""
    config = registry.compose(["tracking=none", *overrides])
    changes = SMALL.get(schema.resolve("env", config["env"]).__name__, {})
    return less(config) | {slot: config[slot] | keys for slot, keys in ({"trainer": TRAINER} | changes).items()}


def less(node: Any) -> Any:
    """The same configuration with less work in it."""
    if isinstance(node, Mapping):
        return {key: FEW[key] if key in FEW else less(value) for key, value in node.items()}
    return node


def domain(experiment: str) -> str:
    config = composed(f"experiment={experiment}")
    return str(schema.resolve("env", config["env"]).domain)


EXPERIMENTS = [name for name in sorted(registry.options("experiment")) if domain(name) == "continuous"]


@cache
def fits(*overrides: str) -> bool:
    return not job.check(composed(*overrides)).problems


METHODS = [
    (f"experiment={experiment}", f"method={method}")
    for experiment in EXPERIMENTS
    for method in sorted(registry.options("method"))
    if fits(f"experiment={experiment}", f"method={method}")
]
LEARNERS = [names for names in METHODS if names[1] != "method=oracle"]
every_method = pytest.mark.parametrize("names", METHODS, ids="-".join)


def selected(kind: str, slot: str = "") -> list[Any]:
    """Overrides for everything of a kind that may go with a continuous experiment."""
    found = [
        (f"experiment={experiment}", f"{slot or kind}={name}")
        for experiment in EXPERIMENTS
        for name, path in registry.options(kind).items()
        if not on_tables_alone(yaml.safe_load(path.read_text(encoding="utf-8")))
    ]
    return [pytest.param(names, id=names[1]) for names in found]


def on_tables_alone(node: Any) -> bool:
    """Whether a file says that its class is for tables; one that builds on another file does not say."""
    return bool(node) and "_target_" in node and schema.resolve("", node).domain == "tabular"


@pytest.fixture
def fitting(names: tuple[str, ...]) -> dict[str, Any]:
    """The configuration of a test's overrides, if they go together."""
    if not fits(*names):
        pytest.skip("does not go with this experiment")
    return composed(*names)


@dataclass(frozen=True)
class Ran:
    """A run that is over."""

    trainer: Trainer
    journal: list[tuple[int, dict[str, torch.Tensor]]]

    @property
    def windows(self) -> Trajectories:
        windows: Trajectories = self.trainer.dataset.windows
        return windows


def run(names: tuple[str, ...], seeds: tuple[int, ...] = SEEDS, poison: bool = False) -> Ran:
    config = composed(*names)
    trainer: Trainer = schema.build(config | {"env": config["env"] | {"poison": poison}}, "trainer")
    trainer.start(seeds)
    journal: list[tuple[int, dict[str, torch.Tensor]]] = []
    trainer.run(lambda step, values: journal.append((step, values)))
    return Ran(trainer, journal)


ran = cache(run)  # of the runs that others are compared with
ROWS = ("states", "actions", "next_states", "number", "final", "terminated")


@every_method
def test_methods_run(names: tuple[str, ...]) -> None:
    found = ran(names)
    trainer, windows = found.trainer, found.windows
    demonstrated = len(trainer.dataset) - 4
    assert trainer.collected == 4
    assert [step for step, _ in found.journal] == ([0] if demonstrated else []) + [2 * H, 4 * H]
    for step, values in found.journal:
        assert values.keys() == found.journal[0][1].keys()
        for name, value in values.items():
            assert value.shape == (2,), name
            assert torch.isfinite(value).all() or step == 0, name
    assert {"return/label", "collect/steps"} <= found.journal[-1][1].keys()
    assert windows.labels.shape == (2, demonstrated + 4)
    assert (windows.actions.abs() <= 1).all()
    assert (windows.primitive is not None) == (names[1] == "method=oracle")
    rewards = trainer.assigner.rewards(windows)
    assert rewards.shape == (len(windows),)
    assert torch.isfinite(rewards).all()


@every_method
def test_one_seed_one_run_to_the_last_bit(names: tuple[str, ...]) -> None:
    first, again = ran(names), run(names)
    for name in (*ROWS, "replica", "labels"):
        assert torch.equal(getattr(first.windows, name), getattr(again.windows, name)), name
    for (step, values), (same_step, same) in zip(first.journal, again.journal, strict=True):
        assert step == same_step
        assert values.keys() == same.keys()
        for name in values:
            torch.testing.assert_close(values[name], same[name], rtol=0, atol=0, equal_nan=True, msg=name)
    assert not torch.equal(*(first.windows.states[first.windows.replica == r][:9] for r in range(2)))


@every_method
def test_a_replica_goes_alone_as_in_a_batch(names: tuple[str, ...]) -> None:
    batch, alone = ran(names), run(names, SEEDS[1:])
    mine = batch.windows.replica == 1
    for name in ROWS:
        parts = (getattr(alone.windows, name), getattr(batch.windows, name)[mine])
        torch.testing.assert_close(*parts, rtol=0, atol=1e-4, msg=name)
    assert torch.equal(alone.windows.labels[0], batch.windows.labels[1])
    rewards = batch.trainer.assigner.rewards(batch.windows)
    torch.testing.assert_close(alone.trainer.assigner.rewards(alone.windows), rewards[mine], rtol=1e-3, atol=1e-4)
    for (_, single), (_, together) in zip(alone.journal, batch.journal, strict=True):
        for name in single:
            torch.testing.assert_close(single[name][0], together[name][1], rtol=1e-3, atol=1e-5, equal_nan=True)


@pytest.mark.parametrize("names", LEARNERS, ids="-".join)
def test_the_primitive_reward_does_not_leak(names: tuple[str, ...]) -> None:
    plain, poisoned = ran(names), run(names, poison=True)
    for name in (*ROWS, "labels"):
        assert torch.equal(getattr(plain.windows, name), getattr(poisoned.windows, name)), name
    for (_, values), (_, hidden) in zip(plain.journal, poisoned.journal, strict=True):
        for name in values:
            torch.testing.assert_close(values[name], hidden[name], rtol=0, atol=0, equal_nan=True, msg=name)


@cache
def experienced(experiment: str) -> tuple[ContinuousProblem, TrajectoryDataset]:
    """Four trajectories of random actions of each of two replicas, with labels that they did not earn."""
    config = composed(experiment)
    env, feedback, random = schema.build(config, "env"), schema.build(config, "feedback"), Random()
    problem = env.problem(feedback.window, SEEDS, "cpu")
    dataset = TrajectoryDataset(problem)
    for part in (env, feedback, random):
        part.start(problem)
    windows, _ = env.collect(random.act, feedback, 4, problem.window)
    dataset.append(replace(windows, labels=torch.tensor([[0.0, 1.0, 1.0, 0.0]] * 2, dtype=torch.float64)))
    return problem, dataset


def shuffled(moves: Moves) -> tuple[Moves, torch.Tensor]:
    order = torch.randperm(len(moves), generator=torch.Generator().manual_seed(0))
    return Moves(*(part[order] for part in (moves.states, moves.actions, moves.next_states, moves.replica))), order


@pytest.mark.parametrize("names", selected("reward", "reward@reference"))
def test_reward_models(names: tuple[str, ...], fitting: dict[str, Any]) -> None:
    problem, dataset = experienced(names[0])
    model, windows = schema.build(fitting, "reference"), dataset.windows
    assert isinstance(model, StepModel)
    if model.sees_primitive:
        windows = replace(windows, primitive=windows.terminated.double())
    model.start(problem)
    inputs = model.features(windows)
    assert len(inputs) == len(windows)
    before = inputs.clone()
    for _ in range(2):
        model.fit(inputs, windows)
        mean, variance = model.predict(inputs, windows)
        assert mean.shape == variance.shape == (len(windows),)
        assert torch.isfinite(mean).all()
        assert torch.isfinite(variance).all()
        assert (variance >= 0).all()
    assert torch.equal(inputs, before)
    if not model.sees_primitive:  # rows in any order, of any trajectory
        moves, order = shuffled(windows)
        predicted, spread = model.predict(inputs[order], moves)
        assert predicted.shape == spread.shape == mean.shape
        assert torch.isfinite(predicted).all()


@pytest.mark.parametrize("names", selected("features", "features@reference.features"))
def test_feature_maps(names: tuple[str, ...], fitting: dict[str, Any]) -> None:
    problem, dataset = experienced(names[0])
    features = schema.build(fitting, "reference").features
    assert isinstance(features, FeatureMap)
    features.start(problem)
    rows = features(dataset.windows)
    assert rows.shape[:1] == dataset.windows.states.shape[:1]
    assert rows.ndim == 2
    assert torch.isfinite(rows).all()
    moves, order = shuffled(dataset.windows)
    torch.testing.assert_close(features(moves), rows[order])  # a row is of its step alone


@pytest.mark.parametrize("names", selected("uncertainty"))
def test_uncertainties(names: tuple[str, ...], fitting: dict[str, Any]) -> None:
    problem, dataset = experienced(names[0])
    model = schema.build(fitting, "reference")
    assert isinstance(model.uncertainty, Uncertainty)
    model.start(problem)
    inputs = model.features(dataset.windows)
    model.fit(inputs, dataset.windows)
    _, variance = model.predict(inputs, dataset.windows)
    assert (variance >= 0).all()
    assert variance.max() > 0


@pytest.mark.parametrize("names", selected("scaler"))
def test_scalers(fitting: dict[str, Any]) -> None:
    scaler = schema.build(fitting, "scaler")
    assert isinstance(scaler, Scaler)
    random = torch.randn(500, generator=torch.Generator().manual_seed(0)) * 3 - 1
    for rewards in (random, torch.zeros(7), torch.full((7,), 2.5), random * 1e-20, random * 1e20, random[:1]):
        before = rewards.clone()
        scaled = scaler(rewards)
        assert scaled.shape == rewards.shape
        assert torch.isfinite(scaled).all()
        assert torch.equal(rewards, before)
        order = rewards.argsort()
        assert (scaled[order].diff() >= 0).all()  # never turns two steps around


@pytest.mark.parametrize("names", selected("assigner"))
def test_assigners(names: tuple[str, ...], fitting: dict[str, Any]) -> None:
    problem, dataset = experienced(names[0])
    assigner = schema.build(fitting, "assigner")
    assert isinstance(assigner, CreditAssigner)
    assigner.start(problem)
    assigner.observe(dataset)
    rewards = assigner.rewards(dataset.windows)
    assert rewards.shape == (len(dataset.windows),)
    assert torch.isfinite(rewards).all()
    if assigner.recovery() is None:  # a redistribution gives out the label, no more and no less
        torch.testing.assert_close(dataset.windows.sums(rewards), dataset.windows.labels)


@pytest.mark.parametrize("names", selected("bonus"))
def test_bonuses(names: tuple[str, ...], fitting: dict[str, Any]) -> None:
    problem, dataset = experienced(names[0])
    assigner = schema.build(fitting, "assigner")
    assigner.start(problem)
    assigner.observe(dataset)
    for name, bonus in assigner.bonus.items():
        assert isinstance(bonus, Bonus)
        value = assigner.recovery().bonus[name]
        assert value.shape == (1, len(dataset.windows))
        assert (value >= 0).all()
        assert torch.isfinite(value).all()


@pytest.mark.parametrize("names", selected("optimizer"))
def test_optimizers(names: tuple[str, ...], fitting: dict[str, Any]) -> None:
    problem, dataset = experienced(names[0])
    optimizer, assigner = (
        schema.build(composed(*names, "assigner=delayed"), slot) for slot in ("optimizer", "assigner")
    )
    assert isinstance(optimizer, Optimizer)
    optimizer.start(problem)
    states = dataset.windows.states[:6]
    for learned in (False, True):
        if learned:
            optimizer.improve(dataset, assigner)
        policies = optimizer.policies()
        assert "behaviour" in policies
        for act in (optimizer.act, *policies.values()):
            for step in range(3):
                actions = act(states, step)
                assert actions.shape == (6, problem.actions)
                assert actions.dtype == torch.float32
                assert (actions.abs() <= 1).all()
    assert all(value.shape == (2,) for value in optimizer.diagnostics().values())


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_environments(experiment: str) -> None:
    config = composed(f"experiment={experiment}")
    env, feedback, random = schema.build(config, "env"), schema.build(config, "feedback"), Random()
    assert isinstance(env, Environment)
    assert isinstance(feedback, Feedback)
    problem = env.problem(feedback.window, SEEDS, "cpu")
    for part in (env, feedback, random):
        part.start(problem)
    oracle = env.oracle(problem, feedback)
    demonstrations = env.demonstrations()
    rounds = [env.collect(random.act, feedback, 3, problem.window), *([demonstrations] if demonstrations else [])]
    for windows, primitive in rounds:
        assert windows.labels.shape[0] == 2
        assert primitive.shape == (len(windows),)
        assert windows.primitive is None
        assert windows.states.shape == windows.next_states.shape == (len(windows), problem.observations)
        assert windows.actions.shape == (len(windows), problem.actions)
        assert (windows.lengths >= 1).all()
        assert (windows.lengths <= problem.window).all()
        assert torch.equal(windows.sums(windows.final.long()), torch.ones_like(windows.labels).long())
        assert windows.final[windows.terminated].all()
    oracle.update(rounds[0][1], rounds[0][0].labels, random)
    values = oracle.metrics(random.policies(), None)
    assert values
    assert all(value.shape == (2,) for value in values.values())
    grid = env.grid()
    assert grid is None or (len(grid) and grid.states.shape[1] == problem.observations)
    assert env.picture(1)
