"""What every registered component owes its kind. A new YAML file is tested here without an edit."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml

from credit import job, registry, schema, signatures
from credit.dataset import Dataset
from credit.errors import UserError
from credit.interfaces import (
    Bonus,
    CreditAssigner,
    Environment,
    FeatureMap,
    Feedback,
    Mixer,
    Optimizer,
    RewardModel,
    Uncertainty,
)
from credit.optimizers.random import Random
from credit.tables import TransitionModel, TransitionTable
from credit.trainer import Trainer
from credit.types import Problem, Windows

MakeWindows = Callable[..., Windows]
SIGNED = {"thompson"}  # a posterior draw lies on either side of the mean
EXPERIMENTS = sorted(registry.options("experiment"))
FILES = [(kind, name) for kind in registry.KINDS for name in registry.options(kind)]


def options(kind: str) -> list[str]:
    """Registered names of a kind that may run on a tabular problem."""
    return [name for name in registry.options(kind) if on_tabular(kind, name)]


def on_tabular(kind: str, name: str) -> bool:
    """Asked while tests are collected, by every worker: a file that names its classes is not composed for it."""
    named = re.findall(r"^\s*_target_:\s*(\S+)", registry.options(kind)[name].read_text(encoding="utf-8"), re.MULTILINE)
    found = [schema.resolve(name, {"_target_": target}) for target in named] or classes(kind, name)
    return all(getattr(cls, "domain", "any") in ("any", "tabular") for cls in found)


def selection(kind: str, name: str) -> list[str]:
    """The override that puts an option where it is used."""
    return {
        "reward": [f"reward@reference={name}"],
        "features": [f"features@reference.features={name}"],
        "bonus": [f"bonus=[{name}]"],
        "tracking": [f"tracking={name}"],
    }.get(kind, [f"{kind}={name}"])


@cache
def of_experiment(experiment: str, *overrides: str) -> dict[str, Any]:
    """The whole configuration of an experiment; not to be changed."""
    return registry.compose(["tracking=none", f"experiment={experiment}", *overrides])


TABULAR = [  # continuous ones are tested beside this file
    name for name in EXPERIMENTS if schema.resolve("env", of_experiment(name)["env"]).domain == "tabular"
]


@cache
def fits(experiment: str, *overrides: str) -> bool:
    return not job.check(of_experiment(experiment, *overrides)).problems


@cache
def composed(kind: str, name: str) -> dict[str, Any]:
    """The whole configuration; not to be changed."""
    return registry.compose(["tracking=none", *selection(kind, name)])


def nodes(kind: str, name: str) -> dict[str, Any]:
    """Path → configuration of the components that an option makes."""
    config = composed(kind, name)
    if kind == "features":
        return {"reference.features": config["reference"]["features"]}
    slot = "reference" if kind == "reward" else kind
    return schema.members(config, slot)


def classes(kind: str, name: str) -> list[type]:
    return [schema.resolve(path, node) for path, node in nodes(kind, name).items()]


def built(kind: str, name: str) -> Any:
    slot = {"reward": "reference", "features": "reference"}.get(kind, kind)
    part = schema.build(composed(kind, name), slot)
    return part.features if kind == "features" else part


@pytest.fixture
def problem(make_problem: Callable[..., Problem]) -> Problem:
    return make_problem((3, 4))


def trained(problem: Problem, make_windows: MakeWindows, *overrides: str) -> tuple[Any, Dataset]:
    """A credit assigner that has seen 15 windows, and its data."""
    assigner = schema.build(registry.compose(["tracking=none", *overrides]), "assigner")
    dataset = Dataset(problem, 1)
    dataset.append(make_windows(problem, 15))
    assigner.start(problem)
    assigner.observe(dataset)
    return assigner, dataset


@cache
def experienced(experiment: str) -> tuple[Problem, Windows, Dataset]:
    """The problem of an experiment with two replicas, and 15 windows of random actions in it."""
    config = of_experiment(experiment)
    env, feedback, random = schema.build(config, "env"), schema.build(config, "feedback"), Random()
    problem = env.problem(feedback.window, (3, 4), "cpu")
    for part in (env, feedback, random):
        part.start(problem)
    windows, _ = env.collect(random.act, feedback, 15, problem.window)
    dataset = Dataset(problem, 15)
    dataset.append(windows)
    return problem, windows, dataset


def rows(windows: Windows, which: slice) -> Windows:
    parts = (windows.states, windows.actions, windows.next_states, windows.labels)
    return Windows(*(part[:, which] for part in parts))


@pytest.mark.parametrize(("kind", "name"), FILES)
def test_class_kind_and_words(kind: str, name: str) -> None:
    assert registry.describe_file(registry.options(kind)[name])
    for cls in classes(kind, name):
        assert issubclass(cls, registry.KINDS[kind].load())
        assert not inspect.isabstract(cls)
        assert cls.__doc__
        assert cls.__doc__.strip().splitlines()[0].strip()


@pytest.mark.parametrize(("kind", "name"), FILES)
def test_every_parameter_has_a_value_and_every_key_a_parameter(kind: str, name: str) -> None:
    slots = {slot for other in registry.KINDS.values() for slot in other.slots}
    for cls, node in zip(classes(kind, name), nodes(kind, name).values(), strict=True):
        parameters = signatures.signature(cls)
        assert node.keys() - {"_target_"} <= parameters.keys()
        for parameter, (hint, default) in parameters.items():
            assert parameter in node or default is not signatures.REQUIRED or parameter in slots, parameter
            assert hint is not Any, f"{parameter} has no type hint"


@pytest.mark.parametrize(("kind", "name"), FILES)
def test_every_parameter_is_documented(kind: str, name: str) -> None:
    for cls in classes(kind, name):
        for parameter in signatures.signature(cls):
            assert f"{parameter}:" in (cls.__doc__ or ""), parameter


@cache
def written() -> dict[type, dict[str, list[Any]]]:
    """Class → parameter → the values that its files give it; of `${tuned.x}` those of every experiment."""
    base, *experiments = [registry.conf_dir() / "config.yaml", *registry.options("experiment").values()]
    defaults = _yaml(base)["tuned"]
    tuned = [defaults | _yaml(path).get("tuned", {}) for path in experiments]
    found: dict[type, dict[str, list[Any]]] = {}
    for kind, name in FILES:
        node = _yaml(registry.options(kind)[name])
        if "_target_" not in node:
            continue
        values = found.setdefault(schema.resolve(name, node), {})
        for key, value in node.items():
            reference = re.fullmatch(r"\$\{tuned\.(\w+)\}", str(value))
            values.setdefault(key, []).extend([keys[reference[1]] for keys in tuned] if reference else [value])
    return found


def _yaml(path: Path) -> dict[str, Any]:
    return yaml.safe_load(path.read_text(encoding="utf-8")) or {}


@pytest.mark.parametrize(("kind", "name"), FILES)
def test_a_default_of_the_constructor_is_that_of_a_file(kind: str, name: str) -> None:
    for cls in classes(kind, name):
        for parameter, (_, default) in signatures.signature(cls).items():
            values = written().get(cls, {}).get(parameter)
            if values and default is not signatures.REQUIRED and parameter != "name":
                assert (list(default) if isinstance(default, tuple) else default) in values, parameter


def keys_without_comment(path: Path) -> list[str]:
    """Keys that carry no comment, beside or above them; names and what chooses other files need none."""
    found, above, inside = [], False, False
    for line in path.read_text(encoding="utf-8").splitlines():
        stripped = line.strip()
        if stripped.startswith("#"):
            above = True
            continue
        inside = stripped == "defaults:" or (inside and stripped.startswith("-"))
        key = stripped.partition(":")[0]
        if stripped and not inside and key not in ("_target_", "name", "surrogates") and "#" not in line and not above:
            found.append(key)
        above = False
    return found


@pytest.mark.parametrize(("kind", "name"), FILES)
def test_every_key_has_a_comment(kind: str, name: str) -> None:
    assert keys_without_comment(registry.options(kind)[name]) == []


@pytest.mark.parametrize("name", options("mixer"))
@pytest.mark.parametrize("models", [1, 2, 3, 4])
def test_mixers(name: str, models: int) -> None:
    mixer = built("mixer", name)
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
def test_bonuses(problem: Problem, make_windows: MakeWindows, name: str) -> None:
    assigner, _ = trained(problem, make_windows, "method=disagreement", f"bonus=[{name}]")
    for bonus in schema.build(composed("bonus", name), "bonus").values():
        assert isinstance(bonus, Bonus)
        bonus.start(problem)
        value = bonus(assigner.recovery(), assigner.models[0])
        assert value.shape == (2, 30)
        assert value.dtype == torch.float64
        assert torch.isfinite(value).all()
        assert name in SIGNED or (value >= 0).all()


def a_problem_of(part: FeatureMap | RewardModel, make_problem: Callable[..., Problem], *rest: int) -> Problem:
    """A problem on which the part starts: the advertiser's size, or that of the patients."""
    sizes = ((10, 3, 7, False), (1296, 8, 5, True))
    for states, actions, window, episodic in sizes:
        problem = make_problem((3, 4), states, actions, window)
        problem = replace(problem, episodic=episodic, axes=tuple(part.looks_at))
        with suppress(UserError):
            part.start(problem, *rest)
            return problem
    raise AssertionError(f"{part} starts on none of {sizes}")


