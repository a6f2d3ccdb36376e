"""How patients move in the sepsis simulator: every rule by hand, and that every key does what it says."""

from __future__ import annotations

import pytest
import torch

from credit.envs.sepsis.environment import Sepsis, decode, encode

BASE = Sepsis()


def row(env: Sepsis, digits: list[int], action: int) -> dict[tuple[int, ...], float]:
    """Vitals of s' → probability; diabetes must stay, and the treatments must be the action."""
    index = int(encode(torch.tensor(digits))) * 8 + action
    found = {}
    for state, probability in zip(env.mdp.next_states[index], env.mdp.probabilities[index].tolist(), strict=True):
        after = decode(state).tolist()
        assert after[0] == digits[0]
        assert after[5:] == [action >> 2 & 1, action >> 1 & 1, action & 1]
        if probability > 0:
            found[tuple(after[1:5])] = probability
    return found


def level(moves: dict[tuple[int, ...], float], vital: int) -> list[float]:
    """The distribution of one vital (0 heart rate, 1 blood pressure, 2 oxygen, 3 glucose) over low, normal, high."""
    return [sum(p for vitals, p in moves.items() if vitals[vital] == at) for at in range(3)]


@pytest.mark.parametrize(
    ("digits", "action", "vital", "expected"),
    [
        # diabetes, heart rate, blood pressure, oxygen, glucose, antibiotics, vasopressors, ventilator
        ([0, 1, 1, 1, 1, 0, 0, 0], 0, 0, [0.1, 0.8, 0.1]),  # untreated vitals fluctuate
        ([0, 0, 1, 1, 1, 0, 0, 0], 0, 0, [0.9, 0.1, 0.0]),  # a move off the scale stays
        ([0, 1, 2, 1, 1, 0, 0, 0], 0, 1, [0.0, 0.1, 0.9]),
        ([0, 1, 1, 1, 1, 0, 0, 0], 0, 2, [0.1, 0.8, 0.1]),
        ([0, 1, 1, 1, 1, 0, 0, 0], 0, 3, [0.1, 0.8, 0.1]),
        ([1, 1, 1, 1, 1, 0, 0, 0], 0, 3, [0.3, 0.4, 0.3]),  # glucose with diabetes
        ([1, 1, 1, 1, 2, 0, 0, 0], 5, 3, [0.0, 0.3, 0.7]),  # … antibiotics and ventilator do not matter to it
        ([0, 2, 1, 1, 1, 0, 0, 0], 4, 0, [0.0, 0.5, 0.5]),  # antibiotics
        ([0, 1, 1, 1, 1, 0, 0, 0], 4, 0, [0.0, 1.0, 0.0]),  # … and no fluctuation
        ([0, 0, 1, 1, 1, 1, 0, 0], 4, 0, [1.0, 0.0, 0.0]),
        ([0, 1, 2, 1, 1, 0, 0, 0], 4, 1, [0.0, 0.5, 0.5]),
        ([0, 1, 1, 1, 1, 1, 0, 0], 0, 0, [0.0, 0.9, 0.1]),  # antibiotics withdrawn
        ([0, 1, 1, 1, 1, 1, 0, 0], 0, 1, [0.0, 0.9, 0.1]),
        ([0, 0, 2, 1, 1, 1, 0, 0], 0, 0, [1.0, 0.0, 0.0]),
        ([0, 1, 1, 0, 1, 0, 0, 0], 1, 2, [0.3, 0.7, 0.0]),  # ventilator
        ([0, 1, 1, 2, 1, 0, 0, 1], 1, 2, [0.0, 0.0, 1.0]),
        ([0, 1, 1, 1, 1, 0, 0, 1], 0, 2, [0.1, 0.9, 0.0]),  # ventilator withdrawn
        ([0, 1, 1, 0, 1, 0, 0, 1], 0, 2, [1.0, 0.0, 0.0]),
        ([0, 1, 0, 1, 1, 0, 0, 0], 2, 1, [0.3, 0.7, 0.0]),  # vasopressors without diabetes
        ([0, 1, 1, 1, 1, 0, 0, 0], 2, 1, [0.0, 0.3, 0.7]),
        ([0, 1, 2, 1, 1, 0, 0, 0], 2, 1, [0.0, 0.0, 1.0]),
        ([0, 1, 1, 1, 1, 0, 0, 0], 2, 3, [0.0, 1.0, 0.0]),  # … glucose holds
        ([1, 1, 0, 1, 1, 0, 0, 0], 2, 1, [0.1, 0.5, 0.4]),  # … with diabetes
        ([1, 1, 1, 1, 1, 0, 0, 0], 2, 1, [0.0, 0.1, 0.9]),
        ([1, 1, 1, 1, 1, 0, 0, 0], 2, 3, [0.0, 0.5, 0.5]),
        ([1, 1, 1, 1, 2, 0, 1, 0], 2, 3, [0.0, 0.0, 1.0]),
        ([0, 1, 1, 1, 1, 0, 1, 0], 0, 1, [0.1, 0.9, 0.0]),  # vasopressors withdrawn
        ([1, 1, 2, 1, 1, 0, 1, 0], 0, 1, [0.0, 0.05, 0.95]),
        ([0, 1, 0, 1, 1, 0, 1, 0], 0, 1, [1.0, 0.0, 0.0]),
        ([0, 1, 1, 1, 1, 0, 1, 0], 0, 3, [0.1, 0.8, 0.1]),  # … glucose fluctuates again
        ([0, 1, 2, 1, 1, 0, 0, 0], 6, 1, [0.0, 0.15, 0.85]),  # antibiotics first, then vasopressors raise
        ([0, 1, 1, 1, 1, 1, 0, 0], 2, 1, [0.0, 0.27, 0.73]),  # antibiotics withdrawn .1, then raised .7
        ([0, 1, 2, 1, 1, 0, 1, 0], 4, 1, [0.05, 0.5, 0.45]),  # lowered .5, then vasopressors withdrawn .1
        ([0, 1, 1, 1, 1, 1, 1, 0], 0, 1, [0.09, 0.82, 0.09]),  # both withdrawn: .9·.1 down, .1·.9 up
    ],
)
def test_transition_rules_by_hand(digits: list[int], action: int, vital: int, expected: list[float]) -> None:
    assert level(row(BASE, digits, action), vital) == pytest.approx(expected, abs=1e-12)


