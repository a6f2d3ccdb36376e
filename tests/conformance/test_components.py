"""What every registered component owes its kind, on every experiment that it goes with. A new YAML file is tested here
without an edit, and so is a new experiment."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import torch

from credit.agents.random import Random
from credit.config import files, kinds, registry, schema, signatures
from credit.config.identity import plain
from credit.core.errors import UserError
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
from credit.runs import job
from credit.trainer import Trainer

SEEDS = (3, 4)
SIGNED = {"thompson"}  # a posterior draw lies on either side of the mean
EVERY = sorted(files.options("experiment").keys() - {"generic"})  # which has no environment of its own
EXPERIMENTS = [name for name in EVERY if not name.endswith("_paper")]  # which are others with another recipe
FILES = [(kind, name) for kind in kinds.KINDS for name in files.options(kind)]
FEW = {"first_steps": 4, "steps": 2, "updates": 4, "first_updates": 6, "width": 8, "batch": 8, "stride": 3}
SMALL: dict[str, dict[str, Any]] = {  # what makes an environment quick: two free cells, few demonstrations
    "PointMaze": {"env": {"maze": ["1111", "1001", "1111"], "start": [1, 1], "goal": [1, 2], "successes": 2}},
}
SMALL["PointMaze"]["env"] |= {"partials": 0, "failures": 1, "evaluation_episodes": 2}
SMALL["PointMaze"]["feedback"] = {"window": 40}
SHORT = {"windows_per_round": 2, "first_windows": 0, "random_windows": 0, "log_every": 4}
WINDOWS = 6  # of a short run


@cache
def composed(*overrides: str) -> dict[str, Any]:
    """The whole configuration of a short run, made small; not to be changed."""
    config = registry.compose(["tracking=none", *overrides])
    if changes := SMALL.get(schema.resolve("env", config["env"]).__name__):
        config = _less(config) | {slot: config[slot] | keys for slot, keys in changes.items()}
    trainer = config["trainer"] | SHORT | {"steps": WINDOWS * config["feedback"]["window"]}
    return config | {"trainer": trainer}


def _less(node: Any) -> Any:
    """The same configuration with less work in it."""
    if isinstance(node, Mapping):
        return {key: FEW[key] if key in FEW else _less(value) for key, value in node.items()}
    return node


@cache
def checked(*overrides: str) -> tuple[list[str], set[str]]:
    """What is wrong with some overrides, and the slots that they use."""
    try:
        found = job.check(composed(*overrides))
    except UserError as error:  # there is nothing where an option would go
        return [str(error)], set()
    return list(found.problems), found.used


def problems_of(*overrides: str) -> list[str]:
    return checked(*overrides)[0]


def selection(kind: str, name: str) -> list[str]:
    """The override that puts an option where it is used."""
    return {
        "reward": [f"reward@reference={name}"],
        "features": [f"features@reference.features={name}"],
        "bonus": [f"bonus=[{name}]"],
        "tracking": [f"tracking={name}"],
    }.get(kind, [f"{kind}={name}"])


def goes_with(kind: str, name: str) -> Iterator[tuple[str, ...]]:
    """The overrides of every experiment that an option goes with."""
    for experiment in EXPERIMENTS:
        for way in (("method=disagreement",), ("method=reference",), ("method=reference", "reward@reference=linear")):
            words = (f"experiment={experiment}", *way, *selection(kind, name))
            problems, used = checked(*words)
            if not problems and {"reward": "reference", "features": "reference"}.get(kind, kind) in used:
                yield words
                break


def options(kind: str) -> list[Any]:
    """Registered names of a kind."""
    return sorted(files.options(kind))


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
    inform([inner for _, inner in parts_of(part)], knowledge)
    return part, problem, store


def assigned(words: tuple[str, ...]) -> tuple[Any, Problem, Store]:
    """A credit assigner that has seen some windows."""
    assigner, problem, store = built(words, "assigner")
    assigner.start(problem)
    assigner.observe(store)
    return assigner, problem, store


def nodes(kind: str, name: str) -> dict[str, Any]:
    """Path → configuration of the components that an option makes."""
    config = registry.compose(["tracking=none", *selection(kind, name)])
    if kind == "features":
        return {"reference.features": config["reference"]["features"]}
    return schema.members(config, "reference" if kind == "reward" else kind)


def classes(kind: str, name: str) -> list[type]:
    return [schema.resolve(path, node) for path, node in nodes(kind, name).items()]


def some(kind: str, name: str) -> list[tuple[str, ...]]:
    """Every experiment that an option goes with; there must be one."""
    found = list(goes_with(kind, name))
    assert found, f"{kind}={name} goes with no experiment"
    return found


@pytest.mark.parametrize(("kind", "name"), FILES)
def test_class_kind_and_words(kind: str, name: str) -> None:
    assert files.describe_file(files.options(kind)[name])
    for cls in classes(kind, name):
        assert issubclass(cls, kinds.KINDS[kind].load())
        assert not inspect.isabstract(cls)
        assert cls.__doc__
        assert cls.__doc__.strip().splitlines()[0].strip()


@pytest.mark.parametrize(("kind", "name"), FILES)
def test_every_parameter_has_a_value_and_every_key_a_parameter(kind: str, name: str) -> None:
    slots = {slot for other in kinds.KINDS.values() for slot in other.slots}
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
def written() -> dict[type, list[dict[str, Any]]]:
    """Class → what each of its files says."""
    found: dict[type, list[dict[str, Any]]] = {}
    for kind, name in FILES:
        node = files.read(files.options(kind)[name])
        if "_target_" in node:
            found.setdefault(schema.resolve(name, node), []).append(node)
    return found


@pytest.mark.parametrize("cls", written(), ids=lambda cls: cls.__name__)
def test_a_default_has_one_spelling(cls: type) -> None:
    """The constructor's is that of the file; of a class with several recipes, that of one of them."""
    for parameter, (hint, default) in signatures.signature(cls).items():
        values = [plain(node[parameter]) for node in written()[cls] if parameter in node]
        if values and default is not signatures.REQUIRED and not signatures.component_kind(hint):
            assert plain(default) in values, parameter
            assert len(written()[cls]) > 1 or values == [plain(default)], parameter


