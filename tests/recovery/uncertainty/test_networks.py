"""Dropout, ensembles and the last layer's posterior, each against loops."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from credit.core.problem import Problem
from credit.core.steps import Steps
from credit.core.store import Windows
from credit.networks.stack import Stack
from credit.recovery.features.motion import Motion
from credit.recovery.models.batches import every
from credit.recovery.models.neural import NeuralModel
from credit.recovery.places import Rows
from credit.recovery.uncertainty.networks import (
    Dropout,
    Ensemble,
    LastLayer,
    NetworkUncertainty,
    Thinned,
    WithPriors,
)

MakeWalks = Callable[..., tuple[Problem, Windows]]


def fitted(walks: tuple[Problem, Windows], uncertainty: NetworkUncertainty, **keys: Any) -> tuple[NeuralModel, Tensor]:
    """A small model, and the inputs that it was fitted to, of the first replica."""
    model = NeuralModel("dnn", Motion(), uncertainty, **({"width": 12, "first_steps": 60, "batch": 8} | keys))
    fit(model, *walks)
    return model, model.features(walks[1])[0]


def fit(model: NeuralModel, problem: Problem, walks: Windows) -> None:
    model.start(problem, Rows(problem))
    model.fit(model.features(walks), walks)


def predicted(model: NeuralModel, walks: Windows, count: int | None = None) -> tuple[Tensor, Tensor]:
    """Mean and variance of the first rows of the first replica, by its own networks."""
    found = model.believe(Steps(walks.states[0, :count], walks.actions[0, :count], walks.next_states[0, :count]))
    return found.mean[0], found.variance[0]


def standard(inputs: Tensor) -> np.ndarray:
    """Inputs as the networks see them, of one replica; a constant is only centred."""
    values = inputs.double().numpy()
    deviation = values.std(0)
    return (values - values.mean(0)) / np.where(deviation > 1e-6, deviation, 1)


def outputs(networks: Stack, m: int, rows: np.ndarray, masks: tuple[np.ndarray, ...] = ()) -> tuple[np.ndarray, Any]:
    """Outputs and last hidden units of a network, by NumPy."""
    weights = [block[m].double().numpy() for block in networks.blocks]
    for layer in range(networks.shape.depth):
        rows = np.maximum(rows @ weights[2 * layer].T + weights[2 * layer + 1], 0)
        rows = rows * masks[layer] if masks else rows
    return (rows @ weights[-2].T + weights[-1])[:, 0], rows


def test_dropout_is_the_mean_and_variance_over_masks(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((3,), 10)
    model, inputs = fitted((problem, walks), Dropout(passes=4000, rate=0.25))
    mean, variance = predicted(model, walks, 30)
    generator, rows = np.random.default_rng(0), standard(inputs)[:30]
    passes = np.stack(
        [  # masks of its own for every row
            outputs(model.networks, 0, rows, tuple((generator.random((30, 12)) >= 0.25) * 1.0 for _ in range(2)))[0]
            for _ in range(4000)
        ]
    )
    expected = passes / problem.window
    np.testing.assert_allclose(mean, expected.mean(0), atol=5 * expected.std() / 4000**0.5)
    np.testing.assert_allclose(variance, expected.var(0), rtol=0.2)


def test_dropout_is_fresh_after_every_fit_and_the_same_for_all_who_look(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((3, 4), 6)
    models = [fitted((problem, walks), Dropout()) for _ in range(2)]
    one, two = ([predicted(model, walks)[0] for _ in range(2)] for model, _ in models)
    assert torch.equal(one[0], one[1])
    assert torch.equal(one[0], two[0])
    posterior = Thinned(models[0][0].networks, problem, "dnn", 8, 0.1)
    rows = torch.ones(5, 3)
    before = posterior.predictor(0)(rows)[0]
    posterior.fitted(rows, rows)  # the weights are as they were
    assert not torch.equal(before, posterior.predictor(0)(rows)[0])


def test_dropout_drops_that_many_units_of_every_row_in_training(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((3, 4), 6)
    model, _ = fitted((problem, walks), Dropout())
    posterior = Thinned(model.networks, problem, "dnn", 8, 0.1)
    first, second = posterior.masks(500), posterior.masks(500)
    assert len(first) == 2
    for mask in (*first, *second):
        assert mask.shape == (2, 500, 12)
        assert set(mask.unique().tolist()) == {0, 1}
        assert abs(mask.mean() - 0.9) < 0.01
        assert mask.std(1).min() > 0.2  # no unit is dropped for all rows
    assert not torch.equal(first[0], first[1])
    assert not torch.equal(first[0], second[0])
    assert not torch.equal(first[0][0], first[0][1])
    rows = torch.from_numpy(standard(walks.states[0])).float()
    rows = torch.nn.functional.pad(rows, (0, 1))
    by_name = [Thinned(model.networks, problem, name, 8, 0.1).predictor(0)(rows)[0] for name in ("dnn", "other", "dnn")]
    assert torch.equal(by_name[0], by_name[2])
    assert not torch.equal(by_name[0], by_name[1])


def test_an_ensemble_is_the_mean_and_variance_over_networks_with_priors(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((3,), 10)
    model, inputs = fitted((problem, walks), Ensemble(members=3, prior_scale=2.0))
    priors = WithPriors(model.networks, problem, "dnn", 3, 2.0)._priors
    rows = standard(inputs)
    each = np.stack([outputs(model.networks, m, rows)[0] + 2 * outputs(priors, m, rows)[0] for m in range(3)])
    mean, variance = predicted(model, walks)
    np.testing.assert_allclose(mean, each.mean(0) / problem.window, atol=1e-6)
    np.testing.assert_allclose(variance, each.var(0) / problem.window**2, rtol=1e-3, atol=1e-9)
    assert not torch.equal(model.networks.layers[0].weight[0], model.networks.layers[0].weight[1])


def test_an_ensemble_fits_the_labels_together_with_its_priors(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((3,), 30)
    model, _ = fitted((problem, walks), Ensemble(2, prior_scale=5.0), width=32, first_steps=400, sparsity=0.0)
    mean, _ = predicted(model, walks)
    assert (walks.sums(mean.unsqueeze(0)) - walks.labels).square().mean() < 0.1 * walks.labels.var()


def test_the_last_layers_variance_is_that_of_ridge_on_its_units(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((3,), 10)
    model, inputs = fitted((problem, walks), LastLayer(noise=0.2, prior_variance=0.7), stride=4)
    rows, steps = standard(inputs), every(walks, 4, problem.window)
    values, units = outputs(model.networks, 0, rows)
    phi = np.concatenate([units, np.ones((len(rows), 1))], 1) / problem.window
    sums = np.zeros((10, 13))
    for number in range(10):
        for row, weight in zip(steps.rows[0, number], steps.weights[0, number], strict=True):
            sums[number] += float(weight) * phi[row]
    covariance = np.linalg.inv(sums.T @ sums / 0.2**2 + np.eye(13) / 0.7)
    mean, variance = predicted(model, walks)
    np.testing.assert_allclose(mean, values / problem.window, atol=1e-6)
    np.testing.assert_allclose(variance, np.einsum("nd,de,ne->n", phi, covariance, phi), rtol=1e-3)


@pytest.mark.parametrize("uncertainty", [Ensemble(), LastLayer()])
@pytest.mark.parametrize("kind", ["sum", "success"])
def test_where_nothing_was_seen_the_variance_is_larger(
    make_walks: MakeWalks, square: tuple[Steps, Tensor], uncertainty: NetworkUncertainty, kind: str
) -> None:
    model, _ = fitted(make_walks((0,), 60, kind), uncertainty, width=32, first_steps=400, batch=16)
    moves, _ = square
    variance = model.believe(moves).variance[0]
    seen, unseen = variance[moves.states[:, 0] < 0.2], variance[moves.states[:, 0] > 0.5]
    assert unseen.mean() > 2 * seen.mean()
    pairs = unseen.sort().values.unsqueeze(1) > seen.sort().values.unsqueeze(0)
    assert pairs.double().mean() > 0.8  # the area under the curve of finding it


@pytest.mark.parametrize("kind", [Dropout, Ensemble, LastLayer])
def test_models_that_share_it_do_not_meet(make_walks: MakeWalks, kind: Callable[[], NetworkUncertainty]) -> None:
    problem, walks = make_walks((3,), 8)
    shared = kind()
    models = [NeuralModel(name, Motion(), shared, width=8, first_steps=10, batch=4) for name in ("one", "two")]
    for model in models:
        fit(model, problem, walks)
    together = [predicted(model, walks) for model in models]
    alone, inputs = fitted((problem, walks), kind(), width=8, first_steps=10, batch=4)
    assert all(len(pair[0]) == len(inputs) for pair in together)
    again = NeuralModel("two", Motion(), kind(), width=8, first_steps=10, batch=4)
    fit(again, problem, walks)
    for left, right in zip(predicted(again, walks), together[1], strict=True):
        assert torch.equal(left, right)
    assert not torch.equal(alone.networks.flat, models[0].networks.flat)  # a name has its own random numbers
