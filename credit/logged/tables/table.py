"""An opened table: its rows in parts of whole windows, from memory or from files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from credit.core.errors import UserError
from credit.logged.panel import Ints, Panel, Part, Windows
from credit.logged.tables.features import Features
from credit.logged.tables.known import Known
from credit.logged.tables.sources import Source

if TYPE_CHECKING:
    import pandas as pd


class Table(Panel):
    """A panel over a source of rows that are in order.

    Args:
        source: of rows. known: what columns are. features: how they are read. windows: those that are left. lengths:
            rows of each window in the source, of those without a row that is left, too. said: what was guessed, done.

    Attributes:
        known: as it was given: enough to read another table in the same way.
    """

    def __init__(
        self, source: Source, known: Known, features: Features, windows: Windows, lengths: Ints, said: Sequence[str]
    ) -> None:
        self.known, roles = known, known.roles
        self.source, self.roles, self.columns, self.windows = source.name, roles, known.columns, windows
        self.rows, self.said = int(windows.steps.sum()), tuple(said)
        self._source, self._features, self._lengths = source, features, lengths
        others = [roles.window, roles.label, roles.time, roles.group, *roles.cost.values(), roles.propensity]
        others += roles.next_states
        self._others = [*dict.fromkeys(name for name in others if name in source.columns and name not in self.columns)]

    def parts(self, least: int | None = None) -> Iterator[Part]:
        """All rows, in order, in parts that end with a window, of about a million or as many as are asked for."""
        needed = [*dict.fromkeys([*self._features.needed, *self._others])]
        ends = np.cumsum(self._lengths)
        last, group, window = -1, -1, 0
        for frame, rows in _cut(self._source.chunks(needed, least), ends):
            first = last + 1
            last = int(np.searchsorted(ends, (ends[first - 1] if first else 0) + len(rows)))
            part = self._part(
                frame, rows, np.repeat(np.arange(last - first + 1), self._lengths[first : last + 1]), window
            )
            if not len(part):
                continue
            window = int(part.window[-1]) + 1
            yield Part(part.frame, part.window, part.group, bool(part.group[0] == group))
            group = int(part.group[-1])

    def sections(self) -> list[Panel]:
        """One a file.

        Raises:
            UserError: a window, or a group, goes on from one file to the next.
        """
        pieces = self._source.pieces()
        if len(pieces) == 1:
            return [self]
        if len(self._lengths) != len(self.windows):
            raise UserError(
                f"{self.source}: windows were dropped (data.missing=drop), and files cannot be jobs; fill gaps"
            )
        ends, bounds = np.cumsum(self._lengths), np.cumsum([piece.rows for piece in pieces])
        last = np.searchsorted(ends, bounds)
        windows = self.windows
        for piece, at, bound in zip(pieces, last[:-1], bounds, strict=False):
            if ends[at] != bound or windows.group[at] == windows.group[at + 1]:
                what = f"window {windows.id[at]}" if ends[at] != bound else f"group {windows.groups[windows.group[at]]}"
                raise UserError(
                    f"{piece.name}: {what} goes on in the next file, and jobs have nothing to carry over to each "
                    "other; write whole groups into a file, or leave hydra/launcher out"
                )
        found: list[Panel] = []
        for piece, begin, end in zip(pieces, [0, *(last[:-1] + 1)], last + 1, strict=True):
            own = slice(int(begin), int(end))
            some = replace(
                windows, id=windows.id[own], group=windows.group[own], time=windows.time[own], steps=windows.steps[own],
                label=windows.label[own], key=windows.key[own],
            )  # fmt: skip
            section = Table(piece, self.known, self._features, some, self._lengths[own], ())
            section.first = int(begin)
            found.append(section)
        return found

    def _part(self, frame: pd.DataFrame, rows: Ints, local: Ints, window: int) -> Part:
        """The rows that stay, with their windows counted from `window`."""
        import pandas as pd

        made = self._features.made(frame, rows)
        others = frame[self._others]
        if self._features.missing == "drop" and (gone := self._features.gaps(made, len(rows))).any():
            made = {name: values[~gone] for name, values in made.items()}
            others, rows, local = others[~gone], rows[~gone], local[~gone]
            local = np.unique(local, return_inverse=True)[1]
        number = local + window
        columns: dict[str, Any] = {**self._features.filled(made), **{str(name): others[name].array for name in others}}
        found = pd.DataFrame(columns, index=pd.Index(rows), copy=False)
        return Part(found, number.astype(np.int64), self.windows.group[number] if len(rows) else number)


def _cut(chunks: Iterator[tuple[pd.DataFrame, Ints]], ends: Ints) -> Iterator[tuple[pd.DataFrame, Ints]]:
    """The same rows, in pieces that end where windows do."""
    import pandas as pd

    frames: list[pd.DataFrame] = []
    numbers: list[Ints] = []
    seen = done = 0
    for frame, rows in chunks:
        frames.append(frame)
        numbers.append(rows)
        seen += len(rows)
        at = int(np.searchsorted(ends, seen, side="right"))
        whole = int(ends[at - 1]) if at else 0
        if whole <= done:
            continue  # a window that is longer than a chunk
        table = frames[0] if len(frames) == 1 else pd.concat(frames, ignore_index=True)
        every = numbers[0] if len(numbers) == 1 else np.concatenate(numbers)
        count = whole - done
        yield table.iloc[:count].reset_index(drop=True), every[:count]
        frames, numbers = ([table.iloc[count:]], [every[count:]]) if count < len(every) else ([], [])
        done = whole
