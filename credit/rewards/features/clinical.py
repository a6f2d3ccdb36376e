"""Feature maps on the patients of the sepsis simulator."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.envs.sepsis import RADIX, abnormal, decode, treatments
from credit.interfaces import FeatureMap
from credit.types import FLOAT, Problem, Steps


class Clinical(FeatureMap):
    """(1, A/4, U/3, intensity/3, diabetes), the clinical linear surrogate (3.3): A abnormal vitals, U treatments."""

    domain: ClassVar = "tabular"

    def start(self, problem: Problem) -> None:
        """Nothing to learn."""

    def __call__(self, steps: Steps) -> Tensor:
        """Features [..., 5]; intensity is the number of treatments in the action."""
        diabetes, wrong = decode(steps.states)[..., 0], abnormal(steps.states)
        parts = (torch.ones_like(wrong), wrong, treatments(steps.states), treatments(steps.actions), diabetes)
        return torch.stack(parts, dim=-1) / torch.tensor([1, 4, 3, 3, 1], dtype=FLOAT, device=wrong.device)


class HealthRegime(FeatureMap):
    """A 3 × 3 table over the patient's regime and the action's intensity (3.3).

    Regimes: healthy (A = 0 and U = 0), severe (A ≥ 3), intermediate. Intensities: none, one treatment, two or more.
    """

    domain: ClassVar = "tabular"

    def start(self, problem: Problem) -> None:
        """Nothing to learn."""

    def __call__(self, steps: Steps) -> Tensor:
        """One-hot vectors [..., 9], regime first."""
        wrong, treated = abnormal(steps.states), treatments(steps.states)
        regime = torch.where((wrong == 0) & (treated == 0), 0, torch.where(wrong >= 3, 2, 1))
        intensity = treatments(steps.actions).clamp(max=2)
        return torch.nn.functional.one_hot(regime * 3 + intensity, 9).to(FLOAT)


class Patient(FeatureMap):
    """The eight digits of the state, each one-hot: all that there is to know of a patient, with its structure."""

    domain: ClassVar = "tabular"

    def start(self, problem: Problem) -> None:
        """Nothing to learn."""

    def __call__(self, steps: Steps) -> Tensor:
        """Zeros and ones [..., 20]: two for diabetes, three a vital, two a treatment."""
        digits = zip(decode(steps.states).unbind(-1), RADIX.values(), strict=True)
        return torch.cat([torch.nn.functional.one_hot(digit, radix) for digit, radix in digits], dim=-1).to(FLOAT)
