"""What every registered component owes its kind. A new YAML file is tested here without an edit."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml

from credit import job, registry, schema
from credit.dataset import Dataset
from credit.interfaces import (
    Bonus,
    CreditAssigner,
    Environment,
    FeatureMap,
    Feedback,
    Mixer,
    Optimizer,
    RewardModel,
    TransitionModel,
    Uncertainty,
)
from credit.rewards.linear import all_pairs
from credit.trainer import Trainer
from credit.types import Problem, Windows

MakeWindows = Callable[..., Windows]
SIGNED = {"thompson"}  # a posterior draw lies on either side of the mean
FILES = [(kind, name) for kind in registry.KINDS for name in registry.options(kind)]


def options(kind: str) -> list[str]:
    """Registered names of a kind that may run on a tabular problem."""
    return [name for name in registry.options(kind) if on_tabular(kind, name)]


def on_tabular(kind: str, name: str) -> bool:
    domains = [getattr(cls, "domain", "any") for cls in classes(kind, name)]
    return all(domain in ("any", "tabular") for domain in domains)


def selection(kind: str, name: str) -> list[str]:
    """The override that puts an option where it is used."""
    return {
        "reward": [f"reward@reference={name}"],
        "features": [f"features@reference.features={name}"],
        "bonus": [f"bonus=[{name}]"],
        "tracking": [f"tracking={name}"],
    }.get(kind, [f"{kind}={name}"])


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
        parameters = schema.signature(cls)
        assert node.keys() - {"_target_"} <= parameters.keys()
        for parameter, (hint, default) in parameters.items():
            assert parameter in node or default is not schema.REQUIRED or parameter in slots, parameter
            assert hint is not Any, f"{parameter} has no type hint"


@pytest.mark.parametrize(("kind", "name"), FILES)
def test_every_parameter_is_documented(kind: str, name: str) -> None:
    for cls in classes(kind, name):
        for parameter in schema.signature(cls):
            assert f"{parameter}:" in (cls.__doc__ or ""), parameter


@pytest.mark.parametrize(("kind", "name"), FILES)
def test_defaults_of_constructor_and_file_agree(kind: str, name: str) -> None:
    """The file named like the class's own settings; a variant (with a base in its defaults list) may differ."""
    text = registry.options(kind)[name].read_text(encoding="utf-8")
    bases = (yaml.safe_load(text) or {}).get("defaults", [])
    if any(isinstance(base, str) and base != "_self_" for base in bases):
        return
    for cls, node in zip(classes(kind, name), nodes(kind, name).values(), strict=True):
        for parameter, (_, default) in schema.signature(cls).items():
            if parameter in node and default is not schema.REQUIRED and parameter != "name":
                value = tuple(node[parameter]) if isinstance(default, tuple) else node[parameter]
                assert value == default, parameter


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
        weights = mixer.weights(mse)
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


@pytest.mark.parametrize("name", options("reward"))
def test_reward_models(problem: Problem, make_windows: MakeWindows, name: str) -> None:
    model = built("reward", name)
    assert isinstance(model, RewardModel)
    assert isinstance(model.name, str)
    model.start(problem, 4)
    windows = make_windows(problem, 6)
    shown = Windows(windows.states, windows.actions, windows.next_states, windows.labels, torch.ones(2, 6, 7).double())
    weights = torch.ones(2, 6, 5, dtype=torch.float64)
    for step in (lambda: None, lambda: model.observe(shown, weights), lambda: model.refit(shown, weights)):
        step()
        estimate = model.estimate()
        assert estimate.mean.shape == (2, 30)
        assert estimate.draws.shape == (2, 4, 30)
        assert torch.isfinite(estimate.mean).all()
        assert torch.isfinite(estimate.draws).all()
    assert estimate.mean.abs().max() > 0


@pytest.mark.parametrize("name", options("features"))
def test_feature_maps(problem: Problem, make_windows: MakeWindows, name: str) -> None:
    features = built("features", name)
    assert isinstance(features, FeatureMap)
    features.start(problem)
    table = features(all_pairs(problem))
    assert table.ndim == 2
    assert table.shape[0] == 30
    assert table.dtype == torch.float64
    assert torch.isfinite(table).all()
    windows = make_windows(problem, 3)
    assert torch.equal(features(windows), table[windows.pairs(3)])


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


