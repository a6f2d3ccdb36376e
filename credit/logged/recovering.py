"""From a table with labels on windows to a model of every row's credit: the whole of a fit, on one page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from annotated_types import Interval

from credit.core.errors import UserError
from credit.core.ranges import NonNegativeInt, PositiveInt
from credit.logged.fits.folds import Folds, folds_of
from credit.logged.fits.linear import Fitting, LinearFit
from credit.logged.fits.moments import Moments
from credit.logged.fits.odds import Bits, require_bits
from credit.logged.fits.refining import refined
from credit.logged.fits.telling import Telling, remedied, told
from credit.logged.fits.units import Units, units_of
from credit.logged.fitted import Fitted, Linear
from credit.logged.models import Model, learned, windowed
from credit.logged.panel import MIXTURE, Floats, Ints, Panel
from credit.logged.residuals.autocorrelation import estimated_rho
from credit.logged.residuals.whitening import Layout, whiten

if TYPE_CHECKING:
    from credit.core.seams import Mixer

HELD_OUT_DRAWS = 50  # at most, of fits that have not seen a fold
NEWTON_DRAWS = 40  # at most, by which it is told where a decay may lie


@dataclass(frozen=True)
class Options:
    """How credit is recovered.

    Args:
        draws: B, refits by which uncertainty is told. level: of intervals. folds: K, contiguous in time. gap: windows
            between what is fitted and what is tested; None: as long as residuals hang together. residual: how what is
            left of a label is given to its rows. rho: ρ of ar1; None: estimated. nonnegative: no balanced credit below
            0. seed: of the draws.
    """

    draws: PositiveInt = 200
    level: Annotated[float, Interval(gt=0, lt=1)] = 0.9
    folds: PositiveInt = 5
    gap: NonNegativeInt | None = None
    residual: Literal["ar1", "uniform"] = "ar1"
    rho: Annotated[float, Interval(gt=-1, lt=1)] | None = None
    nonnegative: bool = False
    seed: NonNegativeInt = 0


@dataclass(frozen=True)
class Recovered:
    """Models that were fitted to a panel, the reference first.

    Attributes:
        panel, models, mixer, options: what was asked. fits: of each model. held: θ of each fold and model without it
            [K][M][1 + b, D]. intercepts, held_intercepts: of bits, else empty. folds, units, rho: what was chosen.
        telling: what the windows can tell of the reference's columns, by their number in `told_columns`.
        designs: what windows sum of each model's terms [W, D].
    """

    panel: Panel
    models: tuple[Model, ...]
    mixer: Mixer
    options: Options
    fits: tuple[LinearFit, ...]
    held: tuple[tuple[Floats, ...], ...]
    intercepts: tuple[Floats, ...]
    held_intercepts: tuple[tuple[Floats, ...], ...]
    folds: Folds
    units: Units
    rho: float
    telling: Telling
    told_columns: np.ndarray
    designs: tuple[Floats, ...]

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
        return [fit.used(model.terms) for fit, model in zip(self.fits, self.models, strict=True)]

    @property
    def factor(self) -> float:
        """By what a deviation over draws is multiplied to be half an interval; NaN where there is none."""
        return self.units.quantile(self.options.level) * self.units.correction

    @cached_property
    def fitted(self) -> Fitted:
        """What scores rows, apart from the panel."""
        return Fitted(
            tuple(Linear.of(model, fit) for model, fit in zip(self.models, self.fits, strict=True)),
            self.mixer,
            self.factor,
            self.rho,
            float(self.intercepts[0][0]) if self.bits else None,
            self.options.nonnegative,
        )

    @property
    def bits(self) -> bool:
        """Whether labels are bits."""
        return self.panel.roles.label_is == "binary"


def recover(panel: Panel, models: Sequence[Model], mixer: Mixer, options: Options) -> Recovered:
    """Fit models to the labels of windows.

    Args:
        panel: the opened table. models: the reference first. mixer: of their proxies. options: how.

    Raises:
        UserError: there is nothing to be learned from, or an option does not fit the labels.
    """
    _require_labels(panel)
    bits = panel.roles.label_is == "binary"
    if bits:
        require_bits(panel.windows.label, list(panel.windows.id))
        if signed := [model.name for model in models if model.signs]:
            raise UserError(f"{signed[0]}: sign: labels are bits, whose models have no signs yet; leave it out")
    models = learned(models, panel)
    designs, _ = windowed(panel, models)
    fit = _Bits if bits else _Numbers
    return fit(panel, tuple(models), mixer, options, designs).recovered()


def _require_labels(panel: Panel) -> None:
    labels = panel.windows.label[panel.windows.labelled]
    if len(labels) < 2:
        raise UserError(
            f"{panel.source}: {len(labels)} of {len(panel.windows)} windows has a label ({panel.roles.label}), and "
            "credit is learned from how labels differ; at least 2 are needed"
        )
    if (labels == labels[0]).all():
        raise UserError(
            f"{panel.source}: all {len(labels)} labels (column {panel.roles.label!r}) are {labels[0]:g}: there is "
            "nothing to be learned from them"
        )


class _Fit:
    """What fits to numbers and to bits share."""

    def __init__(
        self, panel: Panel, models: tuple[Model, ...], mixer: Mixer, options: Options, designs: list[Floats]
    ) -> None:
        self.panel, self.models, self.mixer, self.options, self.designs = panel, models, mixer, options, designs
        self.windows, self.known = panel.windows, panel.windows.labelled
        self.rho = 0.0
        self.folds = folds_of(self.windows, options.folds, options.gap or 0)

    def found(self, units: Units, fits: list[LinearFit], held: list[tuple[Floats, ...]], **more: object) -> Recovered:
        columns = fits[0].columns(self.models[0].terms)
        x = self.designs[0][self.known][:, columns]
        names = [self.models[0].terms.names[column] for column in columns]
        telling = told(x.T @ x, names)
        return Recovered(
            self.panel, self.models, self.mixer, self.options, tuple(fits), tuple(held),
            more.get("intercepts", ()), more.get("held_intercepts", ()),  # type: ignore[arg-type]
            self.folds, units, self.rho, self._remedied(telling, columns), columns, tuple(self.designs),
        )  # fmt: skip

    def _remedied(self, telling: Telling, columns: np.ndarray) -> Telling:
        """With what would tell columns apart, by the first rows."""
        if not telling.relations:
            return telling
        part = next(self.panel.parts())
        phi = self.models[0].terms.design(part, {}, columns)
        window = self.panel.roles.window
        return replace(telling, relations=tuple(remedied(one, part, phi, window) for one in telling.relations))

    def regapped(self, units: Units) -> Folds:
        """Folds with a gap as long as residuals hang together."""
        gap = self.options.gap
        return folds_of(self.windows, self.options.folds, max(units.length, 1) if gap is None else gap)


class _Numbers(_Fit):
    """Labels that are numbers: ridge on moments, of windows that were whitened where residuals are autoregressive."""

    def recovered(self) -> Recovered:
        """Fit: once to see what is left of labels, and then all draws."""
        layout = Layout.of(self.windows.steps, self.windows.group, self.known, self.panel.roles.label_is)
        y = np.where(self.known, self.windows.label, 0.0)
        first = self._fits(Fitting(self.folds, None), self.designs[:1], y)[0][0]
        if self.options.residual == "ar1":
            self.rho = self._rho(first, layout, y)
        x, white = self._whitened(layout, y)
        points, _ = self._fits(Fitting(self.folds, None), x, white)
        residuals = np.where(self.known, white - x[0] @ points[0].theta[0], np.nan)
        units = units_of(residuals, self.windows)
        if self._refine(points, x, white, units):
            x, white = self._whitened(layout, y)
        y = white
        self.folds = self.regapped(units)
        fitting = Fitting(self.folds, units, self.options.draws, self.options.seed)
        fits, moments = self._fits(fitting, x, y)
        held = [
            tuple(
                fitting.without(model.terms, pieces, fit, fold, min(self.options.draws, HELD_OUT_DRAWS), model.bound())
                for model, pieces, fit in zip(self.models, moments, fits, strict=True)
            )
            for fold in range(len(self.folds.of))
        ]
        return self.found(units, fits, held)

    def _fits(self, fitting: Fitting, x: Sequence[Floats], y: Floats) -> tuple[list[LinearFit], list[Moments]]:
        fits, moments = [], []
        for model, design in zip(self.models, x, strict=False):  # all, or the reference alone
            moments.append(fitting.moments(design, y, self.known))
            fits.append(fitting.fit(model.terms, moments[-1], model.regularization, model.bound()))
        return fits, moments

    def _refine(self, points: list[LinearFit], x: Sequence[Floats], y: Floats, units: Units) -> bool:
        """Lay candidates of decays where draws say that they are; whether there are such decays."""
        fitting = Fitting(self.folds, units, min(self.options.draws, NEWTON_DRAWS), self.options.seed)
        models = []
        for model, design, fit in zip(self.models, x, points, strict=True):
            if not any(free.call for free in model.terms.choices):
                models.append(model)
                continue
            decays = refined(model.terms, fitting.moments(design, y, self.known).sum(0), fit)
            models.append(replace(model, terms=model.terms.refined(decays)))
        if models == list(self.models):
            return False
        self.models = tuple(models)
        self.designs, _ = windowed(self.panel, self.models)
        return True

    def _rho(self, fit: LinearFit, layout: Layout, y: Floats) -> float:
        if self.options.rho is not None:
            return self.options.rho
        columns = fit.columns(self.models[0].terms)
        return estimated_rho(self.designs[0][:, columns], y, layout).rho

    def _whitened(self, layout: Layout, y: Floats) -> tuple[list[Floats], Floats]:
        if self.rho == 0:
            return self.designs, y
        x = [whiten(design, layout, self.rho).values for design in self.designs]
        return x, whiten(y[:, None], layout, self.rho).values[:, 0]


class _Bits(_Fit):
    """Labels that are bits: logistic sums."""

    def recovered(self) -> Recovered:
        """Fit: once to see what is left of labels, and then all draws."""
        y = self.windows.label
        fit, intercept = Bits(self.designs[0], y, self.folds, None).fit(
            self.models[0].terms, self.models[0].regularization
        )
        residuals = y - 1 / (1 + np.exp(-(self.designs[0] @ fit.theta[0] + intercept[0])))
        units = units_of(residuals, self.windows)
        self.folds = self.regapped(units)
        options, fits, intercepts = self.options, [], []
        every = [Bits(x, y, self.folds, units, options.draws, options.seed) for x in self.designs]
        for bits, model in zip(every, self.models, strict=True):
            fit, intercept = bits.fit(model.terms, model.regularization)
            fits.append(fit)
            intercepts.append(intercept)
        held, held_intercepts = [], []
        for fold in range(len(self.folds.of)):
            draws = min(options.draws, HELD_OUT_DRAWS)
            found = [
                bits.without(model.terms, fit, fold, draws)
                for bits, model, fit in zip(every, self.models, fits, strict=True)
            ]
            held.append(tuple(theta for theta, _ in found))
            held_intercepts.append(tuple(intercept for _, intercept in found))
        return self.found(units, fits, held, intercepts=tuple(intercepts), held_intercepts=tuple(held_intercepts))
