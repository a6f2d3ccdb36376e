"""Knowledge goes to those that ask for it, and to nobody else; what knows one environment refuses others."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any, ClassVar

import pytest
import torch

from credit.core.component import Component
from credit.core.errors import UserError
from credit.core.knowledge import inform
from credit.core.problem import Problem
from credit.envs.advertiser.environment import Advertiser
from credit.envs.advertiser.shift import ShiftMixture
from credit.envs.pointmaze.environment import PointMaze
from credit.envs.pointmaze.features import MazeCells, MazeGeometry
from credit.envs.sepsis.environment import Sepsis
from credit.envs.sepsis.factored import FactoredMixture
from credit.envs.sepsis.features import Clinical, HealthRegime, Patient
from credit.planning.counts import Counts
from credit.planning.exact import Exact

ENVIRONMENTS: dict[str, Any] = {"Advertiser": Advertiser(), "Sepsis": Sepsis(), "PointMaze": PointMaze()}
KNOW = {
    "Advertiser": [ShiftMixture, Exact],
    "Sepsis": [FactoredMixture, Clinical, HealthRegime, Patient, Exact],
    "PointMaze": [MazeCells, MazeGeometry],
}
EVERY = sorted({kind for kinds in KNOW.values() for kind in kinds}, key=lambda kind: kind.__name__)


@dataclass(frozen=True)
class Secret:
    """What a test knows."""

    word: str


class Asks(Component):
    """Asks for it."""

    knows: ClassVar = Secret

    def learn(self, knowledge: Secret) -> None:
        self.word = knowledge.word


class Silent(Component):
    """Does not."""

    def learn(self, knowledge: Any) -> None:
        raise AssertionError("nobody asked")


def test_knowledge_goes_to_those_that_ask() -> None:
    asks = Asks()
    inform([("a", Silent()), ("b", asks)], Secret("open"))
    assert asks.word == "open"


@pytest.mark.parametrize(("knowledge", "given"), [(None, "nothing"), (7, "int")])
def test_others_are_refused_by_name(knowledge: Any, given: str) -> None:
    with pytest.raises(UserError, match=f"Asks needs Secret, and FrozenLake gives {given}: .* another component"):
        inform([("a", Silent()), ("b.c", Asks())], knowledge, "FrozenLake")


@pytest.mark.parametrize("kind", EVERY, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_what_knows_one_environment_refuses_others(kind: Callable[[], Component], name: str) -> None:
    knowledge, part = ENVIRONMENTS[name].knowledge(), kind()
    if kind in KNOW[name]:
        inform([("part", part)], knowledge, name)
        return
    with pytest.raises(UserError, match=f"{type(part).__name__} needs .*, and {name} gives {type(knowledge).__name__}"):
        inform([("part", part)], knowledge, name)


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_no_way_leads_from_knowledge_to_rewards(name: str) -> None:
    """Whatever can be reached from it by attributes, arguments and closures is no environment and holds no reward."""
    env = ENVIRONMENTS[name]
    seen: dict[int, Any] = {}

    def reach(value: Any) -> None:
        if id(value) in seen or isinstance(value, (type, ModuleType, str, int, float)):
            return
        seen[id(value)] = value
        inner = [getattr(value, name, None) for name in ("__self__", "args", "keywords", "__closure__", "__dict__")]
        if isinstance(value, Mapping):
            inner = list(value.values())
        elif isinstance(value, (list, tuple)):
            inner = list(value)
        for each in inner:
            reach(each)

    reach(env.knowledge())
    assert not [value for value in seen.values() if isinstance(value, Component) or hasattr(value, "reward")]
    if name != "PointMaze":
        rewards = [env.mdp.reward] + ([env.mdp.reward_next] if name == "Sepsis" else [])
        tensors = [value for value in seen.values() if isinstance(value, torch.Tensor)]
        assert not [t for t in tensors for r in rewards if t.shape == r.shape]


@pytest.mark.parametrize("env", [Advertiser(), Sepsis()])
def test_exact_transitions_are_the_environments(env: Any) -> None:
    exact = Exact()
    problem: Problem = env.problem(5, (0, 1), "cpu")
    with pytest.raises(UserError, match="call learn"):
        exact.start(problem)
    inform([("exact", exact), ("counts", Counts())], env.knowledge())
    exact.start(problem)
    values = torch.randn(2, problem.states, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(exact.backup(values), env.mdp.backup(values))
    assert exact.backup(values).shape == (2, problem.states, problem.actions)
