"""From a table with labels on windows to a model of every row's credit: the whole of a fit, on one page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from credit.core.errors import UserError
from credit.logged.fits.folds import Folds, folds_of
from credit.logged.fits.linear import Fitting, LinearFit
from credit.logged.fits.moments import Moments
from credit.logged.fits.odds import Bits, require_bits
from credit.logged.fits.refining import refined
from credit.logged.fits.ridge import left
from credit.logged.fits.telling import Telling, remedied, told
from credit.logged.fits.units import Units, units_of
from credit.logged.formulas.terms import Terms
from credit.logged.models import Model, learned, windowed
from credit.logged.panel import Floats, Ints, Panel
from credit.logged.recovered import AnyModel, Options, Recovered
from credit.logged.residuals.autocorrelation import estimated_rho
from credit.logged.residuals.whitening import Layout, whiten

if TYPE_CHECKING:
    from credit.core.seams import Mixer
    from credit.logged.fits.predicting import RegisteredFit

PLAIN = "plain"  # the linear model on all columns, by which windows are judged where the reference is none
HELD_OUT_DRAWS = 50  # at most, of fits that have not seen a fold
TELL_RHO = 30_000  # windows at most by which ρ is told: of sevens, to ± .002 where it is .88, to ± .02 where .3
NEWTON_DRAWS = 40  # at most, by which it is told where a decay may lie


def recover(panel: Panel, models: Sequence[AnyModel], mixer: Mixer, options: Options) -> Recovered:
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
        if signed := [model.name for model in models if isinstance(model, Model) and model.signs]:
            raise UserError(f"{signed[0]}: sign: labels are bits, whose models have no signs yet; leave it out")
    linear = [model for model in models if isinstance(model, Model)]
    if not isinstance(models[0], Model):
        linear = [Model(PLAIN, Terms.of(None, panel.columns, panel.roles)), *linear]
    linear = learned(linear, panel)
    designs, _ = windowed(panel, linear)
    known = {model.name: model for model in linear}
    models = [known.get(model.name, model) if isinstance(model, Model) else model for model in models]
    fit = _Bits if bits else _Numbers
    return fit(panel, tuple(models), tuple(linear), mixer, options, designs).recovered()


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
        self,
        panel: Panel,
        every: tuple[AnyModel, ...],
        models: tuple[Model, ...],
        mixer: Mixer,
        options: Options,
        designs: list[Floats],
    ) -> None:
        self.panel, self.every, self.mixer, self.options = panel, every, mixer, options
        self.models, self.designs = models, designs  # the linear ones, the plain one first
        self.windows, self.known = panel.windows, panel.windows.labelled
        self.rho = 0.0
        self.folds = folds_of(self.windows, options.folds, options.gap or 0)

    def found(
        self,
        units: Units,
        fits: list[LinearFit],
        held: list[tuple[Floats, ...]],
        intercepts: Sequence[Floats] = (),
        held_intercepts: Sequence[Sequence[Floats]] = (),
    ) -> Recovered:
        """All models, of whom the linear ones are fitted; intercepts are of bits."""
        columns = fits[0].columns(self.models[0].terms)
        x = self.designs[0][self.known][:, columns]
        telling = told(x.T @ x, [self.models[0].terms.names[column] for column in columns])
        own, own_held = self._registered(units)

        def merged(linear: Sequence[Any], registered: Mapping[str, Any]) -> tuple[Any, ...]:
            both = {**dict(zip([model.name for model in self.models], linear, strict=True)), **registered}
            return tuple(both[model.name] for model in self.every)

        def odds(linear: Sequence[Floats], registered: Mapping[str, RegisteredFit]) -> tuple[Floats, ...]:
            return merged(linear, {name: np.array([fit.intercept]) for name, fit in registered.items()})

        return Recovered(
            self.panel, self.every, self.mixer, self.options, merged(fits, own),
            tuple(merged(*pair) for pair in zip(held, own_held, strict=True)),
            odds(intercepts, own) if intercepts else (),
            tuple(odds(*pair) for pair in zip(held_intercepts, own_held, strict=False)),
            self.folds, units, self.rho, self.models[0], fits[0], self.designs[0], self._remedied(telling, columns),
            columns,
        )  # fmt: skip

    def _registered(self, units: Units) -> tuple[Mapping[str, RegisteredFit], list[Mapping[str, RegisteredFit]]]:
        """Registered models, fitted to all windows, and without each fold."""
        models = [model for model in self.every if not isinstance(model, Model)]
        count = len(self.folds.of)
        if not models:
            return {}, [{} for _ in range(count)]
        from credit.logged.fits.registered import LARGEST, Team
        from credit.logged.steps import rows_of

        spaces, options = models[0].terms.spaces, self.options
        rows = rows_of(self.panel, spaces, LARGEST)
        team = Team(models, self.every[0].name, spaces, rows, self.windows, units, options.draws, options.seed)
        whole = team.fitted(self.known, options.draws)
        if count < 2:  # nobody asks for it
            return whole, [whole]
        fitted = [self.known & np.isin(self.folds.piece, pieces) for _, pieces in self.folds.of]
        return whole, [team.fitted(known, min(options.draws, HELD_OUT_DRAWS)) for known in fitted]

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
        residuals = np.where(self.known, left(white, x[0] @ points[0].theta[0]), np.nan)
        units = units_of(residuals, self.windows, self.rho != 0)
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
        found = dict[str, Model]()
        for model, design, fit in zip(self.models, x, points, strict=True):
            if any(free.call for free in model.terms.choices):
                decays = refined(model.terms, fitting.moments(design, y, self.known).sum(0), fit)
                found[model.name] = replace(model, terms=model.terms.refined(decays))
        if not found:
            return False
        self.models = tuple(found.get(model.name, model) for model in self.models)
        self.every = tuple(found.get(model.name, model) for model in self.every)
        self.designs, _ = windowed(self.panel, self.models)
        return True

    def _rho(self, fit: LinearFit, layout: Layout, y: Floats) -> float:
        if self.options.rho is not None:
            return self.options.rho
        columns = fit.columns(self.models[0].terms)
        some = self._stretches()
        if some is None:
            return estimated_rho(self.designs[0][:, columns], y, layout).rho
        windows = self.windows
        layout = Layout.of(windows.steps[some], windows.group[some], self.known[some], self.panel.roles.label_is)
        return estimated_rho(self.designs[0][some][:, columns], y[some], layout).rho

    def _stretches(self) -> Ints | None:
        """Windows that tell ρ for all, where there are many: whole groups, evenly spread, or the first of one."""
        if len(self.windows) <= TELL_RHO:
            return None
        starts = np.flatnonzero(np.diff(self.windows.group, prepend=self.windows.group[0] - 1))
        each = len(self.windows) / len(starts)
        wanted = max(1, int(TELL_RHO / each))
        chosen = np.unique(np.linspace(0, len(starts) - 1, wanted).astype(int))
        ends = np.append(starts[1:], len(self.windows))
        return np.concatenate([np.arange(starts[at], ends[at]) for at in chosen])[:TELL_RHO]

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
        return self.found(units, fits, held, intercepts, held_intercepts)
