"""What all tests share: one thread, reproducible examples, small problems, and trainers composed once."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml
from hypothesis import settings
from torch import Tensor

import credit
from credit.config import registry, schema
from credit.core.problem import Problem
from credit.core.steps import Steps
from credit.core.windows import Episode, Windows
from credit.envs.advertiser.environment import Advertiser
from credit.runs import job
from credit.trainer import Trainer

torch.set_num_threads(1)
settings.register_profile("credit", deadline=None, derandomize=True, database=None, max_examples=40)
settings.load_profile("credit")

# Rooms, and files that go there, in which nothing is rounded: all other tests run again under other instruction sets.
NO_NUMBERS = {"bench", "cli", "config", "docs", "report", "runs", "tables", "tracking", "tuning"}
NO_NUMBERS |= {
    f"test_{name}.py"
    for name in ("checkpoint", "dependencies", "job", "locks", "processors", "registry", "runs", "wheel")
}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what `tests/processors.py` runs."""
    here = Path(__file__).parent
    for item in items:
        if item.path.is_relative_to(here) and NO_NUMBERS.isdisjoint(item.path.relative_to(here).parts):
            item.add_marker(pytest.mark.numerical)


LATER = re.compile(r"(trainer|env)\.\w+=[\w.]+")  # keys that nothing refers to: they may be set after composing


@cache
def _composed(overrides: tuple[str, ...]) -> dict[str, Any]:
    """Checked anew for every words, and composed once for all that differ in a few numbers: that takes the time."""
    later = [text for text in overrides if LATER.fullmatch(text)]
    config = deepcopy(_chosen(tuple(text for text in overrides if text not in later)))
    for text in later:
        path, _, value = text.partition("=")
        node, key = path.split(".")
        assert key in config[node], f"{node} has no {key}"
        config[node][key] = yaml.safe_load(value)
    return job.checked(config)


@cache
def _chosen(overrides: tuple[str, ...]) -> dict[str, Any]:
    return registry.compose(["tracking=none", *overrides])


@pytest.fixture(scope="session")
def composed() -> Callable[..., dict[str, Any]]:
    """The checked configuration of some overrides, without tracking."""
    return lambda *overrides: _composed(overrides)


@pytest.fixture(scope="session")
def make_trainer() -> Callable[..., Trainer]:
    """A started trainer: `make_trainer("reference", (0, 1), "trainer.steps=70")`."""

    def make(method: str, seeds: tuple[int, ...], *overrides: str) -> Trainer:
        trainer: Trainer = schema.build(_composed((f"method={method}", *overrides)), "trainer")
        trainer.start(seeds)
        return trainer

    return make


@pytest.fixture(scope="session")
def interrupt() -> Callable[..., None]:
    """`interrupt(70, "method=reference", ...)`: a run that is stopped behind its last checkpoint."""

    def stop(after: int, *overrides: str) -> None:
        def progress(title: str, steps: int, total: int) -> None:
            if steps >= after:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            credit.run(["tracking=none", "checkpoint_seconds=0", *overrides], progress=progress)

    return stop


@pytest.fixture(scope="session")
def make_problem() -> Callable[..., Problem]:
    """A problem of the advertiser's size, or another."""

    def make(seeds: Sequence[int] = (0,), states: int = 10, actions: int = 3, window: int = 7) -> Problem:
        return Problem.finite(states, actions, window, tuple(seeds))

    return make


@pytest.fixture(scope="session")
def make_continuous() -> Callable[..., Problem]:
    """A problem with four numbers in a state and two in an action."""

    def make(seeds: Sequence[int] = (0,), window: int = 9) -> Problem:
        return Problem.vectors(4, 2, window, tuple(seeds))

    return make


