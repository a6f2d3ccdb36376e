"""Ridge on steps against the normal equations row by row, and the oracle's model of steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from credit.core.interfaces import FeatureMap
from credit.core.trajectories import ContinuousProblem, Moves, Trajectories
from credit.recovery.models.step_linear import StepLinear
from credit.recovery.models.step_primitive import StepPrimitive
from torch import Tensor

from credit.core.errors import RunError
from credit.recovery.features.motion import Motion

MakeWalks = Callable[..., tuple[ContinuousProblem, Trajectories]]


class Quarters(FeatureMap):
    """One-hot quarter of the square."""

    def start(self, problem: ContinuousProblem) -> None:
        """Nothing."""

    def __call__(self, steps: Moves) -> Tensor:  # type: ignore[override]
        return torch.nn.functional.one_hot((steps.states > 0).long() @ torch.tensor([2, 1]), 4).float()


@pytest.mark.parametrize("features", [Quarters(), Motion()])
@pytest.mark.parametrize("penalty", [0.1, 1.0])
def test_it_is_the_ridge_solution(make_walks: MakeWalks, features: FeatureMap, penalty: float) -> None:
    problem, walks = make_walks((3, 4), 15)
    model = StepLinear("box", features, penalty, unit=5.0)
    model.start(problem)
    inputs = model.features(walks)
    model.fit(inputs, walks)
    mean, variance = model.predict(inputs, walks)
    assert mean.dtype == variance.dtype == torch.float32
    size = inputs.shape[1]
    for replica in range(2):
        x, own = np.zeros((15, size)), (walks.replica == replica).nonzero().flatten().tolist()
        for row in own:
            x[walks.number[row]] += inputs[row].double().numpy() / 5
        y = walks.labels[replica].numpy()
        theta = np.linalg.solve(x.T @ x + penalty * np.eye(size), x.T @ y)
        residual = np.mean((y - x @ theta) ** 2)
        np.testing.assert_allclose(model.theta(replica), theta, atol=1e-10)
        for row in own[::17]:
            phi = inputs[row].double().numpy() / 5
            spread = residual * phi @ np.linalg.inv(x.T @ x + penalty * np.eye(size)) @ phi
            assert mean[row].item() == pytest.approx(phi @ theta, abs=1e-6)
            assert variance[row].item() == pytest.approx(spread, rel=1e-5)


def test_a_box_that_was_never_entered_has_no_reward_and_the_largest_variance(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((3,), 15)
    left = walks.states.clone()
    left[:, 0] = -left[:, 0].abs()
    model = StepLinear("box", Quarters())
    model.start(problem)
    walks = replace(walks, states=left)
    model.fit(model.features(walks), walks)
    places = torch.tensor([[-0.5, -0.5], [-0.5, 0.5], [0.5, -0.5]])
    moves = Moves(places, places[:, :1], places, torch.zeros(3, dtype=torch.int64))
    mean, variance = model.predict(model.features(moves), moves)
    assert mean[2] == 0
    assert (mean[:2] != 0).all()
    assert variance[2] > variance[:2].max()


def test_a_replica_is_fitted_alone_as_in_a_batch(make_walks: MakeWalks) -> None:
    seeds = (3, 8, 5)
    problem, walks = make_walks(seeds, 12)
    model = StepLinear("box", Motion())
    model.start(problem)
    model.fit(model.features(walks), walks)
    whole = model.predict(model.features(walks), walks)
    for replica, seed in enumerate(seeds):
        alone_problem, alone_walks = make_walks((seed,), 12)
        model.start(alone_problem)
        model.fit(model.features(alone_walks), alone_walks)
        for left, right in zip(whole, model.predict(model.features(alone_walks), alone_walks), strict=True):
            torch.testing.assert_close(left[walks.replica == replica], right)


def test_nothing_is_known_before_a_fit(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((3,), 5)
    model = StepLinear("box", Quarters())
    model.start(problem)
    for part in model.predict(model.features(walks), walks):
        assert torch.equal(part, torch.zeros(len(walks)))


def test_a_label_that_is_not_finite_is_refused_by_name(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((3, 8), 5)
    labels = walks.labels.clone()
    labels[1, 0] = torch.inf
    model = StepLinear("box", Quarters())
    model.start(problem)
    with pytest.raises(RunError, match=r"'box'.*seed 8 is not finite after 5 trajectories"):
        model.fit(model.features(walks), replace(walks, labels=labels))


def test_the_oracle_says_what_it_was_shown(make_walks: MakeWalks) -> None:
    problem, walks = make_walks((3, 4), 5)
    model = StepPrimitive()
    assert model.sees_primitive
    model.start(problem)
    inputs = model.features(walks)
    assert inputs.shape == (len(walks), 0)
    with pytest.raises(ValueError, match="not shown"):
        model.fit(inputs, walks)
    shown = replace(walks, primitive=torch.arange(len(walks)).double())
    model.fit(inputs, shown)
    mean, variance = model.predict(inputs, shown)
    assert torch.equal(mean, torch.arange(len(walks)).float())
    assert torch.equal(variance, torch.zeros(len(walks)))
    elsewhere = Moves(walks.states[:3], walks.actions[:3], walks.next_states[:3], walks.replica[:3])
    mean, variance = model.predict(inputs[:3], elsewhere)
    assert mean.isnan().all()
    assert torch.equal(variance, torch.zeros(3))
