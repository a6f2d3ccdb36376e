"""The label is the only bridge: another reward function with the same labels leaves every action the same to the bit.

The other rewards are finite, so that no mask of NaN hides a leak, and they are in all places where a learner could look
for them: in steps, in demonstrations, and in the environment's own tables.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from itertools import product
from typing import Any

import pytest
import torch
import yaml
from torch import Tensor

from credit.config import files, kinds, schema
from credit.core.problem import Problem
from credit.core.seams import Agent, Environment, Transitions
from credit.core.truth import Truth
from credit.core.windows import Windows
from credit.runs import job
from credit.trainer import Trainer

from . import short
from .short import EXPERIMENTS, SEEDS

MAIN = {"block", "delayed", "delayed_fair", "disagreement", "reference"}  # others are their parts in other combinations


class Moved(Environment):
    """An environment with another reward function, whose windows have the same labels.

    Rewards are rounded to multiples of 2⁻²⁰, so that sums of them are exact, and move by `amount` in a way that the
    label cannot show: by amounts that cancel in each window where it is their sum, in all steps but the last where it
    is that one, and by a positive factor where it says whether any was positive.

    Args:
        env: whose steps. objective: of the feedback. amount: 0 for no move.
    """

    def __init__(self, env: Environment, objective: str, amount: float) -> None:
        self.env, self.objective, self.amount = env, objective, amount
        for name in ("copies", "ends_early", "evaluation_episodes", "observations", "actions", "setting"):
            setattr(self, name, getattr(env, name))

    def problem(self, window: int, seeds: tuple[int, ...], device: torch.device | str) -> Problem:
        return self.env.problem(window, seeds, device)

    def start(self, problem: Problem, copies: int = 1, purpose: str = "environment") -> None:
        self.env.start(problem, copies, purpose)
        self._last, self._t = problem.window - 1, 0
        self._sum = problem.zeros(copies)
        if self.amount and hasattr(self.env, "mdp"):
            mdp = self.env.mdp
            name = "reward_next" if hasattr(mdp, "reward_next") else "reward"
            self.env.__dict__["mdp"] = replace(mdp, **{name: -getattr(mdp, name)})

    def twin(self) -> Moved:
        return Moved(self.env.twin(), self.objective, self.amount)

    def reset(self, mask: Tensor | None = None) -> Tensor:
        self._t, self._sum = 0, torch.zeros_like(self._sum)
        return self.env.reset(mask)

    def step(self, actions: Tensor, mask: Tensor | None = None) -> Transitions:
        out = self.env.step(actions, mask)
        ends = torch.full_like(self._sum, self._t == self._last, dtype=torch.bool)
        for over in (out.terminated, out.truncated):
            ends = ends if over is None else ends | over
        exact = (out.rewards * 2**20).round() / 2**20
        self._t = 0 if self._t == self._last else self._t + 1
        return out._replace(rewards=self._moved(exact, ends))

    def _moved(self, rewards: Tensor, ends: Tensor) -> Tensor:
        if self.objective == "success":
            return rewards * (1 + self.amount)
        if self.objective == "last":
            return torch.where(ends, rewards, rewards + self.amount)
        assert self.objective == "sum"
        by = torch.where(ends, -self._sum, self.amount)
        self._sum = torch.where(ends, 0.0, self._sum + by)
        return rewards + by

    def demonstrations(self) -> tuple[Windows, Tensor] | None:
        found = self.env.demonstrations()
        return None if found is None else (found[0], found[1] + self.amount)

    def knowledge(self) -> Any:
        return self.env.knowledge()

    def truth(self, objective: str, window: int) -> Truth | None:
        return self.env.truth(objective, window)


@cache
def composed(experiment: str, feedback: str, method: str) -> dict[str, Any]:
    """The whole configuration of a short run, with a window that is cut short where that may be."""
    config = short.composed(f"experiment={experiment}", f"feedback={feedback}", f"method={method}")
    if schema.resolve("env", config["env"]).__name__ in short.SMALL:
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
        pytest.param(*names, marks=() if names[2] in MAIN and _plain(*names) else pytest.mark.slow)
        for names in product(EXPERIMENTS, files.options("feedback"), methods)
    ]


def _plain(experiment: str, feedback: str, method: str) -> bool:
    return feedback == "success" if experiment == "pointmaze" else feedback != "success"


def test_there_is_something_of_every_experiment() -> None:
    main = [param.values for param in combinations() if not param.marks]
    found = [names for names in main if fits(*names)]
    assert len(found) >= FITTING
    assert {names[0] for names in found} == set(EXPERIMENTS)


@cache
def fits(experiment: str, feedback: str, method: str) -> bool:
    return not job.check(composed(experiment, feedback, method)).problems


def started(names: tuple[str, str, str], amount: float, prepare: Callable[[Trainer], None] = lambda t: None) -> Trainer:
    trainer: Trainer = schema.build(composed(*names), "trainer")
    trainer.env = Moved(trainer.env, trainer.feedback.objective, amount)
    prepare(trainer)
    trainer.start(SEEDS)
    return trainer


def lived(names: tuple[str, str, str], amount: float, prepare: Callable[[Trainer], None] = lambda t: None) -> Windows:
    """All that a run collected and was told."""
    trainer = started(names, amount, prepare)
    trainer.run(lambda step, values: None)
    return trainer.store.windows


def differing(one: Windows, other: Windows) -> list[str]:
    """Names of what is not the same to the bit."""
    columns = {name: value for name, value in vars(one).items() if isinstance(value, Tensor) and name != "primitive"}
    assert {"states", "actions", "labels"} <= columns.keys()
    return [name for name, value in columns.items() if not torch.equal(value, getattr(other, name))]


@pytest.mark.parametrize(("experiment", "feedback", "method"), combinations())
def test_other_rewards_with_the_same_labels_change_nothing(experiment: str, feedback: str, method: str) -> None:
    names = (experiment, feedback, method)
    if not fits(*names):
        pytest.skip("these do not go together")
    assert differing(lived(names, 0.0), lived(names, 0.5)) == []


def test_the_oracle_does_look_at_rewards() -> None:
    names = ("advertiser", "block_sum", "oracle")
    found = differing(lived(names, 0.0), lived(names, 0.5))
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

    names = ("advertiser", "block_sum", "disagreement")
    assert "actions" in differing(lived(names, 0.0, prepare), lived(names, 0.5, prepare))


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
                found.append(schema.resolve(kind, node))
            for value in node.values():
                walk(value)

    walk(yaml.safe_load(files.options(kind)[name].read_text(encoding="utf-8")))
    return found
