"""How credit is recovered, and what has been: options, and models that were fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from annotated_types import Interval

from credit.core.ranges import NonNegativeInt, PositiveInt
from credit.logged.fits.folds import Folds
from credit.logged.fits.linear import LinearFit
from credit.logged.fits.telling import Telling
from credit.logged.fits.units import Units
from credit.logged.fitted import Alive, Fitted, Linear
from credit.logged.models import Model
from credit.logged.panel import MIXTURE, Floats, Ints, Panel
from credit.logged.registered import Registered

if TYPE_CHECKING:
    from credit.core.seams import Mixer
    from credit.logged.fits.mixture import Theta
    from credit.logged.fits.predicting import RegisteredFit

AnyModel = Model | Registered
FEWEST_DRAWS = 10  # a deviation over B draws is itself off by 1/√(2(B − 1)), here by a quarter: with fewer, no interval


@dataclass(frozen=True)
class Options:
    """How credit is recovered.

    Args:
        draws: B, refits by which uncertainty is told, ten or more for intervals. level: of intervals.
        folds: K, contiguous in time. gap: windows
            between what is fitted and what is tested; None: as long as residuals hang together. residual: how what is
            left of a label is given to its rows. rho: ρ of ar1; None: estimated. nonnegative: no balanced credit below
            0. seed: of the draws.
    """

    draws: PositiveInt = 200
    level: Annotated[float, Interval(gt=0, lt=1)] = 0.9
    folds: Annotated[int, Interval(ge=2)] = 5
    gap: NonNegativeInt | None = None
    residual: Literal["ar1", "uniform"] = "ar1"
    rho: Annotated[float, Interval(gt=-1, lt=1)] | None = None
    nonnegative: bool = False
    seed: NonNegativeInt = 0


@dataclass(frozen=True)
class Recovered:
    """Models that were fitted to a panel, the reference first.

    Attributes:
        panel, models, mixer, options: what was asked. fits: of each model. held: of each fold and model what was fitted
            without it: θ [1 + b, D], or what predicts [K][M]. intercepts, held_intercepts: of bits, else empty.
        folds, units, rho: what was chosen.
        plain: the linear model by which windows are judged, plain_fit: its fit, plain_design: what windows sum of its
            terms [W, D]. They are the reference's, where that is linear.
        telling: what the windows can tell of its columns, by their number in `told_columns`.
    """

    panel: Panel
    models: tuple[AnyModel, ...]
    mixer: Mixer
    options: Options
    fits: tuple[LinearFit | RegisteredFit, ...]
    held: tuple[tuple[Theta, ...], ...]
    intercepts: tuple[Floats, ...]
    held_intercepts: tuple[tuple[Floats, ...], ...]
    folds: Folds
    units: Units
    rho: float
    plain: Model
    plain_fit: LinearFit
    plain_design: Floats
    telling: Telling
    told_columns: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        """Of the models."""
        return tuple(model.name for model in self.models)

    @property
    def every_name(self) -> tuple[str, ...]:
        """Of the models, and the mixture where there are several."""
        return (*self.names, *([MIXTURE] if len(self.models) > 1 else []))

    @property
    def columns(self) -> list[Ints]:
        """Of each model's design, those that are in some fit."""
        return [
            fit.used(model.terms)
            if isinstance(fit, LinearFit) and isinstance(model, Model)
            else np.arange(len(model.terms.names))
            for fit, model in zip(self.fits, self.models, strict=True)
        ]

    @property
    def thetas(self) -> list[Theta]:
        """Of each model by its `columns`, or what predicts."""
        return thetas(self.columns, [fit.theta if isinstance(fit, LinearFit) else fit for fit in self.fits])

    @cached_property
    def fitted(self) -> Fitted:
        """What scores rows, apart from the panel."""
        return Fitted(
            tuple(_part(model, fit) for model, fit in zip(self.models, self.fits, strict=True)),
            self.mixer,
            self.factor,
            self.rho,
            float(self.intercepts[0][0]) if self.bits else None,
            self.options.nonnegative,
        )

    @property
    def factor(self) -> float:
        """By what a deviation over draws is multiplied to be half an interval; NaN where there is none."""
        return self.quantile(self.options.level) * self.units.correction

    @property
    def enough(self) -> bool:
        """Whether there are intervals: units and draws are not too few."""
        return self.units.enough and self.options.draws >= FEWEST_DRAWS

    @property
    def few_draws(self) -> str:
        """That there are no intervals for want of draws, a sentence; "" where they are enough."""
        if (draws := self.options.draws) >= FEWEST_DRAWS:
            return ""
        over = f"a deviation over {draws} draws says little" if draws > 1 else "one draw has no deviation"
        return f"there are no intervals: {over}; they need draws={FEWEST_DRAWS}, and 200 are usual"

    def quantile(self, level: float) -> float:
        """Half the width of an interval, in standard errors; NaN where there is none."""
        return self.units.quantile(level) if self.enough else float("nan")

    @property
    def bits(self) -> bool:
        """Whether labels are bits."""
        return self.panel.roles.label_is == "binary"


def _part(model: AnyModel, fit: LinearFit | RegisteredFit) -> Linear | Alive:
    if isinstance(model, Model):
        assert isinstance(fit, LinearFit)
        return Linear.of(model, fit)
    assert not isinstance(fit, LinearFit)
    return Alive(model, fit)


def thetas(columns: Sequence[Ints], of: Sequence[Theta]) -> list[Theta]:
    """Coefficients of some columns of each model; what predicts itself is as it was."""
    return [one[:, own] if isinstance(one, np.ndarray) else one for own, one in zip(columns, of, strict=True)]
