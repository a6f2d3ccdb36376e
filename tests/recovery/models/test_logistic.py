"""Labels that are bits: fits of log-odds beside a naive second implementation, gradients beside autograd."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from credit.core.errors import RunError, UserError
from credit.core.problem import FLOAT, Problem
from credit.core.windows import Windows
from credit.recovery.features.motion import Motion
from credit.recovery.features.tabular import Identity
from credit.recovery.mixers import Stacking
from credit.recovery.models.linear import LinearModel
from credit.recovery.models.logistic import WIDE, drawn_odds
from credit.recovery.models.neural import NeuralModel, log_gradient
from credit.recovery.places import Rows
from credit.recovery.recovery import Recovery
from credit.recovery.uncertainty.bootstrap import Analytic, Bootstrap
from credit.recovery.uncertainty.networks import Dropout, Ensemble, LastLayer

from ..fits import Experience, Given, part, poisson

Make = Callable[..., Problem]
MakeWindows = Callable[..., Windows]
MakeWalks = Callable[..., tuple[Problem, Windows]]


def bits(windows: Windows) -> Windows:
    """The same with bits for labels: whether they are above their median."""
    labels = (windows.labels > windows.labels.median(1, keepdim=True).values).to(FLOAT)
    return replace(windows, labels=labels)


def counts(windows: Windows, replica: int) -> np.ndarray:
    index = windows.grid(windows.states * 3 + windows.actions)[replica].numpy()
    return np.stack([np.bincount(row, minlength=30) for row in index]).astype(float)


def naive(x: np.ndarray, y: np.ndarray, w: np.ndarray, penalty: float) -> tuple[np.ndarray, np.ndarray]:
    """Plain Newton from zero, window by window, with sums written out; θ with the intercept first, and H⁻¹."""
    size = x.shape[1] + 1
    prior = np.diag([1 / WIDE, *[penalty] * (size - 1)])
    theta = np.zeros(size)
    for _ in range(60):
        gradient, hessian = prior @ theta, prior.copy()
        for row, label, weight in zip(x, y, w, strict=True):
            v = np.concatenate([[1.0], row])
            p = 1 / (1 + np.exp(-v @ theta))
            gradient += weight * (p - label) * v
            hessian += weight * p * (1 - p) * np.outer(v, v)
        theta = theta - np.linalg.solve(hessian, gradient)
    return theta, np.linalg.inv(hessian)


def ridge(uncertainty: Any, **keys: Any) -> LinearModel:
    return LinearModel("ridge", Identity(), uncertainty, likelihood="logistic", **keys)


def test_linear_fits_are_those_of_a_naive_newton(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0, 1))
    windows = bits(make_windows(problem, 60, seed=3))
    weights = poisson(windows, 1)
    model = ridge(Given(1), regularization=0.5)
    experience = Experience(problem, model)
    for which in (slice(1), slice(1, 40), slice(40, 60)):
        experience.see(part(windows, which), weights[:, which])
    estimate = model.estimate()
    assert estimate.draws is not None
    assert estimate.intercepts is not None
    for replica in range(2):
        x, y, w = counts(windows, replica), windows.labels[replica].numpy(), weights[replica].T.numpy()
        theta, covariance = naive(x, y, w[0], 0.5)
        np.testing.assert_allclose(estimate.mean[replica].numpy(), theta[1:], atol=1e-7)
        np.testing.assert_allclose(model.leverage()[replica].numpy(), np.diag(covariance)[1:], atol=1e-7)
        drawn, _ = naive(x, y, w[1], 0.5)
        np.testing.assert_allclose(estimate.draws[replica, 0].numpy(), drawn[1:], atol=1e-7)
        np.testing.assert_allclose(float(estimate.intercepts[replica, 0]), drawn[0], atol=1e-7)


def test_the_variance_without_draws_is_laplaces(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0,))
    model = ridge(Analytic(noise=7.0))
    Experience(problem, model).see(bits(make_windows(problem, 30)))
    torch.testing.assert_close(model.estimate().variance, model.leverage())


def test_labels_that_are_all_the_same_lead_nowhere_near_infinity(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0,))
    windows = make_windows(problem, 200)
    model = ridge(Bootstrap(3))
    Experience(problem, model).see(replace(windows, labels=torch.ones_like(windows.labels)))
    assert model.estimate().mean.abs().max() < 20


def test_fits_go_on_from_a_state_to_the_bit(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0, 1))
    windows = bits(make_windows(problem, 40))
    recoveries = [Recovery(ridge(Bootstrap(3))) for _ in range(2)]
    one, other = recoveries
    for recovery in recoveries:
        recovery.start(problem)
    store = Experience(problem).store
    store.append(part(windows, slice(25)))
    one.observe(store)
    other.load_state_dict(one.state_dict())
    store.append(part(windows, slice(25, 40)))
    for recovery in recoveries:
        recovery.observe(store)
    first, second = one.belief(), other.belief()
    assert first is not None
    assert second is not None
    assert torch.equal(first.mixed, second.mixed)
    assert torch.equal(first.mse, second.mse)


def test_held_out_labels_are_compared_with_probabilities(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0,))
    windows = bits(make_windows(problem, 30))
    bootstrap = Bootstrap(4)
    model = ridge(bootstrap)
    experience = Experience(problem, model).see(windows)
    estimate, index = model.estimate(), experience.places.index(windows)
    assert estimate.draws is not None
    assert estimate.intercepts is not None
    squares = 0.0
    for window, row in enumerate(windows.grid(index)[0]):
        out = [d for d in range(4) if bootstrap._outside[0, window, d]]
        odds = [float(estimate.draws[0, d, row].sum() + estimate.intercepts[0, d]) for d in out]
        if out:
            mean = np.mean([1 / (1 + np.exp(-z)) for z in odds])
            squares += (mean - float(windows.labels[0, window])) ** 2
    expected = squares / float(windows.labels.var(correction=0))
    assert float(bootstrap.label_errors([estimate], experience.store, index)) == pytest.approx(expected)


def test_gradients_are_those_of_autograd() -> None:
    draw = torch.Generator().manual_seed(0)
    outputs = torch.randn(5, 4, generator=draw, dtype=FLOAT).requires_grad_()
    shares, odds = torch.rand(5, 4, generator=draw, dtype=FLOAT), torch.randn(5, dtype=FLOAT, generator=draw)
    odds.requires_grad_()
    labels = torch.tensor([0.0, 1, 1, 0, 1], dtype=FLOAT)
    z = (outputs * shares).sum(-1) + odds
    loss = torch.nn.functional.binary_cross_entropy_with_logits(z, labels, reduction="sum")
    (loss + 0.1 * (shares * outputs.abs()).sum()).backward()  # type: ignore[no-untyped-call]
    found, by_odds = log_gradient(outputs.detach(), shares, labels, odds.detach(), 0.1)
    torch.testing.assert_close(found, outputs.grad)
    torch.testing.assert_close(by_odds, odds.grad)


def test_odds_of_being_drawn() -> None:
    labels = torch.tensor([[1.0, 0, 0, 0], [1, 1, 1, 1], [1, 1, 0, 0]])
    labelled = torch.tensor([[1, 1, 1, 0], [1, 1, 1, 1], [1, 1, 1, 0]]) > 0
    found = drawn_odds(labels, labelled, 8, bits=True)
    np.testing.assert_allclose(found, [np.log(2), 0, -np.log(2)], rtol=1e-6)
    assert drawn_odds(labels, labelled, 8, bits=False).tolist() == [0, 0, 0]


@pytest.mark.parametrize("uncertainty", [Dropout, Ensemble, LastLayer])
def test_a_network_learns_how_frequent_successes_are(make_walks: MakeWalks, uncertainty: Any) -> None:
    problem, walks = make_walks((4, 5), 12)
    labels = torch.zeros_like(walks.labels)
    labels[:, :2] = 1  # of twelve, and in every batch every second one
    walks = replace(walks, labels=labels)
    made = NeuralModel(
        "dnn", Motion(), uncertainty(), width=8, first_steps=150, batch=8, stride=1, sparsity=0, likelihood="logistic"
    )
    made.start(problem, Rows(problem))
    made.fit(made.features(walks), walks)
    assert made._odds is not None
    assert (made._odds.values < 0).all()
    estimate = made._predict(made.features(walks), None)
    assert (estimate.variance >= 0).all()
    state = made.state_dict()
    again = NeuralModel("dnn", Motion(), uncertainty(), width=8, batch=8, stride=1, likelihood="logistic")
    again.start(problem, Rows(problem))
    again.load_state_dict(state)
    assert torch.equal(again._predict(again.features(walks), None).mean, estimate.mean)


@pytest.mark.parametrize("model", [ridge(Analytic()), NeuralModel("dnn", Motion(), Dropout(), likelihood="logistic")])
def test_labels_that_are_no_bits_are_refused(model: Any, make_problem: Make, make_walks: MakeWalks) -> None:
    problem = make_problem((0,)) if isinstance(model, LinearModel) else make_walks((4,), 3)[0]
    with pytest.raises(UserError, match="real numbers; use likelihood=gaussian"):
        Recovery(model).start(replace(problem, labels="real"))


def test_a_label_that_is_no_bit_is_told(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0,))
    with pytest.raises(RunError, match="0 or 1, and one is"):
        Experience(problem, ridge(Analytic())).see(make_windows(problem, 3))


def test_models_of_a_recovery_have_one_likelihood(make_problem: Make) -> None:
    other = LinearModel("linear", Identity(), Bootstrap(3))
    with pytest.raises(UserError, match="the same likelihood"):
        Recovery(ridge(Bootstrap(3)), {"linear": other}, Stacking()).start(make_problem((0,)))
