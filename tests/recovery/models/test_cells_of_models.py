"""Reward models over other cells than (s, a), and with all credit on the last step, against dense ridge regression."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from credit.agents.random import Random
from credit.core.cells import PAIRS, Axis
from credit.core.problem import FLOAT, Problem
from credit.core.windows import Windows
from credit.envs.collect import Collector
from credit.envs.feedback import BlockSum
from credit.envs.sepsis.environment import Sepsis
from credit.recovery.features.tabular import Bilinear, Identity, Threshold
from credit.recovery.models.linear import LinearModel
from credit.recovery.models.primitive import PrimitiveReward
from credit.recovery.models.ridge import RidgeModel
from credit.recovery.models.table import TableModel

from ..fits import Experience, Given, cells_of, part
from ..fits import poisson as poisson_of

Make = Callable[..., Problem]
STATES, ACTIONS, WINDOW, DRAWS = 8, 3, 4, 2
ARRIVALS: tuple[Axis, ...] = ("next_state",)
TIMED: tuple[Axis, ...] = ("step", "next_state")
SIZES = {"step": WINDOW, "state": STATES, "action": ACTIONS, "next_state": STATES}


@pytest.fixture
def problem(make_problem: Make) -> Problem:
    return replace(make_problem((0, 1), states=STATES, actions=ACTIONS, window=WINDOW), episodic=True)


def windows_of(problem: Problem, count: int, seed: int = 0) -> Windows:
    """Windows that prefer low states: cells occur twice in a window, and some never."""
    generator = torch.Generator().manual_seed(seed)
    shape = (problem.replicas, count, problem.window)
    states, arrivals = ((torch.rand(shape, generator=generator) ** 3 * (problem.states - 1)).long() for _ in range(2))
    actions = torch.randint(problem.actions, shape, generator=generator)
    return Windows.of_grid(states, actions, arrivals, torch.randn(shape[:2], dtype=FLOAT, generator=generator))


def poisson(windows: Windows, draws: int = DRAWS) -> torch.Tensor:
    """Weights [R, K, 1+B]; those of the point fit are 1."""
    return poisson_of(windows, draws, 9)


def cells(windows: Windows, axes: tuple[Axis, ...], sizes: dict[str, int] = SIZES) -> np.ndarray:
    """The row-major cell of every step [R, K, T]."""
    columns = {"state": windows.states, "action": windows.actions, "next_state": windows.next_states}
    values = {axis: windows.grid(column) for axis, column in columns.items()}
    steps = np.broadcast_to(np.arange(windows.length or 0), values["state"].shape)
    parts = [steps if axis == "step" else values[axis].numpy() for axis in axes]
    return np.ravel_multi_index(parts, [sizes[axis] for axis in axes])


def ridge(x: np.ndarray, labels: torch.Tensor, weights: torch.Tensor, penalty: float) -> np.ndarray:
    """θ of all fits [1+B, d]: (XᵀWX + λI) θ = XᵀWy for the windows of one replica."""
    eye = penalty * np.eye(x.shape[1])
    fits = [np.linalg.solve((x.T * w) @ x + eye, (x.T * w) @ labels.numpy()) for w in weights.T.numpy()]
    return np.stack(fits)


def assert_fits(model: RidgeModel, expected: list[np.ndarray], error: float) -> None:
    """The estimates of all replicas are these tables [1+B, N]."""
    estimate = model.estimate()
    assert estimate.draws is not None
    for replica, table in enumerate(expected):
        found = torch.cat([estimate.mean[replica : replica + 1], estimate.draws[replica]])
        np.testing.assert_allclose(found, table, atol=error, rtol=0)


def last_alone(features: np.ndarray, windows: Windows, weights: torch.Tensor, penalty: float) -> list[np.ndarray]:
    """Tables [1+B, T·S·A] of ridge regression on φ [S, A, d] of the last (s, a) alone: 0 at every other step."""
    tables = []
    states, actions = windows.grid(windows.states).numpy(), windows.grid(windows.actions).numpy()
    for replica in range(2):
        x = features[states[replica, :, -1], actions[replica, :, -1]]
        theta = ridge(x, windows.labels[replica], weights[replica], penalty)
        table = np.zeros((1 + DRAWS, WINDOW, STATES * ACTIONS))
        table[:, -1] = theta @ features.reshape(STATES * ACTIONS, -1).T
        tables.append(table.reshape(1 + DRAWS, -1))
    return tables


@pytest.mark.parametrize("size", [1, 7, 60], ids=["one by one", "some", "all at once"])
@pytest.mark.parametrize("kind", ["cells", "bilinear", "threshold"])
def test_linear_with_the_credit_on_the_last_step(problem: Problem, kind: str, size: int) -> None:
    s, a = np.meshgrid(np.arange(STATES), np.arange(ACTIONS), indexing="ij")
    features, table = {
        "cells": (Identity(), np.eye(STATES * ACTIONS)[s * ACTIONS + a]),
        "bilinear": (Bilinear(), np.stack([np.ones(s.shape), s, a, s * a], -1)),
        "threshold": (Threshold(), np.eye(2 * ACTIONS)[(s > 4) * ACTIONS + a]),
    }[kind]
    model = LinearModel("any", features, Given(DRAWS), 0.3, "last_step")
    assert set(model.looks_at) == {"step", "state", "action"}
    windows = windows_of(problem, 60)
    weights = poisson(windows)
    experience = Experience(problem, model)
    for start in range(0, 60, size):
        which = slice(start, start + size)
        experience.see(part(windows, which), weights[:, which])
    assert_fits(model, last_alone(table, windows, weights, 0.3), 1e-9)
    experience.see(windows_of(problem, 30, seed=4), poisson(windows_of(problem, 30, seed=4)))
    experience.anew(windows, weights)  # forgets the thirty windows
    assert_fits(model, last_alone(table, windows, weights, 0.3), 1e-9)


@pytest.mark.parametrize("credit", ["every_step", "last_step"])
def test_many_windows_at_once_equal_one_by_one(problem: Problem, credit: str) -> None:
    windows = windows_of(problem, 50)
    weights = poisson(windows)
    weights[:, 3, 1:] = 0  # a window that no draw sees
    many, one = (LinearModel("any", Identity(ARRIVALS), Given(DRAWS), 0.2, credit) for _ in range(2))  # type: ignore[arg-type]
    Experience(problem, many, axes=TIMED).see(windows, weights)  # 50 windows of 8 features: one inverse
    experience = Experience(problem, one, axes=TIMED)
    for k in range(50):
        experience.see(part(windows, slice(k, k + 1)), weights[:, k : k + 1])
    torch.testing.assert_close(many.estimate().mean, one.estimate().mean, atol=1e-11, rtol=0)
    torch.testing.assert_close(many.estimate().draws, one.estimate().draws, atol=1e-11, rtol=0)
    torch.testing.assert_close(many.leverage(), one.leverage(), atol=1e-11, rtol=0)
    assert many.estimate().mean.abs().max() > 0.1


@pytest.mark.parametrize("axes", [PAIRS, ARRIVALS, TIMED, ("step", *PAIRS)], ids="-".join)
@pytest.mark.parametrize("credit", ["every_step", "last_step"])
def test_a_table_over_other_cells(problem: Problem, axes: tuple[Axis, ...], credit: str) -> None:
    model = TableModel(Given(DRAWS), looks_at=axes, credit=credit, regularization=0.5, tolerance=1e-12)  # type: ignore[arg-type]
    seen = axes if credit == "every_step" or "step" in axes else ("step", *axes)
    assert set(model.looks_at) == set(seen)
    count = cells_of(problem, [model]).count
    windows = windows_of(problem, 60)
    weights = poisson(windows)
    experience = Experience(problem, model)
    for which in (slice(1), slice(1, 13), slice(13, 60)):
        experience.see(part(windows, which), weights[:, which])
    tables, index = [], cells(windows, seen)[..., -1 if credit == "last_step" else 0 :]
    for replica in range(2):
        x = np.zeros((60, count))
        np.add.at(x, (np.arange(60)[:, None], index[replica]), 1)
        tables.append(ridge(x, windows.labels[replica], weights[replica], 0.5))
    assert_fits(model, tables, 1e-9)
    assert any((table == 0).all(0).any() for table in tables)
    experience.anew(part(windows, slice(20)), weights[:, :20]).anew(windows, weights)
    assert_fits(model, tables, 1e-9)


def test_the_last_step_of_three_windows_by_hand(make_problem: Make) -> None:
    # S' at the end: 1, 1, 0; labels 2, 4, 6; λ = 1: θ(1) = (2 + 4)/(1 + 2) = 2, θ(0) = 6/(1 + 1) = 3; else 0
    problem = replace(make_problem((0,), states=2, actions=1, window=2), episodic=True)
    arrivals = torch.tensor([[[0, 1], [1, 1], [0, 0]]])
    windows = Windows.of_grid(arrivals, arrivals * 0, arrivals, torch.tensor([[2.0, 4.0, 6.0]], dtype=FLOAT))
    for model in (
        TableModel(Given(), looks_at=ARRIVALS, credit="last_step", regularization=1.0, tolerance=1e-14),
        LinearModel("linear", Identity(ARRIVALS), Given(), 1.0, "last_step"),
    ):
        Experience(problem, model).see(windows)
        assert model.estimate().mean.tolist() == [pytest.approx([0, 0, 3, 2], abs=1e-12)], model


@pytest.mark.parametrize("credit", ["every_step", "last_step"])
def test_a_table_beside_models_that_look_at_more_stays_what_it_is(problem: Problem, credit: str) -> None:
    # Its own axes make the fit; those of all models only say where it is read.
    windows = windows_of(problem, 60)
    weights = poisson(windows)
    keys = {"looks_at": ARRIVALS, "credit": credit, "regularization": 0.5, "tolerance": 1e-12}
    table = TableModel(Given(DRAWS), **keys)  # type: ignore[arg-type]
    dense = LinearModel("dense", Identity(ARRIVALS), Given(DRAWS), 0.5, credit)  # type: ignore[arg-type]
    Experience(problem, table, dense, axes=TIMED).see(windows, weights)
    torch.testing.assert_close(table.estimate().mean, dense.estimate().mean, atol=1e-9, rtol=0)
    torch.testing.assert_close(table.estimate().draws, dense.estimate().draws, atol=1e-9, rtol=0)
    by_step = table.leverage().view(2, WINDOW, STATES)
    assert (by_step <= dense.leverage().view(2, WINDOW, STATES) + 1e-12).all()
    assert torch.equal(by_step, by_step[:, -1:].expand_as(by_step)) == (credit == "every_step")


def test_the_oracles_table_beside_models_that_look_at_more_stays_what_it_is(problem: Problem) -> None:
    windows = windows_of(problem, 20)
    rewards = torch.randn(2, 20, WINDOW, dtype=FLOAT, generator=torch.Generator().manual_seed(2))
    model = PrimitiveReward(looks_at=ARRIVALS)
    Experience(problem, model, axes=TIMED).see(replace(windows, primitive=rewards.flatten(1)))
    found = model.estimate().mean.view(2, WINDOW, STATES)
    for replica in range(2):
        for state in range(STATES):
            here = windows.grid(windows.next_states)[replica] == state
            expected = float(rewards[replica][here].mean()) if here.any() else 0.0
            assert found[replica, :, state].tolist() == pytest.approx([expected] * WINDOW, abs=1e-12)


@pytest.mark.parametrize("credit", ["every_step", "last_step"])
@pytest.mark.parametrize("axes", [PAIRS, TIMED], ids="-".join)
def test_leverage_is_a_lower_bound_of_the_exact_one(problem: Problem, axes: tuple[Axis, ...], credit: str) -> None:
    model = TableModel(Given(DRAWS), looks_at=axes, credit=credit, regularization=0.5)  # type: ignore[arg-type]
    table = cells_of(problem, [model])
    windows = windows_of(problem, 40)
    experience = Experience(problem, model)
    experience.see(part(windows, slice(25)), poisson(windows)[:, :25])
    experience.see(part(windows, slice(25, 40)), poisson(windows)[:, 25:])
    found = model.leverage()
    index = cells(windows, table.axes)[..., -1 if credit == "last_step" else 0 :]
    for replica in range(2):
        x = np.zeros((40, table.count))
        np.add.at(x, (np.arange(40)[:, None], index[replica]), 1)
        counts = np.ones(table.count)
        if credit == "last_step":
            counts.reshape(WINDOW, -1)[:-1] = 0  # φ = 0 where the label says nothing: the reward is 0 for sure
        np.testing.assert_allclose(found[replica], counts / (0.5 + (x**2).sum(0)), rtol=1e-12)
        exact = counts * np.linalg.inv(x.T @ x + 0.5 * np.eye(x.shape[1])).diagonal()
        assert (found[replica].numpy() <= exact + 1e-12).all()
        if credit == "last_step":  # one cell a window: V is diagonal
            np.testing.assert_allclose(found[replica], exact, rtol=1e-10)
        else:
            assert (x > 1).any() == (axes == PAIRS)
            assert (found[replica].numpy() < 0.99 * exact).any()
    dense = LinearModel("dense", Identity(axes), Given(DRAWS), 0.5, credit)  # type: ignore[arg-type]
    Experience(problem, dense).see(windows, poisson(windows))
    assert (found <= dense.leverage() + 1e-12).all()
    experience.anew(part(windows, slice(0)), poisson(windows)[:, :0])
    assert model.leverage().unique().tolist() == ([2] if credit == "every_step" else [0, 2])  # nothing seen: 1/λ


def test_leverage_is_exact_where_cells_never_share_a_window(problem: Problem) -> None:
    states = torch.tensor([0, 0, 3, 5, 3, 0]).view(1, 6, 1).expand(2, 6, WINDOW)  # the same pair all the window long
    windows = Windows.of_grid(states, states * 0, states, torch.ones(2, 6, dtype=FLOAT))
    table, dense = TableModel(Given(), regularization=0.5), LinearModel("ridge", Identity(), Given(), 0.5)
    Experience(problem, table, dense).see(windows)
    torch.testing.assert_close(table.leverage(), dense.leverage(), rtol=1e-10, atol=0)
    assert float(table.leverage()[0, 0]) == pytest.approx(1 / (0.5 + 3 * WINDOW**2))


@pytest.fixture(scope="module")
def patients() -> tuple[Problem, Windows]:
    """A thousand episodes of random treatments."""
    env, feedback, random = Sepsis(), BlockSum(5, 0.5), Random()
    problem = env.problem(5, (11,), "cpu")
    for component in (env, feedback, random):
        component.start(problem)
    return problem, Collector(env, feedback, problem).collect(random, 1000)[0]


@pytest.mark.parametrize("axes", [PAIRS, TIMED], ids="-".join)
def test_the_default_tolerance_is_enough_for_patients(
    patients: tuple[Problem, Windows], axes: tuple[Axis, ...]
) -> None:
    problem, windows = patients
    weights = poisson(windows, 1)
    model = TableModel(Given(1), looks_at=axes)
    experience = Experience(problem, model)
    for which in (slice(100), slice(100, 500), slice(500, 1000)):
        experience.see(part(windows, which), weights[:, which])
    index = cells(windows, axes, {"step": 5, "state": 1296, "action": 8, "next_state": 1296})[0]
    visited, column = np.unique(index, return_inverse=True)
    assert len(visited) > 1500
    x = np.zeros((1000, len(visited)))
    np.add.at(x, (np.arange(1000)[:, None], column.reshape(index.shape)), 1)
    estimate = model.estimate()
    assert estimate.draws is not None
    found = torch.cat([estimate.mean, estimate.draws[0]]).numpy()
    for fit, weight in zip(found, weights[0].T.numpy(), strict=True):
        # θ = Xᵀ(XXᵀ + λW⁻¹)⁻¹Y, a system of the windows that have a weight
        kept = weight > 0
        dual = np.linalg.solve(x[kept] @ x[kept].T + np.diag(10 / weight[kept]), windows.labels[0].numpy()[kept])
        theta = x[kept].T @ dual
        assert np.abs(fit[visited] - theta).max() <= 1e-4 * np.abs(theta).max()
        assert np.abs(theta).max() > 0.1
        assert np.count_nonzero(fit) <= len(visited)
