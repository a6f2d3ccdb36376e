"""What an assigner says of steps that are in none of its windows."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import torch
from torch import Tensor

from credit.core.belief import Belief
from credit.core.errors import UserError
from credit.core.seams import CreditAssigner
from credit.core.steps import Steps
from credit.core.store import Store
from credit.rivals.rules import Uniform


@runtime_checkable
class Believes(Protocol):
    """An assigner with reward models, like `Recovery`."""

    def believe(self, steps: Steps) -> Belief:
        """What is believed of other steps [n]: the reward is `plan` [R, n]."""


def why_not(assigner: CreditAssigner) -> str | None:
    """Why an assigner has no reward for steps that are in none of its windows; None where it has."""
    name = type(assigner).__name__
    if not isinstance(assigner, Believes):
        return f"{name} shares out the labels of windows, and knows no reward of other steps; use a Recovery"
    if getattr(assigner, "scaler", None) is not None:
        return f"the scaler of {name} scales the rows of its windows, and no other steps; leave it out (scaler=None)"
    return None


def unlabelled(assigner: CreditAssigner, store: Store) -> float:
    """What an assigner that predicts nothing gives a step whose window has no label yet: its rule's own answer.

    An even spread gives the mean label a step; a label on the last step leaves 0 for all before it.
    """
    if not isinstance(assigner, Uniform) or not len(store):
        return 0.0
    windows = store.windows
    return float(windows.labels.sum() / windows.lengths.sum())


def predicted(assigner: CreditAssigner, steps: Steps) -> Tensor:
    """The reward of each of n steps [n], optimism included, as the first replica has it.

    Args:
        assigner: fitted. steps: [n], in the problem's spaces.

    Raises:
        UserError: it has none for other steps, or has seen no windows yet.
    """
    if (reason := why_not(assigner)) is not None:
        raise UserError(reason)
    if (belief := assigner.belief()) is None or not belief.mixed.shape[-1]:
        raise UserError("this assigner has seen no windows yet: `fit` it to some first")
    assert isinstance(assigner, Believes)
    with torch.no_grad():
        return assigner.believe(steps).plan[0]
