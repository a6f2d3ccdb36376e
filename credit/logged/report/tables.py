"""The tables of the page: words and numbers, no markup."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from credit.logged.fitted import Linear
from credit.logged.report.gathered import Gathered, Share
from credit.logged.report.names import called, named
from credit.logged.report.numbers import interval, number, percent, short
from credit.logged.report.sentences import main_effects

if TYPE_CHECKING:
    import pandas as pd

    from credit.logged.policies import Logged
    from credit.logged.result import LoggedCredit

MOST = 400  # lines of a table; the files beside the page have all
LONGEST = 80  # letters of a name


@dataclass(frozen=True)
class Cell:
    """Words, with smaller ones below them; numbers stand at the right."""

    words: str
    below: str = ""
    right: bool = False


@dataclass(frozen=True)
class Table:
    """A head and lines of cells; left: how many lines are not shown, and which file has them."""

    head: tuple[Cell, ...]
    lines: tuple[tuple[Cell, ...], ...]
    left: str = ""

    def split(self, first: int) -> tuple[Table, Table]:
        """The first lines, and the others."""
        return Table(self.head, self.lines[:first]), Table(self.head, self.lines[first:], self.left)


def table(head: Sequence[str], lines: Iterable[Sequence[str | Cell]], file: str, most: int = MOST) -> Table:
    """A table whose columns stand as the cells of their first line do."""
    rows = [
        tuple(one if isinstance(one, Cell) else Cell(short(one, LONGEST) if one else "") for one in line)
        for line in lines
    ]
    right = [cell.right for cell in rows[0]] if rows else [False] * len(head)
    left = f"{len(rows) - most:,} more lines are in {file}." if len(rows) > most else ""
    return Table(tuple(Cell(name, "", at) for name, at in zip(head, right, strict=True)), tuple(rows[:most]), left)


def count(value: float, digits: int = 3) -> Cell:
    """A number."""
    return Cell(number(value, digits), right=True)


def whole(value: int) -> Cell:
    """A count."""
    return Cell(f"{value:,}", right=True)


def between(value: float, low: float, high: float) -> Cell:
    """A number with its interval below."""
    return Cell(*interval(value, low, high), right=True)


def effects(result: LoggedCredit) -> Table:
    """A line each action, or category: in total, per unit and per cost with intervals, and by each model."""
    costly = "per_cost" in result.effects.columns
    single = result.models[:-1]
    others = {
        (line["action"], line["level"], line["model"]): line["total"] for line in result.effects.to_dict("records")
    }
    keys = ["total", "per_unit", *(["per_cost"] if costly else [])]
    head = ["action", "baseline", "in total", "per unit", *(["per cost"] if costly else [])]
    head += [f"in total by {called(name)}" for name in single] + ["note"]
    lines: list[list[str | Cell]] = []
    for line in main_effects(result):
        values = [between(*(float(line[f"{key}{end}"]) for end in ("", "_low", "_high"))) for key in keys]
        by = [count(others[line["action"], line["level"], name], 4) for name in single]
        base = line["baseline"]
        words = number(base) if isinstance(base, float) else short(base)
        lines.append([named(line, LONGEST), words, *values, *by, line["note"]])
    if not any(line[-1] for line in lines):
        head, lines = head[:-1], [line[:-1] for line in lines]
    return table(head, lines, "effects.csv")


def scores(result: LoggedCredit) -> Table:
    """R² of each model that was held out, and how much it counts in a row on average."""
    weights = dict(zip(result.found.names, result.rows.weights.mean(axis=1), strict=True))
    lines: list[list[str | Cell]] = [
        [name, *(count(score) for score in both), Cell(percent(weights[name]) if name in weights else "", right=True)]
        for name, both in result.r_squared.items()
    ]
    return table(["model", "R² against all rows alike", "R² against the last window", "weight"], lines, "summary.json")


def shares(some: Sequence[Share], what: str) -> Table:
    """Groups, or what was done: rows, credit, and by how much models differ, where they do most first."""
    ordered = sorted(some, key=lambda one: -one.apart)
    lines: list[list[str | Cell]] = [
        [one.name, whole(one.rows), count(one.credit), count(one.apart), count(one.disagreement)] for one in ordered
    ]
    return table([what, "rows", "credit of a row", "models apart by", "disagreement"], lines, "steps", 100)


def top(data: Gathered) -> Table:
    """The rows where models differ most."""
    return of_frame(data.top, "steps")


def of_frame(frame: pd.DataFrame, file: str, shown: dict[str, str] | None = None) -> Table:
    """A frame, or some of its columns under other names."""
    names = shown or {str(name): str(name) for name in frame.columns}
    lines = [[_cell(line[name], name) for name in names] for line in frame.head(MOST).to_dict("records")]
    made = table(list(names.values()), lines, file)
    left = f"{len(frame) - MOST:,} more lines are in {file}." if len(frame) > MOST else ""
    return Table(made.head, made.lines, left)


def _cell(value: Any, name: str) -> Cell:
    if isinstance(value, bool):
        return Cell("yes" if value else "no")
    if isinstance(value, float):
        return Cell(percent(value), right=True) if name in ("labelled", "robustness") else count(value, 4)
    if hasattr(value, "__index__"):
        return Cell(str(int(value)), right=True)
    return Cell(short(value, LONGEST) if str(value) else "")


def details(result: LoggedCredit) -> list[tuple[str, Table]]:
    """What stands folded at the end, each with its title."""
    found = result.found
    told = result.told
    columns = {"column": "column", "told": "told", "coefficient": "coefficient", "low": "low", "high": "high"}
    columns |= {"inflation": "variance inflation", "partner": "moves with"}
    fits: list[list[str | Cell]] = [
        [one.model.name, count(float(one.penalty[0])) if isinstance(one, Linear) else "its own",
         short(one.model.terms.formula or "1 + every column", 400), short(", ".join(one.chosen.values()) or "—", 400)]
        for one in found.fitted.parts
    ]  # fmt: skip
    tables = [
        ("Columns that the windows tell apart", of_frame(told, "told.csv", columns)),
        ("Models", table(["model", "λ, in windows", "formula", "chosen by folds"], fits, "summary.json")),
        ("Share of rows with a label", of_frame(result.labelled, "labelled.csv")),
        ("The next window’s action", of_frame(result.placebo, "placebo.csv")),
        ("Robustness value", of_frame(_plain(result.robustness), "robustness.csv")),
    ]
    return [(title, one) for title, one in tables if one.lines]


def _plain(frame: pd.DataFrame) -> pd.DataFrame:
    return frame if frame["level"].notna().any() else frame.drop(columns="level")


def policy_values(policy: Logged) -> Table:
    """What a policy is worth a window, and what was done is."""
    lines: list[list[str | Cell]] = [
        [one.policy, one.estimator, between(one.value, one.low, one.high), count(one.effective), whole(one.windows)]
        for one in policy.values
    ]
    head = ["policy", "estimated by", "worth a window", "effective windows", "windows"]
    return table(head, lines, "policy_values.csv")
