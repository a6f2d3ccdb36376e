"""What a recovery must not claim: checks that a reader of an effect is owed, each with what it means.

* lead placebo: the next window's action cannot cause this label. If it "explains" it, something else moves both.
* robustness value (Cinelli and Hazlett 2020): what share of what is left of the label, and of the action, something
  that was not measured would have to explain to bring an effect to nothing.
* labelled share: where labels are missing more often under some actions or states, they are no fair sample.
* Durbin–Watson: 2 where residuals of windows that follow each other are not correlated.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from credit.logged import binning
from credit.logged.binning import Bin, Bins
from credit.logged.fits.moments import moments
from credit.logged.fits.ridge import rounded, solutions
from credit.logged.fits.units import FEWEST
from credit.logged.models import Model, windowed
from credit.logged.panel import INTERCEPT, Floats, Ints, Panel, Windows
from credit.logged.recovered import Recovered
from credit.logged.residuals.whitening import Layout, whiten
from credit.logged.spreading import mapped

if TYPE_CHECKING:
    import pandas as pd

MOST, NUMBERS = 400, 3 * 10**7  # fits of a jackknife, and numbers in their moments
LARGE = 3.0  # standard errors from which on a share of labels differs
HELD = "held at 0"  # a note beside a number, not in its place


def durbin_watson(residuals: Floats, windows: Windows) -> float:
    """Σ (e_t − e_{t−1})² / Σ e_t² over windows that follow each other in a group; residuals [W], NaN for none."""
    follows = (np.diff(windows.group) == 0) & np.isfinite(residuals[1:]) & np.isfinite(residuals[:-1])
    total = np.nansum(residuals**2)
    return float((np.diff(residuals)[follows] ** 2).sum() / total) if total > 0 else float("nan")


def robustness_value(ratio: float, freedom: float) -> float:
    """½ (√(f⁴ + 4f²) − f²) with f = |t| / √ν, for an estimate of t standard errors with ν degrees of freedom."""
    f = abs(ratio) / np.sqrt(freedom)
    return float((np.sqrt(f**4 + 4 * f**2) - f**2) / 2)


def placebo(found: Recovered) -> pd.DataFrame:
    """For each action that is a number: what the next window's amount of it would be worth to this label.

    Columns: action, estimate, low, high, explains. The recovery's level is that of all actions together (Bonferroni),
    since with five of them one in three sets of 90% intervals would accuse somebody: at 90%, one table in ten in which
    nothing is wrong has an alarm.
    """
    import pandas as pd

    actions = [name for name in found.panel.roles.actions if found.panel.columns[name].levels is None]
    if not actions or found.bits:
        return pd.DataFrame(columns=["action", "estimate", "low", "high", "explains"])
    windows = found.panel.windows
    _, amounts = windowed(found.panel, [], actions)
    same = np.append(np.diff(windows.group) == 0, False)
    lead = np.where(same[:, None], np.roll(amounts, -1, axis=0), 0.0)
    known = windows.labelled & same
    x = np.concatenate([found.plain_design[:, found.told_columns], lead], axis=1)
    y = np.where(known, windows.label, 0.0)
    if found.rho != 0:
        layout = Layout.of(windows.steps, windows.group, known, found.panel.roles.label_is)
        x, y = whiten(x, layout, found.rho).values, whiten(y[:, None], layout, found.rho).values[:, 0]
    theta, error = (values[-len(actions) :] for values in _jackknife(found, x[known], y[known], found.units.of[known]))
    half = found.quantile(1 - (1 - found.options.level) / len(actions)) * error
    return pd.DataFrame(
        {
            "action": actions,
            "estimate": theta,
            "low": theta - half,
            "high": theta + half,
            "explains": np.abs(theta) > half,
        }
    )


def _jackknife(found: Recovered, x: Floats, y: Floats, unit: Ints) -> tuple[Floats, Floats]:
    """θ [d] of a design [w, d] at the plain model's λ, and its standard errors: of fits without each unit in turn.

    Draws of weights are too sure of a coefficient that is close to many others, with few units: of panels with nothing
    wrong (four regions, eighty weeks, five actions) 14 of 60 had an alarm by draws, and 3 have one by this, where 6 are
    to be expected.
    """
    count = min(len(found.units), max(FEWEST, min(MOST, int(NUMBERS / x.shape[1] ** 2))))
    unit = unit * count // len(found.units)  # neighbours together, where there are very many

    def without(units: Ints) -> Floats:
        return np.concatenate([np.ones((len(units), 1)), units[:, None] != np.arange(count)], axis=1)

    whole = moments(x, y, np.zeros_like(unit), unit, without, 1, 1 + count).sum(0)
    theta = solutions(whole, np.full((1 + count, 1), found.plain_fit.penalty[0]), _intercept(found))[:, 0]
    theta = rounded(theta, whole)
    return theta[0], np.sqrt(((theta[1:] - theta[0]) ** 2).sum(0) * (count - 1) / count)


def _intercept(found: Recovered) -> int | None:
    names = [found.plain.terms.names[column] for column in found.told_columns]
    return names.index(INTERCEPT) if INTERCEPT in names else None


def labelled_share(found: Recovered) -> pd.DataFrame:
    """For each feature and each of its values, or thirds of its numbers: which share of rows lies in labelled windows.

    Columns: column, value, rows, labelled, differs (by more than three standard errors from that of all rows, with as
    many independent rows as windows).
    """
    import pandas as pd

    panel = found.panel
    counts: Bins = {}
    for section in mapped(_counted, panel):
        for key, some in section.items():
            counts[key] = counts[key].add(some) if key in counts else some
    share = panel.windows.labelled[np.repeat(np.arange(len(panel.windows)), panel.windows.steps)].mean()
    each = panel.rows / len(panel.windows)
    lines = []
    for name, number in sorted(counts, key=lambda key: (panel.roles.features.index(key[0]), key[1])):
        one = counts[name, number]
        count, labelled = one.sums
        error = np.sqrt(max(share * (1 - share), 1e-12) / max(count / each, 1))
        differs = bool(abs(labelled / count - share) > LARGE * error)
        lines.append(
            {
                "column": name,
                "value": binning.name(panel.columns[name], number, one),
                "rows": int(count),
                "labelled": labelled / count,
                "differs": differs,
            }
        )
    return pd.DataFrame(lines, columns=["column", "value", "rows", "labelled", "differs"])


def _counted(section: Panel) -> Bins:
    """Rows, and those in labelled windows."""
    counts: Bins = {}
    for part in section.parts():
        held = section.windows.labelled[part.window]
        for name in section.roles.features:
            for number, rows, one in binning.binned(part.frame[name], section.columns[name]):
                some = Bin(np.append(one.sums, (rows & held).sum()), one.low, one.high)
                counts[name, number] = counts[name, number].add(some) if (name, number) in counts else some
    return counts


def held(found: Recovered, name: str, action: str, value: float) -> str:
    """That a sign holds what an action is worth at 0 in a model; "" where none does."""
    sign = next((one.signs.get(action) for one in found.models if isinstance(one, Model) and one.name == name), None)
    return f"{HELD} by its sign ({sign})" if sign and value == 0 else ""


def note(found: Recovered, column: int, theta: Floats) -> str:
    """What is to be known of a coefficient [1 + B] of the model by which windows are judged."""
    fit, model = found.plain_fit, found.plain
    sign = model.bound().get(column)
    if sign and theta[0] == 0:
        return f"{HELD} by its sign ({'positive' if sign > 0 else 'negative'})"
    for at, free in enumerate(model.terms.choices):
        if any(column in own for own in free.columns) and (fit.chosen[:, at] != fit.chosen[0, at]).any():
            return f"{free.text} has other numbers in other draws: see effects.csv for what it was worth"
    return ""
