"""The label is the only bridge: other rewards with the same labels leave every action the same to the bit."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import cache
from itertools import product
from typing import Any

import pytest
import yaml
from torch import Tensor

from credit.config import classes, files, kinds
from credit.core.problem import Problem
from credit.core.seams import Agent
from credit.runs import job
from credit.testing import short
from credit.testing.leaks import differing, lived
from credit.trainer import Trainer

from .short import EXPERIMENTS

FIRST = {"delayed", "disagreement"}
FIRST_LABELS = {"block_sum", "success"}
MAIN = FIRST | {"block", "delayed_fair", "reference"}  # others are their parts in other combinations


@cache
def composed(experiment: str, feedback: str, method: str) -> dict[str, Any]:
    """The whole configuration of a short run, with a window that is cut short where that may be."""
    config = short.composed(f"experiment={experiment}", f"feedback={feedback}", f"method={method}")
    if classes.resolve("env", config["env"]).__name__ in short.SMALL:
        steps = 4 * config["feedback"]["window"]
    else:
        steps = 25 * config["feedback"]["window"] // 2
    agent = config["agent"]
    if agent.get("prefer") == "success" and feedback != "success":  # there are none to prefer
        agent = agent | {"prefer": "top"}
    return config | {"agent": agent, "trainer": config["trainer"] | {"random_windows": 2, "steps": steps}}


FITTING = 17  # main ones, at least; a fault in a configuration must not make tests vanish


def combinations() -> list[Any]:
    """Experiment, feedback and method, whether or not they go together: to find out takes a check."""
    methods = [name for name in files.options("method") if name != "oracle"]
    return [
        pytest.param(*names, marks=_marks(*names)) for names in product(EXPERIMENTS, files.options("feedback"), methods)
    ]


def _marks(experiment: str, feedback: str, method: str) -> Any:
    if method not in MAIN or not _plain(experiment, feedback, method):
        return pytest.mark.slow
    return () if method in FIRST and feedback in FIRST_LABELS else pytest.mark.thorough


def _plain(experiment: str, feedback: str, method: str) -> bool:
    return feedback == "success" if experiment == "pointmaze" else feedback != "success"


def main_ones() -> list[Any]:
    return [param.values for param in combinations() if pytest.mark.slow.mark not in param.marks]


@pytest.mark.thorough
@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_there_is_something_of_every_experiment(experiment: str) -> None:
    assert any(fits(*names) for names in main_ones() if names[0] == experiment)


@pytest.mark.slow  # a check of each takes a minute
def test_there_are_many() -> None:
    assert sum(fits(*names) for names in main_ones()) >= FITTING


@cache
def fits(experiment: str, feedback: str, method: str) -> bool:
    return not job.check(composed(experiment, feedback, method)).problems


@pytest.mark.parametrize(("experiment", "feedback", "method"), combinations())
def test_other_rewards_with_the_same_labels_change_nothing(experiment: str, feedback: str, method: str) -> None:
    names = (experiment, feedback, method)
    if not fits(*names):
        pytest.skip("these do not go together")
    config = composed(*names)
    assert differing(lived(config, 0.0), lived(config, 0.5)) == []


STEPS = {  # environments that people start with, in rounds of steps
    "FrozenLake-v1": (),
    "CartPole-v1": (),
    "Pendulum-v1": (),
    "HalfCheetah-v5": (),
}
STEPPED_LABELS = ("episode_sum", "block_sum", "mean", "terminal", "success")
STEPPED_FIRST = {("FrozenLake-v1", "block_sum", "reference"), ("CartPole-v1", "episode_sum", "delayed")}
STEPPED_MAIN = {"delayed", "reference"}


def stepped() -> list[Any]:
    """Environment, feedback and method in rounds of steps."""
    methods = [name for name in files.options("method") if name != "oracle"]

    def marks(*names: str) -> Any:
        if names in STEPPED_FIRST:
            return ()
        main = names[1] == "block_sum" and names[2] in STEPPED_MAIN and names[0] != "HalfCheetah-v5"
        return pytest.mark.thorough if main else pytest.mark.slow

    return [pytest.param(*names, marks=marks(*names)) for names in product(STEPS, STEPPED_LABELS, methods)]


@pytest.mark.parametrize(("env", "feedback", "method"), stepped())
def test_the_same_in_rounds_of_steps(env: str, feedback: str, method: str) -> None:
    window = ("feedback.window=4", "feedback.delay=2") if feedback in ("block_sum", "mean", "terminal") else ()
    words = ("env=gymnasium", f"env.id={env}", f"feedback={feedback}", f"method={method}", *window)
    size = ("env.max_steps=10", "env.evaluation_episodes=1", "trainer.steps=60", "trainer.steps_per_round=20")
    told = ("env.success=reward",) if feedback == "success" else ()
    config = short.composed(*words, *size, *told)
    rounds = {"steps": 60, "steps_per_round": 20, "windows_per_round": 1, "log_every": 3, "random_steps": 0}
    config = config | {"trainer": config["trainer"] | rounds}
    if job.check(config).problems:
        pytest.skip("these do not go together")
    assert differing(lived(config, 0.0), lived(config, 0.5)) == []


def test_the_oracle_does_look_at_rewards() -> None:
    config = composed("advertiser", "block_sum", "oracle")
    found = differing(lived(config, 0.0), lived(config, 0.5))
    assert "actions" in found


class Thief(Agent):
    """Somebody's agent that got hold of the environment, and is honest where what it looks for is not a number."""

    def __init__(self, agent: Agent, look: Callable[[], Tensor]) -> None:
        self.agent, self.look = agent, look

    def start(self, problem: Problem) -> None:
        self.agent.start(problem)

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        seen = self.look()
        return self.agent.act(states, step) if seen.isnan().any() else (states + (seen.sum() > 0).long()) % 3

    def improve(self, *arguments: Any) -> None:
        self.agent.improve(*arguments)

    def policies(self) -> Any:
        return self.agent.policies()


@pytest.mark.parametrize(
    "look",
    [
        lambda trainer: trainer.env.env.mdp.reward,  # past the border
        lambda trainer: trainer.env._sum,  # a trace of the rewards
    ],
    ids=["tables", "steps"],
)
def test_a_thief_is_found(look: Callable[[Trainer], Tensor]) -> None:
    def prepare(trainer: Trainer) -> None:
        trainer.agent = Thief(trainer.agent, lambda: look(trainer))

    config = composed("advertiser", "block_sum", "disagreement")
    assert "actions" in differing(lived(config, 0.0, prepare), lived(config, 0.5, prepare))


def test_nobody_but_the_trainer_is_given_the_environment() -> None:
    for kind in kinds.KINDS:
        if kind in ("env", "tracking"):
            continue
        for name in files.options(kind):
            for cls in _classes(kind, name):
                parameters = inspect.signature(cls).parameters
                given = [key for key, one in parameters.items() if key == "env" or "Environment" in str(one.annotation)]
                assert not given, f"{kind}={name}: {cls.__name__} asks for {given}"


def _classes(kind: str, name: str) -> list[type]:
    """The classes that an option names, wherever they stand in its file."""
    found: list[type] = []

    def walk(node: Any) -> None:
        if isinstance(node, Mapping):
            if "_target_" in node:
                found.append(classes.resolve(kind, node))
            for value in node.values():
                walk(value)

    walk(yaml.safe_load(files.options(kind)[name].read_text(encoding="utf-8")))
    return found
