"""Feature maps on the patients of the sepsis simulator."""

from __future__ import annotations

from collections.abc import Collection
from typing import ClassVar, Literal

import torch
from torch import Tensor

from credit.core.cells import PAIRS, Axis
from credit.core.problem import FLOAT, Problem
from credit.core.seams import FeatureMap
from credit.core.steps import Steps
from credit.envs.sepsis.environment import RADIX, SepsisKnowledge, abnormal, decode, require_patients, treatments

Whom = Literal["state", "next_state"]  # whom a map describes: the patient before the step, or the one it leads to


class _Patients(FeatureMap):
    """What works on patients alone."""

    observations: ClassVar = "finite"
    actions: ClassVar = "finite"
    knows: ClassVar = SepsisKnowledge

    def start(self, problem: Problem) -> None:
        """Nothing to learn.

        Raises:
            UserError: the states are no patients.
        """
        require_patients(type(self).__name__, problem)


class _OfPatient(_Patients):
    """What describes a patient before or after a step."""

    def __init__(self, patient: Whom = "state") -> None:
        self.patient = patient
        self.looks_at: Collection[Axis] = PAIRS if patient == "state" else ("next_state",)

    def patients(self, steps: Steps) -> tuple[Tensor, Tensor]:
        """The states that are described, and how many treatments the action gives (it sets those of s')."""
        if self.patient == "next_state":
            return steps.next_states, treatments(steps.next_states)
        return steps.states, treatments(steps.actions)


class Clinical(_OfPatient):
    """(1, A/4, U/3, intensity/3, diabetes), the clinical linear surrogate (3.3): A abnormal vitals, U treatments.

    Of s', whose treatments are the action, intensity would be U once more and is left out.

    Args:
        patient: `state` for the patient before the step (and the action), `next_state` for the one it leads to.
    """

    def __call__(self, steps: Steps) -> Tensor:
        """Features [..., 5], or [..., 4] of s'; intensity is the number of treatments in the action."""
        states, intensity = self.patients(steps)
        wrong = abnormal(states).to(FLOAT) / 4
        own = (intensity.to(FLOAT) / 3,) if self.patient == "state" else ()
        parts = (torch.ones_like(wrong), wrong, treatments(states).to(FLOAT) / 3, *own, decode(states)[..., 0])
        return torch.stack(parts, dim=-1)


class HealthRegime(_OfPatient):
    """A 3 × 3 table over the patient's regime and the action's intensity (3.3).

    Regimes: healthy (A = 0 and U = 0), severe (A ≥ 3), intermediate. Intensities: none, one treatment, two or more.

    Args:
        patient: `state` for the patient before the step (and the action), `next_state` for the one it leads to.
    """

    def __call__(self, steps: Steps) -> Tensor:
        """One-hot vectors [..., 9], regime first."""
        states, intensity = self.patients(steps)
        wrong, treated = abnormal(states), treatments(states)
        regime = torch.where((wrong == 0) & (treated == 0), 0, torch.where(wrong >= 3, 2, 1))
        return torch.nn.functional.one_hot(regime * 3 + intensity.clamp(max=2), 9).to(FLOAT)


class Patient(_Patients):
    """The eight digits of the state, each one-hot: all that there is to know of a patient, with its structure."""

    looks_at: Collection[Axis] = frozenset[Axis]({"state"})

    def __call__(self, steps: Steps) -> Tensor:
        """Zeros and ones [..., 20]: two for diabetes, three a vital, two a treatment."""
        digits = zip(decode(steps.states).unbind(-1), RADIX.values(), strict=True)
        return torch.cat([torch.nn.functional.one_hot(digit, radix) for digit, radix in digits], dim=-1).to(FLOAT)
