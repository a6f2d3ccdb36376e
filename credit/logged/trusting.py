"""Whether the reference deserves the trust that the mixture puts in it, by labels that were held out.

The mixture takes the reference for unbiased: a surrogate that lies far from it counts little. Where the reference lacks
what moves the labels, that is the wrong way round, and nothing in the weights shows it; held-out labels do.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from credit.logged.models import Model
from credit.logged.recovered import AnyModel, Recovered

if TYPE_CHECKING:
    from credit.logged.scoring import Judged

SURE = 3.0  # standard errors over units, from which on a model is better than the mixture
FAR = 0.05  # of R², below which that is not worth a word


def warnings(found: Recovered, judged: Judged) -> Iterator[str]:
    """A sentence for each surrogate that predicts held-out labels far better than the mixture, or that has columns
    which the reference has not."""
    reference, *others = found.models
    if not others:
        return
    scores = judged.r_squared[0]
    for at, model in enumerate(others, 1):
        missing = sorted(_features(model) - _features(reference))
        lacks = f"the reference has no term of {', '.join(missing)}, which {model.name} has" if missing else ""
        if scores[at] - scores[-1] > FAR and _better(found, judged, at) > SURE:
            yield (
                f"{model.name} predicts labels that were held out far better than the mixture does (R² "
                f"{scores[at]:.3f} and {scores[-1]:.3f}), which trusts the reference (R² {scores[0]:.3f}) most: "
                + (lacks or "the reference is too poor, or too flexible for so few windows")
                + "; give a reference with all that moves the labels, and read numbers of the mixture with doubt"
            )
        elif lacks:
            yield f"{lacks}: the mixture believes in little of it; a reference should have every column"


def _features(model: AnyModel) -> set[str]:
    """The features that a model looks at."""
    if isinstance(model, Model):
        return {name for block in model.terms.blocks for name in block.features}
    return set(model.terms.spaces.roles.features)


def _better(found: Recovered, judged: Judged, at: int) -> float:
    """By how many standard errors, over what is resampled, squared errors of a model are smaller than the mixture's."""
    label = found.panel.windows.label
    gain = (label - judged.held_out[-1]) ** 2 - (label - judged.held_out[at]) ** 2
    known = np.isfinite(gain)
    sums = np.bincount(found.units.of[known], weights=gain[known], minlength=len(found.units))
    spread = sums.std() * np.sqrt(len(sums))
    return float(sums.sum() / spread) if spread > 0 else 0.0
