"""What figures with a panel a setting share: how a row is called and drawn, the panels, and what frames them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, product

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from credit.report import style
from credit.report.comparison import Comparison
from credit.report.groups import Key, ordered_groups
from credit.report.labels import row_names, title

COLUMNS = 2  # panels side by side
PLOT, LETTER, LINE = 4.4, 0.066, 0.145  # inches: a panel without names, a letter of these, a line of them
MARGIN = 0.02  # of an axis, beyond what is drawn: what lies at 0 is seen
RATE = (0.0, 1.0)  # the axis of a rate
APART = 5.0  # points between it and the other axis: what lies at 0 is seen


@dataclass(frozen=True)
class Look:
    """How a method and slug is called and drawn, in every panel."""

    name: str
    colour: str
    dashes: object


def looks(comparisons: Sequence[Comparison]) -> dict[Key, Look]:
    """The look of every row, in the order of tables: one colour a method, dashes and then shades for its variants."""
    names = row_names(comparisons)
    order = _order(comparisons)
    palette = style.colours(method for method, _ in order)
    variants: dict[str, Iterator[tuple[int, object]]] = {
        method: iter(product(range(len(order)), style.DASHES)) for method in palette
    }
    found = {}
    for key in order:
        shade, dashes = next(variants[key[0]])
        found[key] = Look(names[key], style.shade(palette[key[0]], shade), dashes)
    return found


def _order(comparisons: Sequence[Comparison]) -> list[Key]:
    """All rows in the order of tables; where several are sorted each by itself, in that of the first."""
    tables = [[(method, slug) for method, slug, _ in comparison.groups] for comparison in comparisons]
    frame = pd.concat([comparison.runs.frame for comparison in comparisons])
    usual = [(method, slug) for method, slug, _ in ordered_groups(frame)]
    if all(table == [key for key in usual if key in table] for table in tables):
        return usual
    return list(dict.fromkeys(chain(*tables)))


def panels(number: int, width: float, height: float, *, sharey: bool = False) -> tuple[Figure, list[Axes]]:
    """A figure with so many panels, each of this size in inches."""
    columns = min(number, COLUMNS)
    rows = -(-number // columns)
    figure = Figure(figsize=(width * columns, height * rows), layout="constrained")
    places = figure.subplots(rows, columns, sharey=sharey, squeeze=False).ravel()
    for place in places[number:]:
        place.set_visible(False)
    return figure, list(places[:number])


def frame(figure: Figure, comparisons: Sequence[Comparison], below: str) -> None:
    """Say above the panels what all runs share, and below them what is common to all axes."""
    style.entitle(figure, title(comparisons))
    figure.supxlabel(style.wrapped(below, figure.get_figwidth()), fontsize=8.5)
