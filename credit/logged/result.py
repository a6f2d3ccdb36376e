"""What a recovery from logged data found, as frames: steps, windows, effects, and what is to be said of them."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from credit.core.errors import UserError
from credit.logged import claims, crossing
from credit.logged.effects import Sums, added_up, effects, over_time
from credit.logged.fits.linear import LinearFit
from credit.logged.fits.ridge import left
from credit.logged.fits.telling import WEAK
from credit.logged.policies import Logged, policies
from credit.logged.recovered import Recovered
from credit.logged.registered import Registered
from credit.logged.saving import SavedModel
from credit.logged.scoring import Judged, Scored, frames, in_order, scored, windowed_frame
from credit.logged.trusting import warnings

if TYPE_CHECKING:
    import pandas as pd

PROPORTIONAL = "labels are proportional to windows' lengths"


class LoggedCredit:
    """Credit of every row of a table, recovered from labels on windows.

    Attributes:
        found: models, weights, what is resampled. rows: credit of all rows. judged: what windows say of it.

    Example:
        >>> found = credit.recover(frame, window="week", label="sales")
        >>> found.steps["credit"], found.effects[["action", "per_unit", "per_unit_low", "per_unit_high"]]
    """

    def __init__(self, found: Recovered, rows: Scored, judged: Judged) -> None:
        self.found, self.rows, self.judged = found, rows, judged
        self.index: pd.Index[Any] | None = None  # of a frame that was given

    @classmethod
    def of(cls, found: Recovered) -> LoggedCredit:
        """Score all rows by fitted models, and judge them."""
        return cls(found, *scored(found))

    @property
    def models(self) -> tuple[str, ...]:
        """Names, and the mixture where there are several."""
        return self.found.every_name

    @cached_property
    def model(self) -> SavedModel:
        """What scores rows of other tables, as it is saved."""
        return SavedModel.of(self.found)

    def predict(self, data: Any, **words: Any) -> pd.DataFrame:
        """Credit of rows that were not fitted to: `SavedModel.predict`."""
        return self.model.predict(data, **words)

    @cached_property
    def steps(self) -> pd.DataFrame:
        """A row of what was given each, in that order: credit, its interval, credit that adds up, each model's, and
        where they disagree. An interval is one for the *expected* credit of a row, not for what happened in it."""
        found = in_order(frames(self.found.panel, self.found.names, self.rows))
        return found if self.index is None else found.set_axis(self.index[found.index])

    @cached_property
    def windows(self) -> pd.DataFrame:
        """A row a window: label, what credit adds up to, the prediction of fits that had not seen it, residual."""
        return windowed_frame(self.found.panel).assign(
            predicted=self.judged.fitted,
            held_out=self.judged.held_out[-1],
            residual=self.found.panel.windows.label - self.judged.fitted,
            fold=self.found.folds.fold,
        )

    @cached_property
    def effects(self) -> pd.DataFrame:
        """What each action was worth, by each model and the mixture; `effects.effects` says the columns."""
        return effects(self.found, self._added_up)

    @cached_property
    def effects_over_time(self) -> pd.DataFrame:
        """What each action brought in each period of time; `effects.over_time` says the columns."""
        return over_time(self.found, self._added_up)

    @cached_property
    def _added_up(self) -> list[Sums]:
        return added_up(self.found)

    @cached_property
    def told(self) -> pd.DataFrame:
        """What the windows tell of the reference's columns (of all, where it is no formula): column,
        coefficient, told (yes, badly, no), inflation, partner, relation, remedy, note."""
        import pandas as pd

        found, telling = self.found, self.found.telling
        relation = {int(column): one for one in telling.relations for column in one.columns}
        lines = []
        for number, name in enumerate(telling.names):
            one = relation.get(number)
            weak = telling.inflation[number] > WEAK
            own = found.plain_fit.coefficient(found.plain.terms, int(found.told_columns[number]))
            half = found.factor * own[1:].std() if len(own) > 1 else np.nan
            value = np.nan if one is not None else own[0]
            partner = telling.partner[number]
            lines.append(
                {
                    "column": name,
                    "coefficient": value,
                    "low": value - half,
                    "high": value + half,
                    "told": "no" if one is not None else "badly" if weak else "yes",
                    "inflation": telling.inflation[number],
                    "partner": telling.names[partner] if weak and partner >= 0 else "",
                    "relation": one.text if one is not None else "",
                    "remedy": one.remedy if one is not None else "",
                    "note": claims.note(found, int(found.told_columns[number]), own),
                }
            )
        return pd.DataFrame(lines)

    @cached_property
    def placebo(self) -> pd.DataFrame:
        """Does the next window's action "explain" this label?"""
        return claims.placebo(self.found)

    @cached_property
    def labelled(self) -> pd.DataFrame:
        """Which share of rows has labels, by action and state."""
        return claims.labelled_share(self.found)

    @cached_property
    def robustness(self) -> pd.DataFrame:
        """How strong something unmeasured would have to be to bring an effect of the reference to nothing."""
        import pandas as pd

        found, lines = self.found, []
        freedom = max(int(found.panel.windows.labelled.sum()) - found.telling.rank, 1)
        for line in self.effects[self.effects["model"] == found.names[0]].to_dict("records"):
            half = (line["effect_high"] - line["effect_low"]) / 2
            error = half / found.quantile(found.options.level)
            value = claims.robustness_value(line["effect"] / error, freedom) if error > 0 else np.nan
            lines.append({"action": line["action"], "level": line["level"], "robustness": value})
        frame = pd.DataFrame(lines, columns=["action", "level", "robustness"])
        return frame.assign(level=pd.Series([line["level"] for line in lines], dtype=object))  # None stays None

    @cached_property
    def policies(self) -> Logged | None:
        """A policy that was chosen on half of the windows and valued on the other; None where a cell is not finite."""
        return policies(self.found)

    @property
    def rate(self) -> float | None:
        """What each row brought, where labels are sums that are proportional to windows' lengths; else None."""
        return self.found.panel.windows.rate if self.found.panel.roles.label_is == "sum" else None

    @property
    def durbin_watson(self) -> float:
        """Of what is left of labels, 2 for no correlation."""
        residuals = left(self.found.panel.windows.label, self.judged.fitted)
        return claims.durbin_watson(residuals, self.found.panel.windows)

    @property
    def r_squared(self) -> dict[str, tuple[float, float]]:
        """Of each model: held-out R² against all steps alike, and against the last window's share."""
        alike, last = self.judged.r_squared
        return {name: (float(alike[at]), float(last[at])) for at, name in enumerate(self.models)}

    @property
    def metrics(self) -> dict[str, float]:
        """Numbers for a run."""
        found, windows = self.found, self.found.panel.windows
        numbers: dict[str, float] = {
            "rows": found.panel.rows, "windows": len(windows), "labelled": int(windows.labelled.sum()),
            "rank": found.telling.rank, "columns": len(found.telling.names), "units": len(found.units),
            "rho": found.rho, "durbin_watson": self.durbin_watson,
        }  # fmt: skip
        for name, (alike, last) in self.r_squared.items():
            numbers |= {f"r2_{name}": alike, f"r2_last_{name}": last}
        for name, fit in zip(found.names, found.fits, strict=True):
            if isinstance(fit, LinearFit):
                numbers[f"lambda_{name}"] = float(fit.penalty[0])
        for name, weight in zip(found.names, self.rows.weights, strict=True):
            numbers[f"weight_{name}"] = float(weight.mean())
        return numbers

    @property
    def worth(self) -> dict[str, float]:
        """What each action was worth a unit, by the last of the models: the mixture, where there are several."""
        found = self.effects[self.effects["model"] == self.models[-1]]
        keys = [f"{name}_{level}" if isinstance(level, str) and level else name
                for name, level in zip(found["action"], found["level"], strict=True)]  # fmt: skip
        return {f"effect_{key}": float(value) for key, value in zip(keys, found["per_unit"], strict=True)}

    @property
    def chosen(self) -> dict[str, dict[str, str]]:
        """Of each model, the parameters that folds chose for its terms."""
        return {one.model.name: dict(one.chosen) for one in self.found.fitted.parts}

    @property
    def said(self) -> tuple[str, ...]:
        """What was guessed, chosen or left out, a sentence each."""
        found = self.found
        folds = f"labels are held out in {len(found.folds.of)} contiguous folds with a gap of {found.folds.gap} windows"
        if (asked := found.options.gap) and asked > found.folds.gap:
            folds += f", and not of gap={asked}: more than a third of a fold would leave too little between two gaps"
        few = [found.few_draws] if found.units.enough and found.few_draws else []
        sentences = [*found.panel.said, found.units.said, *few, folds]
        if self.rate is not None:
            sentences.append(f"{PROPORTIONAL} ({self.rate:.6g} a row): nothing is left for columns to explain")
        registered = [model for model in found.models if isinstance(model, Registered)]
        if own := [model.name for model in registered if model.chosen.own]:
            others = len(own) < len(found.models)
            sentences.append(
                f"intervals of {', '.join(own)} are by the uncertainty that was named, not by units"
                + ("; its draws are no others' draws, and gaps to other models are larger for it" if others else "")
            )
        if registered and found.rho:
            sentences.append("registered models are fitted to labels as they are: ρ is of formulas and balanced credit")
        if found.options.residual == "ar1" and not found.bits:
            sentences.append(f"what is left of labels lasts from row to row with ρ = {found.rho:.3f}")
        for sums in self._added_up if found.panel.roles.cost else ():
            if sums.column.name in found.panel.roles.cost and not sums.free:
                why = f"its baseline is {sums.baseline!r}, and " + (
                    "what that would have cost is not known"
                    if sums.column.levels is None
                    else f"rows with it cost {sums.kept:.6g}"
                )
                sentences.append(f"there is no number per cost of {sums.column.name}: {why}")
        sentences += filter(None, [crossing.said(found), *warnings(found, self.judged)])
        loose = [name for name in found.panel.roles.actions if name not in found.panel.roles.randomised]
        if loose:
            sentences.append(f"effects of {', '.join(loose)} are associations: not known to be drawn at random")
        return tuple(sentences)

    def report(self) -> str:
        """All of this as one page of HTML, which asks for no other file: for a reader who is no statistician."""
        from credit.logged.report.page import written

        return written(self)

    def to_html(self, path: str | Path) -> Path:
        """Write `report()` to a file.

        Args:
            path: the file, in a folder that exists.

        Raises:
            UserError: its folder does not exist.

        Example:
            >>> found.to_html("report.html")
        """
        file = Path(path)
        if not file.parent.is_dir():
            raise UserError(f"{file}: there is no folder {file.parent}; make it, or choose a path in one that exists")
        file.write_text(self.report(), encoding="utf-8")
        return file

    def __repr__(self) -> str:
        windows = self.found.panel.windows
        alike = self.r_squared[self.models[-1]][0]
        return (
            f"LoggedCredit({self.found.panel.rows} rows, {len(windows)} windows, {'+'.join(self.found.names)}, "
            f"held-out R² {alike:.3f})"
        )
