"""One comparison as Markdown, LaTeX and CSV, from the same cells that the terminal shows."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd

from credit.report.comparison import Comparison, Row, interval_of
from credit.report.scale import SUPERSCRIPTS, UNKNOWN, Scale
from credit.report.text import caption, heading, in_common, remarks, sentences

Cell = tuple[str, str]  # a value, and what stands in brackets below or after it ("" = nothing)
LONG = 12  # a name with more characters goes on two lines

_TEX = {symbol: "\\" + symbol for symbol in "&%$#_{}"} | {
    "\\": "\\textbackslash{}",
    "^": "\\textasciicircum{}",
    "~": "\\textasciitilde{}",
    "<": "$<$",
    ">": "$>$",
    "±": "$\\pm$",
    "×": "$\\times$",
    "−": "$-$",
    "–": "--",
}
_TEX |= {sup: f"$^{{{plain}}}$" for sup, plain in zip(SUPERSCRIPTS, "-0123456789", strict=True)}


@dataclass(frozen=True)
class Grid:
    """A table of strings: a title, a header, and rows of cells."""

    title: str
    header: list[str]
    rows: list[list[Cell]]


def grids(comparison: Comparison) -> list[Grid]:
    """The cells as tables: means beside the paper's, what sets the methods apart, and by other measures."""
    more = comparison.reference.key is not None and len(comparison.contrasted) > 1
    return [_means(comparison), _contrasts(comparison), *([_differences(comparison)] if more else [])]


def two_lines(text: str) -> str:
    """Break a long name at the space nearest to its middle."""
    spaces = [index for index, letter in enumerate(text) if letter == " "]
    if len(text) <= LONG or not spaces:
        return text
    middle = min(spaces, key=lambda index: abs(index - len(text) / 2))
    return text[:middle] + "\n" + text[middle + 1 :]


def markdown(*comparisons: Comparison) -> str:
    """The tables and sentences of every setting, and the caption, as Markdown."""
    parts = [f"# Comparison: {comparisons[0].runs.experiment}", in_common(*comparisons)]
    for comparison in comparisons:
        level = "##"
        if heading(comparison.runs):
            parts.append(f"## `{heading(comparison.runs)}`")
            level = "###"
        for grid in grids(comparison):
            rule = _pipes(["---", *["---:"] * (len(grid.header) - 1)])
            lines = [f"{level} {grid.title}", "", _pipes(grid.header), rule]
            lines += [_pipes([f"{value} {below}".strip() for value, below in row]) for row in grid.rows]
            parts.append("\n".join(lines))
        parts.append("\n".join(f"- {line}" for line in sentences(comparison)))
    return "\n\n".join([*filter(None, parts), caption(*comparisons)]) + "\n"


def latex(*comparisons: Comparison) -> str:
    """A table environment for every setting, to be read with \\input; they need only the booktabs package."""
    tables = [_latex_table(comparison) for comparison in comparisons]
    opening = _comments("Needs \\usepackage{booktabs}.", in_common(*comparisons))
    return "\n\n".join(["\n".join([*opening, tables[0]]), *tables[1:]]) + "\n"


def csv(*comparisons: Comparison) -> str:
    """The raw numbers, one row a method and slug; a named setting is the first column."""
    return _to_csv([(comparison.runs.setting.name, comparison.table) for comparison in comparisons])


def runs_csv(*comparisons: Comparison) -> str:
    """The final metrics, one row a run; a named setting is the first column."""
    hidden = ["name", "folder", "typed", "setting"]
    return _to_csv([(part.runs.setting.name, part.runs.frame.drop(columns=hidden)) for part in comparisons])


def _latex_table(comparison: Comparison) -> str:
    where = f"{comparison.runs.experiment}{f', {heading(comparison.runs)}' if heading(comparison.runs) else ''}"
    lines = _comments(*remarks(comparison))
    lines += ["\\begin{table}[t]", "\\centering", "\\scriptsize", "\\setlength{\\tabcolsep}{3pt}"]
    lines += [f"\\caption{{Methods on {_tex(where)}: {_tex(caption(comparison))}}}\\smallskip"]
    for grid in grids(comparison):
        lines += ["", f"\\begin{{tabular}}{{@{{}}l{'r' * (len(grid.header) - 1)}@{{}}}}", "\\toprule"]
        lines += [_ampersands([two_lines(name) for name in grid.header]), "\\midrule"]
        for row in grid.rows:
            lines.append(_ampersands([value for value, _ in row]))
            if any(below for _, below in row):
                lines.append(_ampersands([below for _, below in row]))
            lines.append("\\addlinespace[2pt]")
        lines[-1:] = ["\\bottomrule", "\\end{tabular}", "\\par\\medskip"]
    return "\n".join([*lines[:-1], "\\end{table}"])


