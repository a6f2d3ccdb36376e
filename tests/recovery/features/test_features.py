"""What the feature maps of section 3.3 look at."""

from __future__ import annotations

from collections.abc import Callable

import torch

from credit.core.problem import Problem
from credit.core.steps import Steps
from credit.recovery.features.tabular import Bilinear, Identity, Threshold

CPU = torch.device("cpu")
STEPS = Steps(torch.tensor([0, 4, 5, 9]), torch.tensor([2, 0, 1, 2]), torch.tensor([0, 0, 0, 0]))


def test_pairs_are_in_the_order_of_their_index(make_problem: Callable[..., Problem]) -> None:
    steps = make_problem(states=2, actions=3).cells.steps(CPU)
    assert steps.states.tolist() == [0, 0, 0, 1, 1, 1]
    assert steps.actions.tolist() == [0, 1, 2, 0, 1, 2]
    assert steps.pairs(3).tolist() == [0, 1, 2, 3, 4, 5]


def test_identity_has_one_feature_a_pair(make_problem: Callable[..., Problem]) -> None:
    features = Identity()
    features.start(make_problem())
    assert torch.equal(features(make_problem().cells.steps(CPU)), torch.eye(30, dtype=torch.float64))
    assert features(STEPS).argmax(-1).tolist() == [2, 12, 16, 29]


def test_bilinear_features_by_hand(make_problem: Callable[..., Problem]) -> None:
    features = Bilinear()
    features.start(make_problem())
    assert features(STEPS).tolist() == [[1, 0, 2, 0], [1, 4, 0, 0], [1, 5, 1, 5], [1, 9, 2, 18]]


def test_threshold_cells_by_hand(make_problem: Callable[..., Problem]) -> None:
    features = Threshold(threshold=4)
    features.start(make_problem())
    table = features(STEPS)
    assert table.shape == (4, 6)
    assert table.sum(-1).tolist() == [1, 1, 1, 1]
    assert table.argmax(-1).tolist() == [2, 0, 4, 5]  # (low, 2), (low, 0), (high, 1), (high, 2)
    moved = Threshold(threshold=5)
    moved.start(make_problem())
    assert moved(STEPS).argmax(-1).tolist() == [2, 0, 1, 5]


def test_leading_dimensions_are_kept(make_problem: Callable[..., Problem]) -> None:
    steps = Steps(*(torch.zeros(2, 5, 7, dtype=torch.int64) for _ in range(3)))
    for features, size in ((Identity(), 30), (Bilinear(), 4), (Threshold(), 6)):
        features.start(make_problem())
        assert features(steps).shape == (2, 5, 7, size)
        assert features(steps).dtype == torch.float64
