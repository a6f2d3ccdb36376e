"""Features by a formula: `1 + s + a + s:a`."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.core.cells import LARGEST
from credit.core.errors import RunError, UserError
from credit.core.problem import FLOAT, Problem
from credit.core.seams import FeatureMap
from credit.core.steps import Steps
from credit.core.windows import Windows
from credit.recovery.features.coordinates import Coordinates
from credit.recovery.features.terms import Parsed


class Formula(FeatureMap):
    """The terms of a formula in the grammar of R, as the package `formulaic` reads it.

    `+` adds a term, `:` multiplies, `a*b` is a + b + a:b, and `- 1` or `0 +` leaves out the 1 that is there otherwise.
    Coordinates are called `s` and `a` where states and actions are numbers, `s0`, `s1`, … and `a0`, `a1`, … where they
    are vectors, or as the environment names them. `C(a)` has an indicator for each value of a number, less the first
    where the others and 1 say as much; which values there are is the problem's, not the data's. Functions are log, exp,
    sqrt, abs, sin, cos and tanh; arithmetic stands in them, in `I(…)` or in `{…}`: `{s0**2}`, since alone `s0**2` is
    a power of a term, that term itself, and is refused. Everything is computed in float64.

    Args:
        formula: the terms.

    Raises:
        UserError: it cannot be read, or reaches for something else; at `start`: a coordinate that is not there, or
            values that are not finite.

    Example:
        >>> Formula("1 + s + a + s:a")
        >>> Formula("x + y + exp(-(vx**2 + vy**2)) + {x**2}")
    """

    keeps: ClassVar = ()

    def __init__(self, formula: str = "1 + s + a + s:a") -> None:
        self.formula = formula
        self._parsed = Parsed.of(formula)

    def start(self, problem: Problem) -> None:
        """Find the coordinates, and their values where these are finite."""
        self._blocks = self._parsed.blocks(Coordinates(problem))
        self._kind = FLOAT if problem.finite_states else torch.float32
        if problem.tabular and problem.pairs <= LARGEST:  # no table is larger
            self._require_finite(problem.cells.steps(problem.device), UserError)

    def __call__(self, steps: Steps) -> Tensor:
        """One column a term, and several of categories [..., d]: float64, or float32 where states are vectors.

        Raises:
            RunError: a step that was taken gives a value that is not finite.
        """
        values = torch.cat([block(steps) for block in self._blocks], -1).to(self._kind)
        if isinstance(steps, Windows) and not values.isfinite().all():
            if steps.valid is not None:  # rows that mean nothing may be anything
                values = values.masked_fill(~steps.valid.unsqueeze(-1), 0)
            self._require_finite(steps, RunError)
        return values

    def _require_finite(self, steps: Steps, error: type[UserError | RunError]) -> None:
        """Raise an error with the first term and the first step whose value is not finite."""
        for block in self._blocks:
            wrong = ~block(steps).to(self._kind).isfinite().all(-1)
            if isinstance(steps, Windows) and steps.valid is not None:
                wrong &= steps.valid
            if wrong.any():
                place = tuple(wrong.nonzero()[0].tolist())
                found = [f"{each.name} = {float(each(steps)[place]):g}" for each in block.coordinates]
                where = f" where {', '.join(found)}" if found else ""
                raise error(
                    f"features.formula={self.formula!r}: {block.name} is not a finite number{where}; keep to what is "
                    "defined everywhere, like log(1 + abs(x)) for log(x)"
                )
