"""Where a component is tried: the experiments that it goes with, and what happened in them before it came."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import torch

from credit.agents.random import Random
from credit.config import registry, schema
from credit.config.fitting import key_of
from credit.core import contracts
from credit.core.capabilities import parts_of
from credit.core.errors import UserError
from credit.core.knowledge import inform
from credit.core.problem import FLOAT, Problem
from credit.core.store import Store
from credit.envs.collect import Collector
from credit.rounds import problem_of
from credit.runs import job
from credit.testing.short import SEEDS, composed, experiments, selection, small
from credit.trainer import Trainer

SLOTS = {
    "reward": "reference",
    "features": "reference",
    "network": "reference",
}  # of kinds that have none of their own name
RIDGE = "reward@reference=linear"  # a reference of whatever features
EPISODES = ("feedback=episode_sum", "feedback.window=null")  # where they have a length of their own
WAYS: dict[str, tuple[tuple[str, ...], ...]] = {  # what an option may need around it, beside its experiment
    "env": (
        ("method=disagreement",),
        ("method=reference",),
        ("method=reference", *EPISODES),
        ("method=reference", *EPISODES, "agent.prefer=top"),
        ("method=delayed", "agent=dqn"),
        ("method=delayed", "agent=dqn", *EPISODES),
    ),
    "feedback": (("method=disagreement",), ("method=disagreement", "agent.prefer=top"), ("method=random",)),
    "agent": (("method=disagreement",), ("method=reference",), ("method=delayed",)),
    "network": (("method=reference", "reward@reference=dnn", "uncertainty=ensemble"),),
}
LAST: dict[str, tuple[tuple[str, ...], ...]] = {  # what is better than nothing
    "env": (("method=random",), ("method=random", *EPISODES)),
}
OTHERS = (("method=disagreement",), ("method=reference",), ("method=reference", RIDGE))
WORLDS = ("env", "feedback")  # kinds that decide what happens


@dataclass(frozen=True)
class Case:
    """A short run in which a component is used.

    Attributes:
        kind: of the component. name: what messages call it. experiment: whose run it is.
        config: of the run, whole and right.
    """

    kind: str
    name: str
    experiment: str
    config: Mapping[str, Any] = field(repr=False)

    def built(self, slot: str) -> tuple[Any, Problem, Store]:
        """What the run has in a slot, informed, watched and not yet started; and experience in its experiment."""
        problem, store, knowledge = self.experience()
        part = schema.build(self.config, slot)
        parts = list(parts_of(part, slot))
        inform(parts, knowledge)
        for path, inner in parts:
            contracts.watch(inner, problem, key_of(path))
        return part, problem, store

    def assigned(self) -> tuple[Any, Problem, Store]:
        """A credit assigner that has seen some windows."""
        assigner, problem, store = self.built("assigner")
        assigner.start(problem)
        assigner.observe(store)
        return assigner, problem, store

    def experience(self) -> tuple[Problem, Store, Any]:
        """The problem, windows of random actions in it, and what is known of it."""
        if self.kind in WORLDS:
            return experienced(self.config)
        return _of_experiment(self.experiment)


def experienced(config: Mapping[str, Any]) -> tuple[Problem, Store, Any]:
    """The problem of a configuration with two replicas, windows of random actions in it, and what is known of it."""
    env, feedback, random = schema.build(config, "env"), schema.build(config, "feedback"), Random()
    problem = problem_of(env, feedback, SEEDS, "cpu", rolling=False)
    for part in (env, feedback, random):
        part.start(problem)
    windows, primitive = Collector(env, feedback, problem).collect(random, 15 if problem.tabular else 4)
    if not problem.tabular:  # labels that they did not earn
        windows = replace(windows, labels=torch.tensor([[0.0, 1.0, 1.0, 0.0]] * 2, dtype=FLOAT))
    store = Store(problem)
    store.append(replace(windows, primitive=primitive))
    return problem, store, env.knowledge()


@cache
def _of_experiment(experiment: str) -> tuple[Problem, Store, Any]:
    return experienced(composed(f"experiment={experiment}"))


def of_option(kind: str, name: str) -> Iterator[Case | str]:
    """A case for every experiment that an option goes with, or what is wrong with it there."""

    def config(experiment: str, way: tuple[str, ...]) -> dict[str, Any]:
        return composed(f"experiment={experiment}", *way, *selection(kind, name))

    return _cases(kind, name, config)


def of_node(kind: str, name: str, node: Mapping[str, Any]) -> Iterator[Case | str]:
    """The same of a component whose file is not written.

    Args:
        kind: whose place it takes. name: of its class. node: what makes it.
    """

    def config(experiment: str, way: tuple[str, ...]) -> dict[str, Any]:
        return small(placed(kind, node, registry.compose(["tracking=none", f"experiment={experiment}", *way])))

    return _cases(kind, name, config)


def _cases(kind: str, name: str, config_of: Callable[[str, tuple[str, ...]], dict[str, Any]]) -> Iterator[Case | str]:
    said: dict[str, str] = {}  # experiment → why not, the last that was tried
    for ways in (WAYS.get(kind, OTHERS), LAST.get(kind, ())):
        fitting = False
        for experiment in experiments():
            for way in ways:
                try:
                    config = config_of(experiment, way)
                except UserError as error:  # there is nothing where a word of the way would go
                    said[experiment] = str(error)
                    continue
                found, used = misfits(config)
                if not found and SLOTS.get(kind, kind) in used:
                    fitting = True
                    yield Case(kind, name, experiment, config)
                    break
                said[experiment] = found[-1] if found else "nothing there asks for it"
        if fitting:
            return
    yield from (f"{experiment}: {why}" for experiment, why in said.items())


def placed(kind: str, node: Mapping[str, Any], config: Mapping[str, Any]) -> dict[str, Any]:
    """A configuration with a component in the place of another of its kind."""
    if kind in ("features", "network"):
        return {**config, "reference": {**config["reference"], kind: node}}
    if kind == "bonus":
        return {**config, "bonus": {"tried": node}}
    return {**config, SLOTS.get(kind, kind): node}


def misfits(config: Mapping[str, Any]) -> tuple[list[str], set[str]]:
    """What does not go together in a configuration, and the slots that it uses; what breaks, checks find."""
    found = job.schema_of(config)
    if found.problems:
        return found.problems, found.used
    try:
        trainer: Trainer = schema.build(config, "trainer")
        trainer.start(SEEDS)
    except UserError as error:
        return [str(error)], found.used
    except Exception:
        return [], found.used
    return [], found.used