@pytest.mark.parametrize("name", options("reward"))
def test_reward_models(make_problem: Callable[..., Problem], make_windows: MakeWindows, name: str) -> None:
    model = built("reward", name)
    assert isinstance(model, RewardModel)
    assert isinstance(model.name, str)
    problem = a_problem_of(model, make_problem, 4)
    windows = make_windows(problem, 6)
    rewards = torch.ones(2, 6, problem.window).double()
    shown = Windows(windows.states, windows.actions, windows.next_states, windows.labels, rewards)
    weights = torch.ones(2, 6, 5, dtype=torch.float64)
    for step in (lambda: None, lambda: model.observe(shown, weights), lambda: model.refit(shown, weights)):
        step()
        estimate = model.estimate()
        assert estimate.mean.shape == (2, problem.cells.count)
        assert estimate.draws.shape == (2, 4, problem.cells.count)
        assert torch.isfinite(estimate.mean).all()
        assert torch.isfinite(estimate.draws).all()
    assert estimate.mean.abs().max() > 0


@pytest.mark.parametrize("name", options("features"))
def test_feature_maps(make_problem: Callable[..., Problem], make_windows: MakeWindows, name: str) -> None:
    features = built("features", name)
    assert isinstance(features, FeatureMap)
    problem = a_problem_of(features, make_problem)
    table = features(problem.cells.steps(problem.device))
    assert table.ndim == 2
    assert table.shape[0] == problem.cells.count
    assert table.dtype == torch.float64
    assert torch.isfinite(table).all()
    windows = make_windows(problem, 3)
    assert torch.equal(features(windows), table[problem.cells.index(windows)])  # it looks at what it says