def test_vitals_move_independently() -> None:
    moves = row(BASE, [0, 2, 1, 0, 1, 0, 0, 0], 5)  # antibiotics and ventilator
    assert moves == pytest.approx(
        {
            (heart, 1, oxygen, glucose): 0.5 * (0.7 if oxygen else 0.3) * (0.8 if glucose == 1 else 0.1)
            for heart in (1, 2)
            for oxygen in (0, 1)
            for glucose in range(3)
        }
    )


@pytest.mark.parametrize(
    ("key", "value", "digits", "action", "vital", "expected"),
    [
        ("fluctuation", 0.2, [0, 1, 1, 1, 1, 0, 0, 0], 0, 0, [0.2, 0.6, 0.2]),
        ("fluctuation", 0.2, [0, 1, 1, 1, 1, 0, 0, 0], 0, 1, [0.2, 0.6, 0.2]),
        ("fluctuation", 0.2, [0, 1, 1, 1, 1, 0, 0, 0], 0, 2, [0.2, 0.6, 0.2]),
        ("glucose_fluctuation", 0.2, [0, 1, 1, 1, 1, 0, 0, 0], 0, 3, [0.2, 0.6, 0.2]),
        ("glucose_fluctuation_diabetes", 0.2, [1, 1, 1, 1, 1, 0, 0, 0], 0, 3, [0.2, 0.6, 0.2]),
        ("antibiotics_lower", 0.8, [0, 2, 1, 1, 1, 0, 0, 0], 4, 0, [0.0, 0.8, 0.2]),
        ("antibiotics_lower", 0.8, [0, 1, 2, 1, 1, 0, 0, 0], 4, 1, [0.0, 0.8, 0.2]),
        ("antibiotics_withdrawn", 0.3, [0, 1, 1, 1, 1, 1, 0, 0], 0, 0, [0.0, 0.7, 0.3]),
        ("ventilator_raises", 1.0, [0, 1, 1, 0, 1, 0, 0, 0], 1, 2, [0.0, 1.0, 0.0]),
        ("ventilator_withdrawn", 0.4, [0, 1, 1, 1, 1, 0, 0, 1], 0, 2, [0.4, 0.6, 0.0]),
        ("vasopressors_raise", 0.2, [0, 1, 0, 1, 1, 0, 0, 0], 2, 1, [0.8, 0.2, 0.0]),
        ("vasopressors_low_to_normal", 0.2, [1, 1, 0, 1, 1, 0, 0, 0], 2, 1, [0.4, 0.2, 0.4]),
        ("vasopressors_low_to_high", 0.2, [1, 1, 0, 1, 1, 0, 0, 0], 2, 1, [0.3, 0.5, 0.2]),
        ("vasopressors_normal_to_high", 0.2, [1, 1, 1, 1, 1, 0, 0, 0], 2, 1, [0.0, 0.8, 0.2]),
        ("vasopressors_glucose", 0.2, [1, 1, 1, 1, 0, 0, 0, 0], 2, 3, [0.8, 0.2, 0.0]),
        ("vasopressors_withdrawn", 0.6, [0, 1, 1, 1, 1, 0, 1, 0], 0, 1, [0.6, 0.4, 0.0]),
        ("vasopressors_withdrawn_diabetes", 0.6, [1, 1, 1, 1, 1, 0, 1, 0], 0, 1, [0.6, 0.4, 0.0]),
    ],
)
def test_transition_keys(
    key: str, value: float, digits: list[int], action: int, vital: int, expected: list[float]
) -> None:
    changed = Sepsis(**{key: value})  # type: ignore[arg-type]
    assert level(row(changed, digits, action), vital) == pytest.approx(expected, abs=1e-12)
    assert torch.equal(changed.mdp.initial, BASE.mdp.initial)
    assert torch.equal(changed.mdp.reward_next, BASE.mdp.reward_next)
