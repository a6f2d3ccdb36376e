"""What it costs to relabel all transitions with three models, against the forward passes that this takes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import torch
from torch import Tensor

from credit.bench.measure import Row, taken_in_turns
from credit.core.problem import Problem
from credit.core.seams import RewardModel
from credit.core.store import Store
from credit.core.windows import Windows
from credit.envs.pointmaze.environment import PointMaze
from credit.envs.pointmaze.features import MazeCells, MazeGeometry
from credit.recovery.features.motion import Motion
from credit.recovery.models.linear import LinearModel
from credit.recovery.models.neural import NeuralModel
from credit.recovery.places import Rows
from credit.recovery.uncertainty.bootstrap import Analytic
from credit.recovery.uncertainty.networks import Dropout

TRANSITIONS, HORIZON, PASSES = 200_000, 250, 8


def relabelling(rounds: int = 6) -> list[Row]:
    """CPU time of mean and variance of 200,000 rows by three models, over that of the products alone."""
    uncertainty, known = Dropout(PASSES), PointMaze().knowledge()
    cells, geometry = MazeCells(), MazeGeometry()
    for features in (cells, geometry):
        features.learn(known)
    models: list[RewardModel] = [
        NeuralModel("dnn", Motion(), uncertainty),
        NeuralModel("heuristic", geometry, uncertainty, width=32, sparsity=0.0),
        LinearModel("box", cells, Analytic(None), regularization=1.0, unit=10.0),
    ]
    problem = Problem.vectors(4, 2, HORIZON, (0,))
    places, store = Rows(problem), Store(problem)
    for model in models:
        model.start(problem, places)
    store.append(trajectories())
    places.extend(store)
    for model in models:
        model.observe(store)
    inputs = [features(store.windows)[0] for features in (Motion(), geometry)]
    nets = [(rows, chain(rows.shape[1], width)) for rows, width in zip(inputs, (64, 32), strict=True)]

    def ours() -> None:
        for model in models:
            model.estimate()

    works: dict[str, Callable[[], object]] = {"ours": ours, "bare": partial(bare, nets)}
    seconds = taken_in_turns(works, rounds)
    ratio = seconds["ours"] / seconds["bare"]
    what = f"ms to relabel {TRANSITIONS} rows by three models, {PASSES} passes; the bare passes; ratio"
    figure = f"{seconds['ours'] * 1e3:.0f}, {seconds['bare'] * 1e3:.0f}; {ratio:.2f}"
    return [Row(what, figure, "≤ 1.5", ratio <= 1.5)]


def trajectories() -> Windows:
    """Balls anywhere, in trajectories of H steps with labels of both kinds."""
    count, generator = TRANSITIONS // HORIZON, torch.Generator().manual_seed(0)
    states = torch.rand(1, count, HORIZON, 4, generator=generator) * 6 - 3
    actions = torch.rand(1, count, HORIZON, 2, generator=generator) * 2 - 1
    return Windows.of_grid(states, actions, states, (torch.arange(count).view(1, -1) % 2).double())


def chain(inputs: int, width: int) -> list[Tensor]:
    """Weights of inputs → width → width → 1."""
    sizes = ((inputs, width), (width, width), (width, 1))
    return [torch.randn(size, generator=torch.Generator().manual_seed(0)) for size in sizes]


def bare(nets: Sequence[tuple[Tensor, Sequence[Tensor]]]) -> None:
    """Products and ReLUs of all passes of all networks, without bias, masks, mean or variance, on rows in the cache."""
    for inputs, (first, second, last) in nets:
        for part in inputs.split(1024):
            for _ in range(PASSES):
                _ = (part @ first).relu_().mm(second).relu_() @ last