@pytest.mark.parametrize(("kind", "name"), FILES)
def test_a_variant_says_what_differs_and_nothing_else(kind: str, name: str) -> None:
    node = files.read(files.options(kind)[name])
    for base in files.bases(kind, node):
        before = registry.compose(["tracking=none", *selection(kind, base)])
        now = registry.compose(["tracking=none", *selection(kind, name)])
        slot = "reference" if kind == "reward" else kind
        for key in node.keys() - {"defaults", "_target_"}:
            there, here = (next(iter(schema.members(config, slot).values())) for config in (before, now))
            assert there.get(key, "…") != here[key], key


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
    assert keys_without_comment(files.options(kind)[name]) == []


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
def test_bonuses(name: str) -> None:
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
def test_reward_models(name: str) -> None:
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
def test_feature_maps(name: str) -> None:
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
def test_uncertainties(name: str) -> None:
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
def test_transition_models(name: str) -> None:
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
def test_assigners(name: str) -> None:
    for words in some("assigner", name):
        assigner, _, store = assigned(words)
        assert isinstance(assigner, CreditAssigner)
        windows = store.windows
        rewards = assigner.rewards(windows)
        assert rewards.shape == windows.states.shape[:2]
        assert torch.isfinite(rewards).all()
        if assigner.belief() is None:  # a redistribution gives out the label, no more and no less
            torch.testing.assert_close(windows.sums(rewards), windows.labels)


@pytest.mark.parametrize("name", options("optimizer"))
def test_agents(name: str) -> None:
    for words in some("optimizer", name):
        agent, problem, store = built(words, "optimizer")
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


@pytest.mark.parametrize("method", options("method"))
def test_methods_run(method: str) -> None:
    """On the first experiment that takes them; every row of the journal is whole."""
    found = (e for e in EXPERIMENTS if not problems_of(f"experiment={e}", f"method={method}"))
    experiment = next(found, None)
    assert experiment is not None, f"no experiment takes {method}"
    rows = run(f"experiment={experiment}", f"method={method}")
    assert rows
    for values in rows:
        assert all(value.shape == (2,) for value in values.values())
        known = {
            name: value for name, value in values.items() if not name.startswith(("policy/", "eval/", "optimizer/"))
        }
        assert all(torch.isfinite(value).all() for value in known.values() if name_is_of_run(known)), values


def name_is_of_run(values: Mapping[str, Any]) -> bool:
    return "regret/cumulative" in values  # rollouts know nothing before the first round


def run(*words: str) -> list[dict[str, torch.Tensor]]:
    config = composed(*words)
    trainer: Trainer = schema.build(job.checked(config), "trainer")
    trainer.start(SEEDS)
    rows: list[dict[str, torch.Tensor]] = []
    trainer.run(lambda step, values: rows.append(values))
    assert trainer.collected == WINDOWS
    return rows


@pytest.mark.parametrize("feedback", ["block_sum", "terminal"])
@pytest.mark.parametrize("method", ["reference", "adaptive_mse", "disagreement", "random", "oracle"])
def test_methods_run_in_episodes(method: str, feedback: str) -> None:
    rows = run("experiment=sepsis", f"method={method}", f"feedback={feedback}")
    for values in rows:
        assert all(value.shape == (2,) and torch.isfinite(value).all() for value in values.values()), values


@pytest.mark.parametrize("name", EVERY)
def test_an_experiment_takes_every_method_or_says_why_not(name: str) -> None:
    taken = []
    for method in files.options("method"):
        config = registry.compose(["tracking=none", f"experiment={name}", f"method={method}"])
        assert (config["experiment"], config["method"]) == (name, method)
        found = job.check(config).problems
        said = (" needs ", "written for", "is made for")
        assert all(any(words in problem for words in said) for problem in found), found
        taken += [] if found else [method]
    assert {"reference", "adaptive_mse", "disagreement", "random", "oracle"} <= set(taken)


@pytest.mark.parametrize("kind", sorted({*kinds.CHOICES} - {"sweep"}))
def test_choices_compose(kind: str) -> None:
    """Every choice goes with one experiment at least."""
    for name in files.options(kind):
        if name == "generic":
            continue
        experiments = [name] if kind == "experiment" else EXPERIMENTS
        choice = () if kind == "experiment" else (f"{kind}={name}",)
        assert any(not problems_of(f"experiment={experiment}", *choice) for experiment in experiments), name