def _means(comparison: Comparison) -> Grid:
    scales = {m: comparison.scale(m) for m in comparison.measures}
    rows = []
    for row in comparison.rows:
        span = f"{row['seed_first']}–{row['seed_last']}" if row["n"] > 1 else str(row["seed_first"])
        cells: list[Cell] = [(row["name"], ""), (span, f"(n = {row['n']})")]
        for measure, scale in scales.items():
            mean, error, paper, paper_error = (
                row.get(f"{measure.metric}/{part}", float("nan")) for part in ("mean", "se", "paper_mean", "paper_se")
            )
            below = "" if pd.isna(paper) else f"[{scale.with_error(paper, paper_error)}]"
            cells.append((scale.with_error(mean, error), below))
        rows.append(cells)
    header = ["Method", "Seeds", *(measure.title + scale.unit for measure, scale in scales.items())]
    return Grid("Mean ± standard error" + (" [paper]" if comparison.paper else ""), header, rows)


def _contrasts(comparison: Comparison) -> Grid:
    scale, share = comparison.scale(comparison.primary), Scale(0, 2)
    header = [
        "Method",
        "IQM",
        *([f"Trapped (>{comparison.trapped_above:g})"] if comparison.counts_trapped else []),
    ]
    if comparison.reference.key:
        header += [f"Difference to {comparison.reference_name}", "Pairs", "P(improvement)"]
    rows = []
    for row in comparison.rows:
        cells: list[Cell] = [(row["name"], ""), _interval(scale, row, "iqm")]
        if comparison.counts_trapped:
            cells.append((UNKNOWN if pd.isna(row["trapped"]) else f"{row['trapped']:.0f} of {row['n']}", ""))
        if comparison.is_reference(row):
            cells += [("reference", ""), (UNKNOWN, ""), (UNKNOWN, "")]
        elif comparison.reference.key:
            pairs = row.get("difference_n", float("nan"))
            cells += [
                _interval(scale, row, "difference", signed=True),
                (UNKNOWN if pd.isna(pairs) else f"{pairs:.0f}", ""),
                _interval(share, row, "improvement"),
            ]
        rows.append(cells)
    return Grid(f"{comparison.primary.title}{scale.unit} [95% interval]", header, rows)


def _differences(comparison: Comparison) -> Grid:
    others = {measure: comparison.scale(measure) for measure in comparison.contrasted[1:]}
    rows = []
    for row in comparison.rows:
        cells: list[Cell] = [(row["name"], "")]
        for measure, scale in others.items():
            column = comparison.difference_column(measure)
            cells.append(
                ("reference", "") if comparison.is_reference(row) else _interval(scale, row, column, signed=True)
            )
        rows.append(cells)
    header = ["Method", *(measure.title + scale.unit for measure, scale in others.items())]
    return Grid(f"Difference to {comparison.reference_name} [95% interval]", header, rows)


def _interval(scale: Scale, row: Row, name: str, signed: bool = False) -> Cell:
    interval = interval_of(row, name)
    return scale.interval(interval, signed)


def _to_csv(tables: Sequence[tuple[str, pd.DataFrame]]) -> str:
    named = []
    for setting, table in tables:
        if setting:
            table = table.copy()
            table.insert(0, "setting", setting)
        named.append(table)
    return str(pd.concat(named).to_csv(index=False))


def _pipes(cells: list[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _ampersands(cells: list[str]) -> str:
    # The empty group keeps a leading bracket from being read as the optional argument of the \\ before it.
    return "{}" + " & ".join(_tex(cell) for cell in cells) + " \\\\"


def _comments(*lines: str) -> list[str]:
    return [f"% {line}".replace("…", "...").encode("ascii", "replace").decode() for line in lines]


def _tex(text: str) -> str:
    escaped = re.sub(".", lambda match: _TEX.get(match[0], match[0]), text).replace("}$$^{", "")
    return f"\\shortstack[r]{{{escaped}}}".replace("\n", "\\\\") if "\n" in escaped else escaped
