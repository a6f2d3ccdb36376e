"""The tables for a terminal: as many columns as fit, and numbers for variants whose names are long."""

from __future__ import annotations

import textwrap

from rich import box
from rich.cells import cell_len
from rich.table import Table
from rich.text import Text

from credit.report.comparison import Comparison
from credit.report.groups import Key
from credit.report.tables import Cell, Grid, grids, two_lines
from credit.report.variants import overrides

GAP = 2  # characters between two columns
SHARE = 3  # a name takes no more than this part of the width


def terminal_tables(comparison: Comparison, width: int = 100) -> list[Table]:
    """The tables, brackets on a line of their own; above them, where names are long, what their numbers stand for.

    Args:
        comparison: the numbers.
        width: columns of the terminal; a table that is wider goes on in a second one.
    """
    numbers = _numbers(comparison, width)
    names = [_name(row, numbers, width) for row in zip(*_titles(comparison), strict=True)]
    legend = [_legend(numbers, width)] if numbers else []
    return legend + [table for grid in grids(comparison) for table in _fit(grid, names, width)]


def _titles(comparison: Comparison) -> tuple[list[Key], list[str], list[str]]:
    """Of every row its key, the name of its method, and its own."""
    groups = comparison.groups
    methods = [str(group["name"].iloc[0]) for *_, group in groups]
    return [(method, slug) for method, slug, _ in groups], methods, [str(row["name"]) for row in comparison.rows]


def _numbers(comparison: Comparison, width: int) -> dict[Key, str]:
    """A number for each row whose variant would take too much of the width; the same variant has the same one."""
    keys, methods, names = _titles(comparison)
    rows = zip(keys, methods, names, strict=True)
    long = [key for key, method, name in rows if name != method and _size(two_lines(name)) > width // SHARE]
    places = {slug: number for number, slug in enumerate(dict.fromkeys(slug for _, slug in long), 1)}
    return {key: f"#{places[key[1]]}" for key in long}


def _name(row: tuple[Key, str, str], numbers: dict[Key, str], width: int) -> str:
    """What a row is called, in as many lines as it takes."""
    key, method, name = row
    name = f"{method} {numbers[key]}" if key in numbers else name
    lines = two_lines(name)
    return lines if _size(lines) <= width // SHARE else textwrap.fill(name, width // SHARE, break_on_hyphens=False)


def _legend(numbers: dict[Key, str], width: int) -> Table:
    """Number by number the whole name of a variant, which may be typed; its lines end between two overrides."""
    table = Table(title="Variants, by their numbers below", box=None, show_header=False, pad_edge=False)
    table.title_justify, table.title_style, table.padding = "left", "bold", (0, GAP - 1, 0, 0)
    room = width - GAP - max(map(len, numbers.values()))
    for slug, number in {slug: number for (_, slug), number in numbers.items()}.items():
        lines = textwrap.wrap(", ".join(overrides(slug)), room, break_on_hyphens=False)
        table.add_row(number, Text("\n".join(lines).replace(", ", ","), overflow="fold"))
    return table


def _fit(grid: Grid, names: list[str], width: int) -> list[Table]:
    """The grid as tables of at most `width`, each with the first column and as many others as fit."""
    header = [two_lines(name) for name in grid.header]
    rows = [[(name, ""), *row[1:]] for name, row in zip(names, grid.rows, strict=True)]
    columns = [[header[i], *(text for row in rows for text in row[i])] for i in range(len(header))]
    sizes = [max(map(_size, column)) + GAP for column in columns]
    parts = [[0]]
    for index in range(1, len(header)):
        if len(parts[-1]) > 1 and sum(sizes[i] for i in [*parts[-1], index]) > width:
            parts.append([0])
        parts[-1].append(index)
    return [_table(grid.title if part is parts[0] else "", part, header, rows) for part in parts]


def _table(title: str, part: list[int], header: list[str], rows: list[list[Cell]]) -> Table:
    table = Table(title=title or None, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD)
    table.show_edge, table.pad_edge, table.padding = False, False, (0, GAP - 1, 0, 0)
    for index in part:
        table.add_column(header[index], justify="right" if index else "left", overflow="fold")
    for row in rows:
        cells = [row[index] for index in part]
        table.add_row(*(Text(value) + Text(f"\n{below}" if below else "", "dim") for value, below in cells))
    return table


def _size(text: str) -> int:
    """Columns of its longest line."""
    return max(map(cell_len, text.split("\n")))