@pytest.fixture(scope="session")
def make_trajectories() -> Callable[..., Windows]:
    """`make_trajectories([[3, 1], [2, 4]], [[1, 0], [0, 1]])`: random steps of K trajectories of each replica.

    A trajectory with a positive label is terminated. What a replica's trajectory holds depends on `seeds[replica]` (or
    its number) and its place alone.
    """

    def make(
        lengths: Sequence[Sequence[int]], labels: Sequence[Sequence[float]], seeds: Sequence[int] = (), first: int = 0
    ) -> Windows:
        def episode(r: int, k: int, steps: int) -> Episode:
            name = 1000 * (seeds[r] if seeds else r) + first + k
            path = torch.randn(steps + 1, 4, generator=torch.Generator().manual_seed(name))
            force = torch.rand(steps, 2, generator=torch.Generator().manual_seed(name)) * 2 - 1
            return Episode(path[:-1], force, path[1:], labels[r][k] > 0)

        episodes = [[episode(r, k, steps) for k, steps in enumerate(own)] for r, own in enumerate(lengths)]
        return Windows.of_episodes(episodes, torch.tensor(labels, dtype=torch.float64))

    return make


@pytest.fixture(scope="session")
def make_windows() -> Callable[..., Windows]:
    """Windows of uniform actions in uniform states, labelled by the advertiser's reward and noise of .2."""

    def make(problem: Problem, count: int, seed: int = 0) -> Windows:
        generator = torch.Generator().manual_seed(seed)
        shape = (problem.replicas, count, problem.window)
        states = torch.randint(problem.states, shape, generator=generator)
        actions = torch.randint(problem.actions, shape, generator=generator)
        arrivals = torch.randint(problem.states, shape, generator=generator)
        phi = (0.0, *(0.02 + 0.03 * a for a in range(problem.actions - 1)))
        reward = Advertiser(states=problem.states, interaction=phi).mdp.reward
        noise = torch.randn(shape[:2], generator=generator, dtype=torch.float64)
        return Windows.of_grid(states, actions, arrivals, reward[states, actions].sum(-1) + 0.2 * noise)

    return make


@pytest.fixture(scope="session")
def make_walks() -> Callable[..., tuple[Problem, Windows]]:
    """`make_walks(seeds, count, kind)`: random walks in x ≤ .3 of the square, labelled by the sum of `worth(states)`.

    A seed's walks depend on the seed alone. `kind="success"` labels with 1 what is above the median.
    """

    def make(
        seeds: Sequence[int] = (0,), count: int = 40, kind: str = "sum", window: int = 40
    ) -> tuple[Problem, Windows]:
        def episode(seed: int, number: int) -> Episode:
            generator = np.random.default_rng([seed, number])
            path = generator.uniform(-1, 1, 2) + generator.normal(0, 0.15, (window, 2)).cumsum(0)
            path[:, 0] = 0.3 - abs(path[:, 0].clip(-1, 1) - 0.3)
            states = torch.from_numpy(path.clip(-1, 1)[: generator.integers(window // 2, window + 1)]).float()
            return Episode(states, torch.zeros(len(states), 1), states)

        episodes = [[episode(seed, number) for number in range(count)] for seed in seeds]
        labels = torch.tensor(
            [[worth(one.states).sum().item() for one in own] for own in episodes], dtype=torch.float64
        )
        if kind == "success":
            labels = (labels > labels.median(1, keepdim=True).values).double()
        return Problem.vectors(2, 1, window, tuple(seeds)), Windows.of_episodes(episodes, labels)

    return make


def worth(states: Tensor) -> Tensor:
    """A smooth reward of places [N, 2], of which about 40 make a label of unit scale."""
    return 0.075 * ((3 * states[:, 0]).sin() + 1.5 * states[:, 1])


@pytest.fixture(scope="session")
def square() -> tuple[Steps, Tensor]:
    """Places all over the square [N, 2] as steps, and what each is worth."""
    states = torch.rand(2000, 2, generator=torch.Generator().manual_seed(0)) * 2 - 1
    return Steps(states, torch.zeros(2000, 1), states), worth(states)
