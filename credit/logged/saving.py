"""Models saved to score new rows: `model/` of a recovery's folder. Plain JSON and arrays, and nothing that runs."""

from __future__ import annotations

import hashlib
import json
import math
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from credit.core.errors import UserError
from credit.core.version import __version__
from credit.logged.fits.telling import Telling
from credit.logged.fitted import KINDS, Fitted, Part
from credit.logged.mixers import read_mixer, saved_mixer
from credit.logged.models import aggregated
from credit.logged.panel import plain
from credit.logged.scored import ScoredTable
from credit.logged.scoring import credited, shares
from credit.logged.tables.again import opened_again
from credit.logged.tables.known import Known
from credit.logged.writing import MODEL

if TYPE_CHECKING:
    import pandas as pd

    from credit.logged.panel import Ints, Panel
    from credit.logged.recovering import Recovered

FORMAT = 1  # of what is written here; another number is another form
PLAIN, FITS = "model.json", "fits.npz"


@dataclass(frozen=True)
class SavedModel:
    """Models of a step's credit, and all that it takes to score the rows of another table.

    Attributes:
        fitted: models, their fits, and the mixer. known: what the columns are. rate: what a label tells of a row where
            all are alike. telling: what labels tell of the reference's columns `told_columns`. options: how it was
            fitted. source: where the table came from.

    Example:
        >>> model = credit.load_model("outputs/recover/sales")
        >>> model.predict(frame)[["credit", "credit_low", "credit_high"]]
    """

    fitted: Fitted
    known: Known
    rate: float
    telling: Telling
    told_columns: Ints
    options: Mapping[str, Any]
    source: str

    @classmethod
    def of(cls, found: Recovered) -> SavedModel:
        """Of a recovery from a table."""
        panel = found.panel
        seen = panel.windows.labelled
        rate = float(panel.windows.label[seen].sum() / shares(panel)[seen].sum())
        return cls(
            found.fitted, panel.known, rate, found.telling, found.told_columns, asdict(found.options), panel.source
        )

    def predict(self, data: Any, **words: Any) -> pd.DataFrame:
        """Credit of the rows of a table, in their order: as `steps` of a recovery.

        Lags and adstocks begin anew with the first row of each group, as they did in the table that was fitted.

        Args:
            data: a pandas frame; or a file, a folder, a pattern. Labels and windows may be missing. words: where it
                calls them otherwise: window, label, labels, time, group; and missing.

        Raises:
            UserError: it does not fit the columns that were fitted.
        """
        return self.scored(data, **words).steps

    def scored(self, data: Any, **words: Any) -> ScoredTable:
        """The same with windows, and how well their labels are predicted, where there are some."""
        return self.score(opened_again(data, words, self.known))

    def score(self, panel: Panel) -> ScoredTable:
        """Score a table that was opened in the way of this model's own."""
        told = np.ones(len(panel.windows), dtype=bool)
        place = np.searchsorted(self.fitted.parts[0].columns, self.told_columns)

        def ask(part: Any, own: slice, designs: list[np.ndarray]) -> None:
            told[own] = self.telling.answers(aggregated(part, designs[0][:, place], panel.roles))

        rows, sums = credited(self.fitted, panel, ask if self.telling.relations else None)
        return ScoredTable(panel, self.fitted, rows, sums, told, self.rate)

    def write(self, folder: Path) -> None:
        """Write it into a new folder."""
        folder.mkdir(parents=True)
        models, arrays = [], {"told_columns": self.told_columns}
        for number, part in enumerate(self.fitted.parts):
            one, own = part.saved()
            models.append(one)
            arrays |= {f"{number}.{name}": values for name, values in own.items()}
        np.savez(folder / FITS, **arrays)  # type: ignore[arg-type]
        fitted = self.fitted
        whole = {
            "format": FORMAT,
            "credit": __version__,
            "source": self.source,
            "known": self.known.to_dict(),
            "models": models,
            "mixer": saved_mixer(fitted.mixer),
            "factor": None if math.isnan(fitted.factor) else fitted.factor,
            "rho": fitted.rho,
            "intercept": fitted.intercept,
            "nonnegative": fitted.nonnegative,
            "rate": self.rate,
            "telling": self.telling.to_dict(),
            "options": plain(self.options),
            "fits": _digest(folder / FITS),
        }
        text = json.dumps(whole, indent=1, ensure_ascii=False, allow_nan=False)
        (folder / PLAIN).write_text(text + "\n", encoding="utf-8")

    @classmethod
    def read(cls, folder: str | Path) -> SavedModel:
        """A model that was written, by its folder or by that of its recovery.

        Raises:
            UserError: there is none, or it is damaged, or of another version.
        """
        path = Path(folder).expanduser()
        path = path / MODEL if (path / MODEL / PLAIN).is_file() else path
        whole = _plain(path / PLAIN, Path(folder))
        fits = path / FITS
        if not fits.is_file():
            raise UserError(
                f"{fits}: this file is missing; it belongs to {PLAIN} beside it: copy both, or recover anew"
            )
        if _digest(fits) != whole.get("fits"):
            raise UserError(
                f"{fits} is not the file that {PLAIN} beside it was written with; copy both, or recover anew"
            )
        file = fits
        try:
            with np.load(fits, allow_pickle=False) as stored:
                arrays = dict(stored)
            file = path / PLAIN
            return cls._made(whole, arrays)
        except UserError as error:
            raise UserError(f"{file}: {error}") from None
        except (KeyError, TypeError, ValueError, AttributeError, IndexError, zipfile.BadZipFile, OSError) as error:
            what = f"no {error}" if isinstance(error, KeyError) else str(error)
            raise UserError(f"{file} is damaged, or was written by hand ({what}); recover anew") from None

    @classmethod
    def _made(cls, whole: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> SavedModel:
        parts, known = list[Part](), Known.from_dict(whole["known"])
        for number, one in enumerate(whole["models"]):
            if one["kind"] not in KINDS:
                raise ValueError(f"{one['kind']!r} is no kind of model: {', '.join(KINDS)}")
            mark = f"{number}."
            own = {name.removeprefix(mark): values for name, values in arrays.items() if name.startswith(mark)}
            parts.append(KINDS[one["kind"]].read(one, own, known))
        if not parts or len({part.model.name for part in parts}) < len(parts):
            raise ValueError("it has no models, or two of one name")
        if len({len(part.theta) for part in parts}) > 1:
            raise ValueError("its models have different numbers of fits")
        telling, told = Telling.from_dict(whole["telling"]), arrays["told_columns"]
        if told.shape != (len(telling.names),):
            raise ValueError(f"told_columns are {told.shape}, of {len(telling.names)} names")
        factor, intercept = whole["factor"], whole["intercept"]
        fitted = Fitted(
            tuple(parts),
            read_mixer(whole["mixer"]),
            math.nan if factor is None else float(factor),
            float(whole["rho"]),
            None if intercept is None else float(intercept),
            bool(whole["nonnegative"]),
        )
        return cls(
            fitted,
            known,
            float(whole["rate"]),
            telling,
            told,
            dict(whole["options"]),
            str(whole["source"]),
        )


def load_model(folder: str | Path) -> SavedModel:
    """A model that `credit recover` wrote, to score the rows of other tables.

    Args:
        folder: of the recovery, or `model/` in it.

    Raises:
        UserError: there is no model, or it is damaged.

    Example:
        >>> credit.load_model("outputs/recover/sales").predict(frame)["credit"]
    """
    return SavedModel.read(folder)


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _plain(path: Path, given: Path) -> dict[str, Any]:
    """What JSON says, of a format that is known.

    Raises:
        UserError: it is not there, or says something else.
    """
    if not path.is_file():
        raise UserError(
            f"{given}: there is no {PLAIN}, and no {MODEL}/{PLAIN}; give the folder of a recovery, as `credit recover "
            "DATA` names it at its end"
        )
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UserError(f"{path} cannot be read ({error}); recover anew") from None
    if not isinstance(found, dict) or not isinstance(found.get("format"), int):
        raise UserError(f"{path} is no model of `credit recover`; give the folder of a recovery")
    if found["format"] != FORMAT:
        raise UserError(
            f"{path} has format {found['format']}, by credit {found.get('credit')}, and credit {__version__} reads "
            f"format {FORMAT}; recover anew, or use that version"
        )
    return found
