"""What every registered component owes its kind, on every experiment that it goes with. A new YAML file is tested here
without an edit, and so is a new experiment."""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice

import pytest

from credit.config import files, schema
from credit.testing import learners, models, runs, worlds
from credit.testing.cases import Case, of_option
from credit.testing.short import composed
from credit.testing.suite import OF_KIND

from .short import EXPERIMENTS, options

Some = Callable[[str, str], list[Case]]
SIGNED = {"thompson"}  # a posterior draw lies on either side of the mean


@pytest.fixture(params=["first", pytest.param("every", marks=pytest.mark.slow)])
def some(request: pytest.FixtureRequest) -> Some:
    """The first experiment that an option goes with, and among the slow tests every one; there must be one."""

    def of(kind: str, name: str) -> list[Case]:
        cases = (case for case in of_option(kind, name) if isinstance(case, Case))
        found = list(islice(cases, 1 if request.param == "first" else None))
        assert found, f"{kind}={name} goes with no experiment"
        return found

    return of


@pytest.mark.parametrize("name", sorted(files.options("mixer")))
@pytest.mark.parametrize("count", models.MODELS)
def test_mixers(name: str, count: int) -> None:
    models.weighs(schema.build(composed(f"mixer={name}"), "mixer"), count)


@pytest.mark.parametrize("name", options("bonus"))
def test_bonuses(some: Some, name: str) -> None:
    for case in some("bonus", name):
        models.bonus(case)
        assert name in SIGNED or all((value >= 0).all() for value in models.bonuses(case).values())


@pytest.mark.parametrize("name", options("reward"))
def test_reward_models(some: Some, name: str) -> None:
    for case in some("reward", name):
        models.reward(case)


@pytest.mark.parametrize("name", options("features"))
def test_feature_maps(some: Some, name: str) -> None:
    for case in some("features", name):
        models.features(case)


@pytest.mark.parametrize("name", options("uncertainty"))
def test_uncertainties(some: Some, name: str) -> None:
    for case in some("uncertainty", name):
        models.uncertainty(case)


@pytest.mark.parametrize("name", options("scaler"))
def test_scalers(name: str) -> None:
    models.scales(schema.build(composed("experiment=pointmaze", f"scaler={name}"), "scaler"))


@pytest.mark.parametrize("name", options("transition"))
def test_transition_models(some: Some, name: str) -> None:
    for case in some("transition", name):
        learners.transition(case)


@pytest.mark.parametrize("name", options("assigner"))
def test_assigners(some: Some, name: str) -> None:
    for case in some("assigner", name):
        learners.assigner(case)


@pytest.mark.parametrize("name", options("agent"))
def test_agents(some: Some, name: str) -> None:
    for case in some("agent", name):
        learners.agent(case)


@pytest.mark.parametrize("name", options("encoder"))
def test_encoders(some: Some, name: str) -> None:
    for case in some("encoder", name):
        learners.encoder(case)


@pytest.mark.parametrize("name", options("network"))
def test_networks(some: Some, name: str) -> None:
    for case in some("network", name):
        learners.network(case)


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_environments(experiment: str) -> None:
    config = composed(f"experiment={experiment}")
    worlds.environment(Case("env", experiment, experiment, config))


@pytest.mark.parametrize("name", options("feedback"))
def test_feedback(some: Some, name: str) -> None:
    for case in some("feedback", name):
        worlds.feedback(case)


SEVERAL = [
    pytest.param(kind, name, marks=() if kind == "mixer" else pytest.mark.slow)
    for kind in OF_KIND
    for name in files.options(kind)
    if kind != "env"
]


@pytest.mark.parametrize(("kind", "name"), SEVERAL)
def test_a_replica_does_the_same_again_and_alone(kind: str, name: str) -> None:
    case = next(case for case in of_option(kind, name) if isinstance(case, Case))
    runs.repeats(case)
    runs.alone(case)
