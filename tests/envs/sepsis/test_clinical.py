"""The clinical surrogates of section 3.3, against a plain reading of every state's digits."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.seams import FeatureMap
from credit.core.steps import Steps
from credit.envs.sepsis.features import Clinical, HealthRegime, Patient

HEALTHY, INTERMEDIATE, SEVERE = 0, 1, 2


def state(diabetes: int, vitals: tuple[int, int, int, int], treatments: tuple[int, int, int] = (0, 0, 0)) -> int:
    """The number of a state; vitals are 0, 1, 2 for low, normal, high."""
    number = diabetes
    for base, digit in zip((3, 3, 3, 3, 2, 2, 2), vitals + treatments, strict=True):
        number = number * base + digit
    return number


def told(features: FeatureMap, *steps: tuple[int, int]) -> list[list[float]]:
    states, actions = (torch.tensor(part) for part in zip(*steps, strict=True))
    found: list[list[float]] = features(Steps(states, actions, states)).tolist()
    return found


def test_clinical_features_by_hand() -> None:
    well, ill = state(0, (1, 1, 1, 1)), state(1, (0, 2, 1, 2), (1, 0, 1))
    assert (well, ill) == (40 * 8, 81 * 8 + (0 * 27 + 2 * 9 + 1 * 3 + 2) * 8 + 5)
    found = told(Clinical(), (well, 0), (well, 7), (ill, 2), (ill, 6))
    expected = [[1, 0, 0, 0, 0], [1, 0, 0, 1, 0], [1, 3 / 4, 2 / 3, 1 / 3, 1], [1, 3 / 4, 2 / 3, 2 / 3, 1]]
    for row, by_hand in zip(found, expected, strict=True):
        assert row == pytest.approx(by_hand)


@pytest.mark.parametrize(
    ("vitals", "treatments", "regime"),
    [
        ((1, 1, 1, 1), (0, 0, 0), HEALTHY),
        ((1, 1, 1, 1), (0, 1, 0), INTERMEDIATE),  # well, but not yet off treatment
        ((1, 0, 1, 1), (0, 0, 0), INTERMEDIATE),
        ((1, 0, 1, 2), (1, 1, 1), INTERMEDIATE),
        ((1, 0, 0, 2), (0, 0, 0), SEVERE),
        ((2, 0, 0, 2), (1, 1, 1), SEVERE),
    ],
)
@pytest.mark.parametrize("diabetes", [0, 1])
def test_regimes_by_hand(
    vitals: tuple[int, int, int, int], treatments: tuple[int, int, int], regime: int, diabetes: int
) -> None:
    patient = state(diabetes, vitals, treatments)
    intensities = {0: 0, 1: 1, 2: 1, 4: 1, 3: 2, 5: 2, 6: 2, 7: 2}
    rows = told(HealthRegime(), *((patient, action) for action in intensities))
    for row, intensity in zip(rows, intensities.values(), strict=True):
        assert sum(row) == 1
        assert row.index(1) == regime * 3 + intensity


def test_every_pair_against_its_digits(make_problem: Callable[..., Problem]) -> None:
    problem = make_problem((0,), states=1296, actions=8, window=5)
    clinical, health = Clinical(), HealthRegime()
    for features in (clinical, health):
        features.start(problem)
    linear, cells = clinical(problem.cells.steps(problem.device)), health(problem.cells.steps(problem.device))
    assert linear.shape == (10368, 5)
    assert cells.shape == (10368, 9)
    assert linear.dtype == cells.dtype == torch.float64
    expected = torch.zeros(10368, 6, dtype=torch.float64)
    for pair in range(10368):
        number, action = divmod(pair, 8)
        digits = []
        for base in (2, 2, 2, 3, 3, 3, 3, 2):
            number, digit = divmod(number, base)
            digits.append(digit)
        wrong, treated, given = sum(d != 1 for d in digits[3:7]), sum(digits[:3]), bin(action).count("1")
        regime = SEVERE if wrong >= 3 else HEALTHY if wrong == treated == 0 else INTERMEDIATE
        expected[pair] = torch.tensor(
            [1, wrong / 4, treated / 3, given / 3, digits[7], regime * 3 + min(given, 2)]
        ).double()
    torch.testing.assert_close(linear, expected[:, :5], atol=1e-6, rtol=0)
    assert torch.equal(cells.argmax(-1), expected[:, 5].long())
    assert (cells.sum(-1) == 1).all()
    assert (cells.sum(0) > 0).all()  # no cell is always empty


def test_the_patient_is_its_digits_one_hot_without_the_action() -> None:
    ill = state(1, (0, 2, 1, 2), (1, 0, 1))
    diabetes, vitals, treated = [0, 1], [1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 0, 1], [0, 1, 1, 0, 0, 1]
    by_hand = [*diabetes, *vitals, *treated]
    assert told(Patient(), (ill, 0), (ill, 7)) == [by_hand, by_hand]
    states = torch.arange(1296)
    rows = Patient()(Steps(states, states * 0, states))
    assert rows.dtype == torch.float64
    assert len(rows.unique(dim=0)) == 1296
    assert rows.sum(-1).unique().tolist() == [8]


@pytest.mark.parametrize("diabetes", [0, 1])
def test_features_of_the_patient_that_a_step_leads_to(diabetes: int) -> None:
    # The action is in the treatments of s': neither s nor a is looked at.
    well, ill = state(diabetes, (1, 1, 1, 1)), state(diabetes, (0, 2, 1, 2), (1, 0, 1))
    weaned = state(diabetes, (1, 1, 0, 1), (0, 1, 0))
    arrivals = torch.tensor([well, ill, weaned])
    for states, actions in ((arrivals * 0, arrivals * 0), (arrivals.flip(0), arrivals * 0 + 7)):
        steps = Steps(states, actions, arrivals)
        clinical, health = Clinical("next_state"), HealthRegime("next_state")
        assert tuple(clinical.looks_at) == tuple(health.looks_at) == ("next_state",)
        found = [pytest.approx(row) for row in clinical(steps).tolist()]
        assert found == [[1, 0, 0, diabetes], [1, 3 / 4, 2 / 3, diabetes], [1, 1 / 4, 1 / 3, diabetes]]
        cells = health(steps)
        assert cells.shape == (3, 9)
        assert cells.sum(-1).tolist() == [1, 1, 1]
        assert cells.argmax(-1).tolist() == [HEALTHY * 3 + 0, SEVERE * 3 + 2, INTERMEDIATE * 3 + 1]
    assert set(Clinical().looks_at) == set(HealthRegime().looks_at) == {"state", "action"}


@pytest.mark.parametrize("features", [Clinical(), Clinical("next_state"), HealthRegime(), Patient()])
@pytest.mark.parametrize(("states", "actions"), [(10, 3), (1296, 3), (1295, 8)])
def test_other_environments_have_no_patients(
    make_problem: Callable[..., Problem], features: FeatureMap, states: int, actions: int
) -> None:
    known = rf"{type(features).__name__} knows patients.*1296 states, 8 actions"
    with pytest.raises(UserError, match=rf"{known}.*{states} states and {actions} actions"):
        features.start(make_problem((0,), states=states, actions=actions))
    features.start(make_problem((0,), states=1296, actions=8))


def test_thirds_have_all_their_digits() -> None:
    assert told(Clinical(), (state(0, (1, 1, 1, 1), (1, 0, 1)), 3)) == [[1, 0, 2 / 3, 2 / 3, 0]]


def test_leading_dimensions_are_kept() -> None:
    steps = Steps(*(torch.zeros(2, 6, 5, dtype=torch.int64) for _ in range(3)))
    assert Clinical()(steps).shape == (2, 6, 5, 5)
    assert HealthRegime()(steps).shape == (2, 6, 5, 9)
