"""Output may fail where runs may not: the reader of a pipe that went away, a full disk, a terminal without √ and ±."""

from __future__ import annotations

import codecs
import contextlib
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from rich.console import Console

PLAIN = {
    "−": "-",
    "–": "-",
    "—": "-",
    "…": "...",
    "·": ".",
    "×": "x",
    "±": "+/-",
    "√": "sqrt ",
    "→": "->",
    "≥": ">=",
    "≤": "<=",
    "━": "=",
    "─": "-",
    "═": "=",
    "│": "|",
    "┃": "|",
    "ä": "ae",
    "ö": "oe",
    "ü": "ue",
    "ß": "ss",
    "α": "alpha",
    "β": "beta",
    "γ": "gamma",
    "ε": "epsilon",
    "λ": "lambda",
    "σ": "sigma",
    "τ": "tau",
    "φ": "phi",
}


def plainly(error: UnicodeError) -> tuple[str, int]:
    """What stands for characters that an encoding lacks: ASCII, `?` where nothing is like them."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(PLAIN.get(letter, "?") for letter in error.object[error.start : error.end]), error.end


codecs.register_error("plainly", plainly)


class Surviving:
    """A stream whose failures end its output, and nothing else.

    Args:
        stream: what is written to until that fails.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write, or lose it."""
        with contextlib.suppress(OSError):
            return self._stream.write(text)
        self._give_up()
        return len(text)

    def flush(self) -> None:
        """Flush, or lose it."""
        try:
            self._stream.flush()
        except OSError:
            self._give_up()

    def _give_up(self) -> None:
        """From now on what is written goes nowhere, also what is still in buffers, which Python flushes at its end."""
        with contextlib.suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def opened() -> None:
    """Let nothing else take the places of the standard streams, where the caller has closed them (`>&-`)."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            nowhere = os.open(os.devnull, os.O_RDWR)
            if nowhere != number:
                os.dup2(nowhere, number)
                os.close(nowhere)


def page(width: int = 100, markup: bool = False) -> Console:
    """A console for tables on standard output: as wide as the terminal, and `width` in a file or a pipe."""
    from rich.console import Console

    console = Console(highlight=False, markup=markup)
    if not console.is_terminal:
        console.width = width
    return console


def fitted(line: str) -> str:
    """A line no wider than the terminal, its rest below where its last column begins; whole in a file or a pipe."""
    width = shutil.get_terminal_size().columns
    if not sys.stdout.isatty() or len(line) <= width:
        return line
    margin = len(line) - len(line.lstrip())
    columns = [gap.end() for gap in re.finditer(r"\S {2,}(?=\S)", line) if gap.end() <= width // 2]
    behind = " " * max([margin + 2, *columns])
    folded = textwrap.wrap(line, width, subsequent_indent=behind, break_long_words=False, break_on_hyphens=False)
    return "\n".join(folded)


@contextlib.contextmanager
def surviving() -> Iterator[None]:
    """Standard output and error that outlive their readers, and write what they can; where they are closed, nothing."""
    opened()
    before = sys.stdout, sys.stderr
    streams = [stream or os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", encoding="utf-8") for stream in before]
    for stream in streams:
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="plainly")
    sys.stdout, sys.stderr = map(Surviving, streams)
    try:
        yield
        sys.stdout.flush()
    finally:
        sys.stdout, sys.stderr = before