@pytest.mark.parametrize("name", options("transition"))
def test_transition_models(problem: Problem, make_windows: MakeWindows, name: str) -> None:
    model = built("transition", name)
    assert isinstance(model, TransitionModel)
    model.start(problem)
    windows = make_windows(problem, 8)
    near = (windows.states + windows.next_states % 3 - 1).clamp(0, 9)  # as on a line
    for step in (lambda: None, lambda: model.observe(Windows(windows.states, windows.actions, near, windows.labels))):
        step()
        found = model.probabilities()
        assert found.shape == (2, 10, 3, 10)
        assert (found >= 0).all()
        total = found.sum(-1)
        assert ((total - 1).abs().lt(1e-9) | total.eq(0)).all()
    again = built("transition", name)
    again.start(problem)
    again.observe(Windows(windows.states[:, :5], windows.actions[:, :5], near[:, :5], windows.labels[:, :5]))
    again.observe(Windows(windows.states[:, 5:], windows.actions[:, 5:], near[:, 5:], windows.labels[:, 5:]))
    torch.testing.assert_close(again.probabilities(), found)


@pytest.mark.parametrize("name", options("assigner"))
def test_assigners(problem: Problem, make_windows: MakeWindows, name: str) -> None:
    assigner, dataset = trained(problem, make_windows, "method=disagreement", f"assigner={name}")
    assert isinstance(assigner, CreditAssigner)
    rewards = assigner.rewards(dataset.windows)
    assert rewards.shape == (2, 15, 7)
    assert torch.isfinite(rewards).all()
    if not hasattr(assigner, "recovery"):  # a redistribution gives out the label, no more and no less
        torch.testing.assert_close(rewards.sum(-1), dataset.windows.labels)


@pytest.mark.parametrize("name", options("optimizer"))
def test_optimizers(problem: Problem, make_windows: MakeWindows, name: str) -> None:
    optimizer = built("optimizer", name)
    assert isinstance(optimizer, Optimizer)
    assigner, dataset = trained(problem, make_windows, "method=disagreement")
    optimizer.start(problem)
    for learned in (False, True):
        if learned:
            optimizer.improve(dataset, assigner)
        for step in range(problem.window):
            actions = optimizer.act(torch.tensor([step, 9 - step]), step)
            assert actions.shape == (2,)
            assert actions.dtype == torch.int64
            assert ((actions >= 0) & (actions < 3)).all()
        for policy in optimizer.policies().values():
            assert policy.shape == (2, 10)
            assert ((policy >= 0) & (policy < 3)).all()


@pytest.mark.parametrize("name", options("env"))
def test_environments(name: str) -> None:
    config = composed("env", name)
    env, feedback = schema.build(config, "env"), schema.build(config, "feedback")
    assert isinstance(env, Environment)
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
    oracle = env.oracle(problem)
    oracle.update(primitive, windows.labels)
    values = oracle.metrics({}, None)
    assert values
    assert all(value.shape == (3,) for value in values.values())


@pytest.mark.parametrize("name", sorted(registry.options("method")))
def test_methods_run(name: str) -> None:
    config = registry.compose(["tracking=none", f"method={name}", "trainer.steps=140", "trainer.log_every=5"])
    assert config["method"] == name
    assert config["title"] != name
    trainer: Trainer = schema.build(job.checked(config), "trainer")
    trainer.start((0, 1))
    rows: list[dict[str, torch.Tensor]] = []
    trainer.run(lambda step, values: rows.append(values))
    assert len(trainer.dataset) == 20
    assert len(rows) == 4
    for values in rows:
        assert all(value.shape == (2,) and torch.isfinite(value).all() for value in values.values()), values


@pytest.mark.parametrize("name", sorted(registry.options("experiment")))
def test_experiments_compose_with_every_method(name: str) -> None:
    for method in registry.options("method"):
        config = registry.compose(["tracking=none", f"experiment={name}", f"method={method}"])
        assert job.check(config).problems == []
        assert (config["experiment"], config["method"]) == (name, method)


@pytest.mark.parametrize("kind", sorted(registry.CHOICES))
def test_choices_compose(kind: str) -> None:
    for name in registry.options(kind):
        assert job.check(registry.compose(["tracking=none", f"{kind}={name}"])).problems == []
