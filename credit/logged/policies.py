"""Policies from logs, where states and actions are finite: chosen on one half of the windows, valued on the other.

A policy takes in every state the action whose credit, less what models disagree by (pessimism is minus the bonus), is
largest. It is fitted to the labels of one half of the units that are resampled, and valued by the labels of the other:

    Ŵ_w = Π_{t∈w} π(a_t|s_t) / μ(a_t|s_t),    self-normalised Σ Ŵ_w Y_w / Σ Ŵ_w,
    doubly robust  mean of  Σ_t Σ_a π(a|s_t) r̃(s_t, a) + Ŵ_w (Y_w − Σ_t r̃(s_t, a_t)),

with μ from `data.propensity`, or from how often actions were taken in a state. The second counts the states that were
seen as given: it is for states that actions do not change. With an effective sample size (Σ Ŵ)² / Σ Ŵ² below ten there
is no number.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from credit.core.errors import UserError
from credit.logged.fits.linear import LinearFit
from credit.logged.fits.mixture import mixed
from credit.logged.panel import Floats, Ints, Panel, Part
from credit.logged.recovered import Recovered
from credit.logged.recovering import recover
from credit.logged.registered import Registered

if TYPE_CHECKING:
    import pandas as pd

FEWEST = 10.0  # effective windows, below which there is no number
LARGEST = 100_000  # cells
CARRIES = ("lag(", "adstock(")


@dataclass(frozen=True)
class Value:
    """What a policy is worth a window, by the labels of windows that it was not chosen on.

    Attributes:
        policy: its name. value, low, high: NaN where the effective sample is too small. estimator: which.
        effective: sample size. windows: of the half that values.
    """

    policy: str
    estimator: str
    value: float
    low: float
    high: float
    effective: float
    windows: int


@dataclass(frozen=True)
class Logged:
    """A policy from logs.

    Attributes:
        table: a row a state: its values, the action that is taken, its credit and by what models disagree. values: what
            it is worth, and what was done is worth. said: what was left out, and why.
    """

    table: pd.DataFrame
    values: tuple[Value, ...]
    said: str = ""


class Half(Panel):
    """A panel in which only some windows keep their labels."""

    def __init__(self, panel: Panel, keep: np.ndarray) -> None:
        self.source, self.roles, self.columns = panel.source, panel.roles, panel.columns
        self.rows, self.said, self._panel = panel.rows, panel.said, panel
        self.windows = replace(panel.windows, label=np.where(keep, panel.windows.label, np.nan))

    def parts(self) -> Iterator[Part]:
        """All rows."""
        return self._panel.parts()


def policies(found: Recovered) -> Logged | None:
    """A policy and its value; None where states and actions are not finite, or there is no action."""
    import pandas as pd

    roles, columns = found.panel.roles, found.panel.columns
    if not roles.actions or any(columns[name].levels is None for name in roles.features):
        return None
    sizes = [len(columns[name].levels or ()) for name in roles.features]
    if float(np.prod([float(size) for size in sizes])) > LARGEST:
        return None
    if any(word in name for model in found.models for name in model.terms.names for word in CARRIES):
        return Logged(pd.DataFrame(), (), "no policy is chosen: a model's terms look back, and a state does not say it")
    if any(isinstance(model, Registered) and "next_state" in model.chosen.model.looks_at for model in found.models):
        return Logged(pd.DataFrame(), (), "no policy is chosen: a model looks at the state behind a step")
    first = found.units.of % 2 == 0
    try:
        learned = recover(Half(found.panel, first), found.models, found.mixer, found.options)
    except UserError as error:
        return Logged(pd.DataFrame(), (), f"no policy is chosen, by half of the windows: {error}")
    actions = int(np.prod([len(columns[name].levels or ()) for name in roles.actions]))
    frame, credit, bonus = _cells(learned)
    plan = (credit - bonus).reshape(-1, actions)
    choice = plan.argmax(1)
    table = frame.iloc[np.arange(len(choice)) * actions + choice].reset_index(drop=True)
    picked = np.arange(len(choice)) * actions + choice
    table = table[[*roles.states, *roles.actions]].assign(credit=credit[picked], disagreement=bonus[picked])
    values = _values(found, ~first, choice, credit.reshape(-1, actions))
    return Logged(table, values)


def _cells(found: Recovered) -> tuple[pd.DataFrame, Floats, Floats]:
    """All cells, the actions of a state after each other: their values, credit and disagreement."""
    import pandas as pd

    roles, columns = found.panel.roles, found.panel.columns
    names = [*roles.states, *roles.actions]
    levels = [list(columns[name].levels or ()) for name in names]
    grid = np.meshgrid(*[np.arange(len(one)) for one in levels], indexing="ij")
    frame = pd.DataFrame(
        {
            name: pd.Categorical.from_codes(code.ravel().tolist(), categories=pd.Index(one))
            for name, code, one in zip(names, grid, levels, strict=True)
        }
    )
    rows = np.arange(len(frame), dtype=np.int64)
    part = Part(frame, rows, np.zeros(len(frame), dtype=np.int64))
    designs = [model.terms.design(part, {}) for model in found.models]
    what = mixed(designs, [fit.theta if isinstance(fit, LinearFit) else fit for fit in found.fits], found.mixer)
    return frame, what.credit, what.disagreement


def _codes(part: Part, names: tuple[str, ...], found: Recovered) -> Ints:
    """One number for several categories of each row [n]."""
    code = np.zeros(len(part), dtype=np.int64)
    for name in names:
        levels = found.panel.columns[name].levels or ()
        code = code * len(levels) + part.frame[name].cat.codes.to_numpy()
    return code


def _values(found: Recovered, half: np.ndarray, choice: Ints, credit: Floats) -> tuple[Value, ...]:
    """By the labels of a half of the windows."""
    roles, windows = found.panel.roles, found.panel.windows
    counts = np.zeros(credit.shape)
    if roles.propensity is None:
        for part in found.panel.parts():
            np.add.at(counts, (_codes(part, roles.states, found), _codes(part, roles.actions, found)), 1)
        counts /= np.maximum(counts.sum(1, keepdims=True), 1)
    weight, direct, logged = np.empty(len(windows)), np.empty(len(windows)), np.empty(len(windows))
    for part in found.panel.parts():
        state, action = _codes(part, roles.states, found), _codes(part, roles.actions, found)
        own_counts = roles.propensity is None
        taken = counts[state, action] if own_counts else part.frame[roles.propensity].to_numpy(np.float64)
        with np.errstate(divide="ignore"):
            ratio = np.where(choice[state] == action, -np.log(taken), -np.inf)
        own = slice(int(part.window[0]), int(part.window[-1]) + 1)
        weight[own] = np.exp(part.sums(ratio))
        direct[own] = part.sums(credit[state, choice[state]])
        logged[own] = part.sums(credit[state, action])
    use = np.flatnonzero(half & windows.labelled)
    weight, y = weight[use], windows.label[use]
    direct, logged = direct[use], logged[use]
    if roles.label_is == "mean":
        direct, logged = direct / windows.steps[use], logged / windows.steps[use]
    units = found.units
    draws = units.weights(units.of[use], found.options.draws, found.options.seed)
    effective = float(weight.sum() ** 2 / (weight**2).sum()) if weight.any() else 0.0

    def valued(policy: str, estimator: str, of: Floats, effective: float) -> Value:
        enough = effective >= FEWEST
        deviation = of[1:].std() * units.correction * found.quantile(found.options.level)
        value = float(of[0]) if enough else float("nan")
        return Value(policy, estimator, value, value - deviation, value + deviation, effective, len(use))

    with np.errstate(invalid="ignore", divide="ignore"):
        normalised = (draws.T @ (weight * y)) / (draws.T @ weight)
        robust = (draws.T @ (direct + weight * (y - logged))) / draws.sum(0)
        behaviour = (draws.T @ y) / draws.sum(0)
    return (
        valued("what was done", "mean label", behaviour, float(len(use))),
        valued("chosen", "self-normalised importance weights", normalised, effective),
        *([] if found.bits else [valued("chosen", "doubly robust", robust, effective)]),
    )