@pytest.mark.parametrize("name", options("uncertainty"))
def test_uncertainties(problem: Problem, make_windows: MakeWindows, name: str) -> None:
    assigner, _ = trained(problem, make_windows, "method=disagreement", f"uncertainty={name}")
    uncertainty = assigner.uncertainty
    assert isinstance(uncertainty, Uncertainty)
    reference, surrogate = (model.estimate() for model in assigner.models[:2])
    values = {
        "variance": uncertainty.variance(assigner.models[0], reference),
        "prior": uncertainty.prior(assigner.recovery().visits),
        "disagreement": uncertainty.disagreement(reference, surrogate),
    }
    for what, value in values.items():
        assert value.shape == (2, 30), what
        assert torch.isfinite(value).all(), what
        assert (value >= 0).all(), what
    assert values["variance"].max() > 0
    assert (uncertainty.disagreement(reference, reference) == 0).all()


@pytest.mark.parametrize("name", options("feedback"))
def test_feedbacks(problem: Problem, name: str) -> None:
    feedback = built("feedback", name)
    assert isinstance(feedback, Feedback)
    assert feedback.window >= 1
    feedback.start(problem)
    rewards = torch.rand(2, 5, feedback.window, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    labels = feedback(rewards)
    assert labels.shape == (2, 5)
    assert torch.isfinite(labels).all()


@pytest.mark.parametrize("experiment", TABULAR)
@pytest.mark.parametrize("name", options("transition"))
def test_transition_models(name: str, experiment: str) -> None:
    problem, windows, _ = experienced(experiment)
    if issubclass(classes("transition", name)[0], TransitionTable) and problem.pairs * problem.states > 10**6:
        pytest.skip("too large to be written out")
    if not fits(experiment, f"transition={name}"):
        pytest.skip("does not go with this experiment")
    values = torch.rand(2, problem.states, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    models = [schema.build(of_experiment(experiment, f"transition={name}"), "transition") for _ in range(2)]
    for model in models:
        assert isinstance(model, TransitionModel)
        model.start(problem)
    for seen in (False, True):
        if seen:
            models[0].observe(windows)
        total = models[0].backup(torch.ones_like(values))
        assert total.shape == (2, problem.states, problem.actions)
        assert ((total - 1).abs().lt(1e-9) | total.eq(0)).all()
        found = models[0].backup(values)
        assert ((found >= 0) & (found <= values.amax() + 1e-9)).all()
        torch.testing.assert_close(models[0].backup(2 * values + 1), 2 * found + total)
    for piece in (slice(0, 10), slice(10, 15)):
        models[1].observe(rows(windows, piece))
    torch.testing.assert_close(models[1].backup(values), found)


@pytest.mark.parametrize("name", options("assigner"))
def test_assigners(problem: Problem, make_windows: MakeWindows, name: str) -> None:
    assigner, dataset = trained(problem, make_windows, "method=disagreement", f"assigner={name}")
    assert isinstance(assigner, CreditAssigner)
    rewards = assigner.rewards(dataset.windows)
    assert rewards.shape == (2, 15, 7)
    assert torch.isfinite(rewards).all()
    if not hasattr(assigner, "recovery"):  # a redistribution gives out the label, no more and no less
        torch.testing.assert_close(rewards.sum(-1), dataset.windows.labels)


@pytest.mark.parametrize("experiment", TABULAR)
@pytest.mark.parametrize("name", options("optimizer"))
def test_optimizers(name: str, experiment: str) -> None:
    if not fits(experiment, f"optimizer={name}"):
        pytest.skip("does not go with this experiment")
    problem, _, dataset = experienced(experiment)
    config = of_experiment(experiment, f"optimizer={name}")
    optimizer, assigner = schema.build(config, "optimizer"), schema.build(config, "assigner")
    assert isinstance(optimizer, Optimizer)
    assigner.start(problem)
    assigner.observe(dataset)
    optimizer.start(problem)
    by_state, by_step = (2, problem.states), (2, problem.window, problem.states)
    for learned in (False, True):
        if learned:
            optimizer.improve(dataset, assigner)
        for step in range(problem.window):
            actions = optimizer.act(torch.tensor([step, problem.states - 1 - step]), step)
            assert actions.shape == (2,)
            assert actions.dtype == torch.int64
            assert ((actions >= 0) & (actions < problem.actions)).all()
        for policy in optimizer.policies().values():
            assert policy.shape in (by_state, by_step)
            assert ((policy >= 0) & (policy < problem.actions)).all()
        if schema.resolve("env", of_experiment(experiment)["env"]).setting == "episodic":
            assert optimizer.executed().shape in (by_step, (*by_step, problem.actions))


@pytest.mark.parametrize("name", options("env"))
def test_environments(name: str) -> None:
    config = composed("env", name)
    env, feedback = schema.build(config, "env"), schema.build(config, "feedback")
    assert isinstance(env, Environment)
    assert "any" not in (env.domain, env.setting)  # the check could not tell what fits
    problem = env.problem(feedback.window, (0, 1, 2), "cpu")
    assert problem.replicas == 3
    env.start(problem)
    feedback.start(problem)
    windows, primitive = env.collect(lambda states, step: torch.zeros_like(states), feedback, 4, problem.window)
    assert windows.states.shape == primitive.shape == (3, 4, problem.window)
    assert windows.labels.shape == (3, 4)
    assert windows.primitive is None
    for part in (windows.states, windows.next_states):
        assert ((part >= 0) & (part < problem.states)).all()
    oracle, random = env.oracle(problem, feedback), Random()
    random.start(problem)
    oracle.update(primitive, windows.labels, random)
    assert oracle.truth(problem.cells).shape == (problem.pairs,)
    values = oracle.metrics({}, None)
    assert values
    assert all(value.shape == (3,) for value in values.values())


@pytest.mark.parametrize("name", sorted(registry.options("method")))
def test_methods_run(name: str) -> None:
    experiment = next((experiment for experiment in TABULAR if fits(experiment, f"method={name}")), None)
    if experiment is None:
        pytest.skip("runs on no tabular problem")
    short = ["trainer.steps=280", "trainer.windows_per_round=1", "trainer.log_every=5"]
    config = registry.compose(["tracking=none", f"experiment={experiment}", f"method={name}", *short])
    assert config["method"] == name
    assert config["title"] != name
    trainer: Trainer = schema.build(job.checked(config), "trainer")
    trainer.start((0, 1))
    rows: list[dict[str, torch.Tensor]] = []
    trainer.run(lambda step, values: rows.append(values))
    assert len(trainer.dataset) == 280 // trainer.problem.window
    assert len(rows) == math.ceil(len(trainer.dataset) / 5)
    for values in rows:
        assert all(value.shape == (2,) and torch.isfinite(value).all() for value in values.values()), values


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_an_experiment_takes_every_method_or_says_why_not(name: str) -> None:
    taken = []
    for method in registry.options("method"):
        config = registry.compose(["tracking=none", f"experiment={name}", f"method={method}"])
        assert (config["experiment"], config["method"]) == (name, method)
        found = job.check(config).problems
        assert all(
            "environments only, and env is the" in problem or " needs a" in problem or "written for" in problem
            for problem in found
        ), found
        taken += [] if found else [method]
    assert {"reference", "adaptive_mse", "disagreement", "random", "oracle"} <= set(taken)


@pytest.mark.parametrize("feedback", ["block_sum", "terminal"])
@pytest.mark.parametrize("method", ["reference", "adaptive_mse", "disagreement", "random", "oracle"])
def test_methods_run_in_episodes(method: str, feedback: str) -> None:
    overrides = [f"method={method}", f"feedback={feedback}", "trainer.steps=150", "trainer.windows_per_round=10"]
    config = of_experiment("sepsis", *overrides, "trainer.log_every=10")
    trainer: Trainer = schema.build(config, "trainer")
    trainer.start((0, 1))
    rows: list[dict[str, torch.Tensor]] = []
    trainer.run(lambda step, values: rows.append(values))
    assert len(trainer.dataset) == 30
    assert len(rows) == 3
    for values in rows:
        assert all(value.shape == (2,) and torch.isfinite(value).all() for value in values.values()), values


@pytest.mark.parametrize("kind", sorted({*registry.CHOICES} - {"sweep"}))
def test_choices_compose(kind: str) -> None:
    """Every choice goes with one experiment at least."""
    for name in registry.options(kind):
        experiments = [name] if kind == "experiment" else EXPERIMENTS
        choice = () if kind == "experiment" else (f"{kind}={name}",)
        assert any(fits(experiment, *choice) for experiment in experiments), name
