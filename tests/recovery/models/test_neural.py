"""Equation (5): what is minimised, on which steps, and by which gradient."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from credit.core.belief import Estimate
from credit.core.errors import RunError, UserError
from credit.core.problem import Problem
from credit.core.steps import Steps
from credit.core.streams import generators
from credit.core.windows import Windows
from credit.networks.modules import Module, Perceptron
from credit.networks.stack import Stack
from credit.recovery.features.motion import Motion
from credit.recovery.models.batches import balanced, every, padding
from credit.recovery.models.neural import NeuralModel, gradient
from credit.recovery.places import Rows
from credit.recovery.uncertainty.networks import (
    Dropout,
    Ensemble,
    LastLayer,
    NetworkUncertainty,
    Posterior,
    Predictor,
)

from ..fits import Experience, first

MakeWalks = Callable[..., tuple[Problem, Windows]]
KINDS: list[Callable[[], NetworkUncertainty]] = [Dropout, Ensemble, LastLayer]


def model(uncertainty: NetworkUncertainty | None = None, **keys: Any) -> NeuralModel:
    small: dict[str, Any] = {"width": 16, "first_steps": 20, "steps": 5, "batch": 6}
    return NeuralModel("dnn", Motion(), uncertainty or LastLayer(), **(small | keys))


def started(problem: Problem, uncertainty: NetworkUncertainty | None = None, **keys: Any) -> NeuralModel:
    made = model(uncertainty, **keys)
    made.start(problem, Rows(problem))
    return made


def fitted(problem: Problem, walks: Windows, *fits: int, **keys: Any) -> NeuralModel:
    """A model after fits to the first so many trajectories."""
    made = started(problem, **keys)
    for count in fits or (walks.labels.shape[1],):
        part = first(walks, count)
        made.fit(made.features(part), part)
    return made


def believed(made: NeuralModel, walks: Windows) -> list[Estimate]:
    """What is predicted of the rows of each replica that mean something, [R, n] of all replicas."""
    return [made.believe(steps_of(walks, replica)) for replica in range(len(walks.labels))]


def steps_of(walks: Windows, replica: int) -> Steps:
    rows = slice(None) if walks.count is None else slice(int(walks.count[replica]))
    return Steps(walks.states[replica, rows], walks.actions[replica, rows], walks.next_states[replica, rows])


@pytest.mark.parametrize("stride", [1, 3, 12, 100])
def test_every_step_counts_once(make_walks: MakeWalks, stride: int) -> None:
    problem, walks = make_walks((4, 5), 7)
    steps = every(walks, stride, problem.window)
    assert steps.rows.shape == steps.weights.shape == (2, 7, padding(stride, problem.window))
    for replica in range(2):
        for number in range(7):
            own = (walks.number[replica] == number).nonzero().flatten().tolist()
            stands_for: dict[int, int] = {}
            for place in range(len(own)):  # every step is stood for by the next one that is kept
                kept = next(k for k in range(place, len(own)) if (len(own) - 1 - k) % stride == 0)
                stands_for[own[kept]] = stands_for.get(own[kept], 0) + 1
            rows, weights = steps.rows[replica, number], steps.weights[replica, number]
            found = {int(row): int(weight) for row, weight in zip(rows, weights, strict=True) if weight > 0}
            assert found == stands_for
            assert set(rows.tolist()) <= set(own)


def drawn(labels: list[float], balance: Any = "auto") -> tuple[set[int], set[int]]:
    """Which windows stand in the first two places of batches of five, and which in the others."""
    uniform = torch.rand(1, 500, 5, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    chosen = balanced(torch.tensor([labels]), uniform, balance)[0]
    return set(chosen[:, :2].unique().tolist()), set(chosen[:, 2:].unique().tolist())


@pytest.mark.parametrize("balance", ["auto", "bits"])
def test_batches_are_half_successes(balance: Any) -> None:
    labels = torch.tensor([[0.0, 1, 0, 0, 1, 0], [1, 1, 1, 1, 1, 1], [0, 0, 0, 0, 0, 0]])
    uniform = torch.rand(3, 500, 5, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    chosen = balanced(labels, uniform, balance)
    assert chosen.shape == (3, 500, 5)
    assert set(chosen[0, :, :2].unique().tolist()) == {1, 4}
    assert set(chosen[0, :, 2:].unique().tolist()) == {0, 2, 3, 5}
    for replica in (1, 2):  # of one kind only
        assert set(chosen[replica].unique().tolist()) == set(range(6))
    counts = torch.bincount(chosen[0, :, 2:].flatten())[torch.tensor([0, 2, 3, 5])]
    assert (counts - 375).abs().max() < 75
    assert torch.equal(balanced(labels[:1], uniform[:1], balance), chosen[:1])


def test_batches_of_real_labels_are_half_from_the_upper_half() -> None:
    # all are above zero: by `Y > 0` every one would be a success
    labels = [0.3, 2.0, 0.1, 5.0, 0.2, 9.0]
    assert drawn(labels) == drawn(labels, "quantiles") == ({1, 3, 5}, {0, 2, 4})
    assert drawn([-value for value in labels]) == ({0, 2, 4}, {1, 3, 5})
    assert drawn([3.0, 1.0, 2.0]) == ({0}, {1, 2})  # the middle one is among the lower
    assert drawn(labels, "bits") == ({3, 5}, {0, 1, 2, 4})  # above 4.55, the middle of .1 and 9
    assert drawn(labels, "none") == (set(range(6)), set(range(6)))


@pytest.mark.parametrize("bits", [(-1.0, 1.0), (0.0, 0.25), (-3.0, -2.0), (0.0, 1.0)])
def test_labels_of_two_values_are_bits_whatever_they_are(bits: tuple[float, float]) -> None:
    low, high = bits
    assert drawn([low, high, low, low]) == ({1}, {0, 2, 3})
    assert drawn([low, high, low, low], "quantiles") == ({0, 1}, {2, 3})  # ties in the order in which they came
    assert drawn([low, low]) == ({0, 1}, {0, 1})
    assert drawn([low]) == ({0}, {0})


def test_each_replica_is_balanced_by_its_own_labels() -> None:
    labels = torch.tensor([[0.0, 1, 0, 0], [0.3, 2, 0.1, 5]])
    uniform = torch.rand(2, 500, 5, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    chosen = balanced(labels, uniform)
    for replica in range(2):
        assert torch.equal(balanced(labels[replica : replica + 1], uniform[replica : replica + 1])[0], chosen[replica])
    assert set(chosen[1, :, :2].unique().tolist()) == {1, 3}
    with pytest.raises(ValueError, match=r"labels \[2, 4\], uniform \[1, 500, 5\]"):
        balanced(labels, uniform[:1])


def test_a_model_balances_as_it_is_told(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((3,), 9)
    weights = {how: fitted(problem, walks, balance=how).networks.flat for how in ("auto", "quantiles", "bits", "none")}
    assert torch.equal(weights["auto"], weights["quantiles"])  # sums are real numbers
    assert not torch.equal(weights["auto"], weights["none"])
    assert not torch.equal(weights["auto"], weights["bits"])


def test_gradient_is_that_of_the_loss() -> None:
    generator = torch.Generator().manual_seed(0)
    outputs = torch.randn(3, 4, dtype=torch.float64, generator=generator, requires_grad=True)
    shares, labels = (torch.rand(shape, dtype=torch.float64, generator=generator) for shape in ((3, 4), (3,)))
    shares[0, 2:] = 0

    def loss(o: Tensor) -> Tensor:
        return sum(  # type: ignore[return-value]
            (labels[i] - sum(shares[i, p] * o[i, p] for p in range(4))) ** 2
            + 0.3 * sum(shares[i, p] * o[i, p].abs() for p in range(4))
            for i in range(3)
        )

    (expected,) = torch.autograd.grad(loss(outputs), outputs)
    torch.testing.assert_close(gradient(outputs.detach(), shares, labels, 0.3), expected)


class Fixed(NetworkUncertainty):
    """Masks and offsets that a test knows."""

    def posterior(self, networks: Stack, problem: Problem, name: str) -> Posterior:
        return FixedPosterior(networks)


class FixedPosterior(Posterior):
    def __init__(self, networks: Stack) -> None:
        self.networks = networks

    def masks(self, rows: int) -> Sequence[Tensor]:
        generator = torch.Generator().manual_seed(7)
        shape = (self.networks.shape.depth, self.networks.members, rows, self.networks.shape.width)
        return (torch.rand(shape, generator=generator) > 0.3).float().unbind()

    def offset(self, inputs: Tensor) -> Tensor:
        return inputs.sum(-1)

    def predictor(self, replica: int) -> Predictor:
        raise NotImplementedError


@pytest.mark.parametrize("kind", ["sum", "success"])
def test_fits_descend_the_loss_as_autograd_and_torchs_adam_do(make_walks: MakeWalks, kind: str) -> None:
    problem, walks = make_walks((3,), 9, kind)
    ours = started(problem, Fixed(), first_steps=4, sparsity=0.2, stride=5)
    weights = [block[0].clone().requires_grad_() for block in ours.networks.blocks]
    adam = torch.optim.Adam(weights, lr=1e-3)
    inputs = ours.features(walks)
    ours.fit(inputs, walks)
    inputs = inputs[0]

    deviation = torch.cat([inputs.std(0, correction=0)[:2], torch.ones(1)])  # the action is a constant
    scaled = (inputs - inputs.mean(0)) / deviation
    steps = every(walks, 5, problem.window)
    uniform = torch.from_numpy(generators((3,), "dnn/batches 0")[0].random((4, 6)))
    masks = FixedPosterior(ours.networks).masks(6 * 8)
    for chosen in balanced(walks.labels, uniform.unsqueeze(0))[0]:
        hidden = rows = scaled[steps.rows[0, chosen]].view(6 * 8, 3)
        for layer in range(2):
            hidden = F.linear(hidden, weights[2 * layer], weights[2 * layer + 1][0]).relu() * masks[layer][0]
        outputs = F.linear(hidden, weights[4], weights[5][0])[:, 0] + rows.sum(-1)
        rewards = (outputs / problem.window).view(6, 8)
        times = steps.weights[0, chosen]
        errors = walks.labels[0, chosen] - (rewards * times).sum(1)
        loss = (errors.square() + 0.2 * (rewards.abs() * times).sum(1)).mean()
        adam.zero_grad()
        loss.backward()
        adam.step()
    for block, expected in zip(ours.networks.blocks, weights, strict=True):
        torch.testing.assert_close(block[0], expected.detach(), atol=2e-6, rtol=1e-5)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("width", [16, 64])
def test_a_replica_is_fitted_alone_as_in_a_batch(
    make_walks: MakeWalks, kind: Callable[[], NetworkUncertainty], width: int
) -> None:
    problem, walks = make_walks((3, 8, 5), 12, "success")
    together = fitted(problem, walks, 8, 12, uncertainty=kind(), width=width)
    for replica, seed in enumerate(problem.seeds):
        alone_problem, alone_walks = make_walks((seed,), 12, "success")
        alone = fitted(alone_problem, alone_walks, 8, 12, uncertainty=kind(), width=width)
        whole, own = together.believe(steps_of(walks, replica)), alone.believe(steps_of(alone_walks, 0))
        for left, right in ((whole.mean[replica], own.mean[0]), (whole.variance[replica], own.variance[0])):
            torch.testing.assert_close(left, right, rtol=1e-4, atol=1e-6)
            assert right.dtype == torch.float32
            assert right.isfinite().all()


@pytest.mark.parametrize("kind", KINDS)
def test_one_seed_gives_one_result(make_walks: MakeWalks, kind: Callable[[], NetworkUncertainty]) -> None:
    problem, walks = make_walks((3, 4), 8)
    one, two = (fitted(problem, walks, uncertainty=kind()) for _ in range(2))
    for left, right in zip(believed(one, walks), believed(two, walks), strict=True):
        assert torch.equal(left.mean, right.mean)
        assert torch.equal(left.variance, right.variance)
        assert left.mean[0].ne(left.mean[1]).all()
        assert left.variance[0].ne(left.variance[1]).all()


def test_what_is_not_finite_is_refused_by_name(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((3, 8, 5), 6)
    labels = walks.labels.clone()
    labels[1, 2] = torch.nan
    with pytest.raises(RunError, match=r"'dnn'.*seed 8 is not finite after fit 1"):
        fitted(problem, replace(walks, labels=labels))
    states = walks.states.clone()
    states[0, 5] = torch.inf
    with pytest.raises(RunError, match=r"seed 3 is not"):
        fitted(problem, replace(walks, states=states))
    made = fitted(problem, walks)
    made.networks.layers[0].weight[2] = torch.nan
    with pytest.raises(RunError, match=r"seed 5 is not finite after fit 2"):
        made.fit(made.features(walks), walks)


def test_it_finds_the_reward_of_steps_from_sums(make_walks: MakeWalks, square: tuple[Steps, Tensor]) -> None:
    problem, walks = make_walks((0,), 60)
    made = fitted(problem, walks, width=32, first_steps=400, batch=16, sparsity=0.0)
    sums = walks.sums(made.believe(steps_of(walks, 0)).mean)[0]
    assert torch.corrcoef(torch.stack([sums.double(), walks.labels[0]]))[0, 1] > 0.95
    assert abs((sums - walks.labels[0]).mean()) < 0.1
    moves, worth = square
    seen = moves.states[:, 0] < 0.2
    mean = made.believe(moves).mean[0]
    ranks = torch.stack([values[seen].argsort().argsort().double() for values in (mean, worth)])
    assert torch.corrcoef(ranks)[0, 1] > 0.9


def test_sparsity_makes_rewards_small(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((0,), 30, "success")
    sizes = []
    for sparsity in (0.0, 0.5):
        made = fitted(problem, walks, first_steps=200, sparsity=sparsity)
        sizes.append(made.believe(steps_of(walks, 0)).mean.abs().mean())
    assert sizes[1] < 0.8 * sizes[0]


def test_later_fits_go_on_from_the_last(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((0,), 20)
    twice, once = fitted(problem, walks, 10, 10), fitted(problem, walks, 10, first_steps=25)
    torch.testing.assert_close(twice.networks.flat, once.networks.flat)  # 20 + 5 steps, in the same batches
    grown = fitted(problem, walks, 10, 20)
    assert not torch.equal(grown.networks.flat, twice.networks.flat)
    before = fitted(problem, walks, 10)
    assert (grown.networks.flat - before.networks.flat).abs().max() < 0.01  # five steps of Adam move no further


def test_inputs_are_standardised_by_what_the_first_fit_saw(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((0, 1), 20)
    made = fitted(problem, walks, learning_rate=1e-12)
    inputs, steps = made.features(walks), steps_of(walks, 0)
    before = made.believe(steps).mean
    made.fit(3 * inputs + 5, walks)
    assert torch.equal(made.believe(steps).mean, before)
    for replica in range(2):  # what networks saw had mean zero and deviation one
        own = made.features(steps_of(walks, replica))
        seen = (own - made._mean[replica]) * made._scale[replica]
        torch.testing.assert_close(seen.mean(0), torch.zeros(3), atol=1e-5, rtol=0)
        torch.testing.assert_close(seen.std(0, correction=0), torch.tensor([1.0, 1.0, 0.0]))


def test_the_order_of_steps_does_not_matter(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((0, 1), 400)
    made = fitted(problem, first(walks, 5))
    steps = steps_of(walks, 1)
    assert len(steps.states) > 4096  # several parts
    order = torch.randperm(len(steps.states), generator=torch.Generator().manual_seed(0))
    moved = made.believe(Steps(steps.states[order], steps.actions[order], steps.next_states[order]))
    there = made.believe(steps)
    torch.testing.assert_close(moved.mean, there.mean[:, order])
    torch.testing.assert_close(moved.variance, there.variance[:, order])


@pytest.mark.parametrize("kind", KINDS)
def test_places_are_the_steps_that_came(make_walks: MakeWalks, kind: Callable[[], NetworkUncertainty]) -> None:
    problem, walks = make_walks((0, 1), 12)
    made = model(kind())
    Experience(problem, made).see(walks)
    at = torch.tensor([[5, 5, 0], [17, 2, 90]])
    whole, some = made.estimate(), made.estimate(at)
    torch.testing.assert_close(some.mean, whole.mean.gather(1, at))
    torch.testing.assert_close(some.variance, whole.variance.gather(1, at))
    for replica, steps in enumerate(believed(made, walks)):
        rows = steps.mean.shape[1]
        torch.testing.assert_close(whole.mean[replica, :rows], steps.mean[replica])
        assert (whole.mean[replica, rows:] == 0).all()


def test_before_there_are_trajectories(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((0, 1), 4)
    made = model(Dropout())
    experience = Experience(problem, made).see(first(walks, 0))
    found = made.believe(steps_of(walks, 0))
    assert found.mean.isfinite().all()
    assert (found.variance > 0).any()
    experience.see(walks)  # the first fit, with its own number of steps
    assert made.networks.flat.equal(fitted(problem, walks, uncertainty=Dropout()).networks.flat)


def test_a_window_without_a_label_is_no_evidence(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((4, 5), 12)
    none = torch.zeros_like(walks.labels, dtype=torch.bool)
    half = none.clone()
    half[0, ::2] = True  # replica 1 has no label at all
    part = replace(walks, labelled=half, labels=torch.where(half, walks.labels, 0))
    for standardise in (False, True):
        untouched, made = (started(problem, standardise=standardise) for _ in range(2))
        made.fit(made.features(part), part)
        for before, after in zip(untouched.networks.blocks, made.networks.blocks, strict=True):
            assert torch.equal(before[1], after[1])
        assert any(
            not torch.equal(before[0], after[0])
            for before, after in zip(untouched.networks.blocks, made.networks.blocks, strict=True)
        )
    made.fit(made.features(walks), walks)
    assert made._units._known.all()
    fewer = fitted(problem, part, steps=1, first_steps=1)
    every_one = fitted(problem, replace(part, labelled=None), steps=1, first_steps=1)
    pairs = zip(believed(fewer, walks), believed(every_one, walks), strict=True)
    for replica, (few, all_) in enumerate(pairs):
        assert few.variance[replica].mean() > 1.2 * all_.variance[replica].mean()


@pytest.mark.parametrize("balance", ["auto", "bits", "quantiles", "none"])
def test_batches_hold_no_window_without_a_label(balance: Any) -> None:
    generator = torch.Generator().manual_seed(0)
    labels = torch.randn(3, 9, generator=generator)
    labelled = torch.rand(3, 9, generator=generator) < 0.5
    labelled[:, 0] = True
    drawn = balanced(torch.where(labelled, labels, 0), torch.rand(3, 40, 6, generator=generator), balance, labelled)
    for own, known in zip(drawn, labelled, strict=True):
        assert set(own.flatten().tolist()) == set(known.nonzero().flatten().tolist())


def test_a_network_of_ones_own_is_fitted_as_perceptrons_are(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((4, 5), 12)
    plain = started(problem, Ensemble(2), depth=1)
    other = started(problem, Ensemble(2), network=Perceptron((16,), "relu"))
    for to, of in ((other.networks, plain.networks), (other._posterior._priors, plain._posterior._priors)):  # type: ignore[attr-defined]
        states = [of.state(m) for m in range(4)]  # type: ignore[union-attr]
        for view, name in zip(to.blocks, states[0], strict=True):
            view.copy_(torch.stack([state[name] for state in states]))
    for made in (plain, other):
        made.fit(made.features(walks), walks)
    for one, same in zip(believed(plain, walks), believed(other, walks), strict=True):
        torch.testing.assert_close(same.mean, one.mean, rtol=1e-3, atol=1e-6)
        torch.testing.assert_close(same.variance, one.variance, rtol=1e-3, atol=1e-8)


@pytest.mark.parametrize("likelihood", ["gaussian", "logistic"])
def test_a_network_of_ones_own_goes_on_from_its_state(make_walks: MakeWalks, likelihood: Any) -> None:
    problem, walks = make_walks((4,), 9)
    walks = replace(walks, labels=(walks.labels > walks.labels.median()).double())
    keys: dict[str, Any] = {"network": Module("torchrl.modules:MLP", {"num_cells": [8]}), "likelihood": likelihood}
    one, other = (started(problem, Ensemble(2), **keys) for _ in range(2))
    inputs = one.features(walks)
    one.fit(inputs, walks)
    other.load_state_dict(one.state_dict())
    for made in (one, other):
        made.fit(inputs, walks)
    assert torch.equal(believed(one, walks)[0].mean, believed(other, walks)[0].mean)


@pytest.mark.parametrize("uncertainty", [Dropout(), LastLayer()])
def test_who_looks_into_perceptrons_refuses_others(make_walks: MakeWalks, uncertainty: NetworkUncertainty) -> None:
    problem, _ = make_walks((4,), 2)
    with pytest.raises(UserError, match=r"uncertainty=\w+ looks into perceptrons.*'dnn'.*take uncertainty=ensemble"):
        started(problem, uncertainty, network=Perceptron())
