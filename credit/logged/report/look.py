"""How pictures of the page look: the colours of credit's figures, by name, and SVG that is part of the page.

Pictures are drawn twice, for wide and for narrow screens, so that words keep their size. Colours become variables of
the page, which has others for the dark, and words stay words in the page's own type.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from credit.logged.panel import MIXTURE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDE, NARROW = 7.4, 3.6  # inches
INK, QUIET, GRID = "#1d2430", "#5b6472", "#e4e7eb"
UNSURE = "#d55e00"  # what models disagree by
REFERENCE, TOGETHER = "#0072b2", "#009e73"
OTHERS = ("#cc79a7", "#e69f00", "#56b4e9", "#999933", "#aa4499", "#882255")
NAMES = {INK: "ink", QUIET: "quiet", GRID: "grid", UNSURE: "unsure", REFERENCE: "reference", TOGETHER: "mixture"} | {
    colour: f"other{number}" for number, colour in enumerate(OTHERS)
}
SETTINGS: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "text.color": INK,
    "text.parse_math": False,  # a column with dollars is a column
    "axes.titlesize": 8.5,
    "axes.titlelocation": "left",
    "axes.titlecolor": INK,
    "axes.labelcolor": QUIET,
    "axes.edgecolor": QUIET,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.unicode_minus": True,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "lines.linewidth": 1.5,
    "svg.fonttype": "none",
}


@dataclass(frozen=True)
class Picture:
    """A picture in the page.

    Attributes:
        wide, narrow: SVG. says: what is seen, for those who do not see it. key: (colour's name, word) of what is drawn.
    """

    wide: str
    narrow: str
    says: str
    key: tuple[tuple[str, str], ...] = ()


def colours(models: Sequence[str]) -> dict[str, str]:
    """A colour for each model and the mixture."""
    surrogates = [name for name in models[1:] if name != MIXTURE]
    others = {name: OTHERS[number % len(OTHERS)] for number, name in enumerate(surrogates)}
    return {models[0]: REFERENCE, **others} | ({MIXTURE: TOGETHER} if MIXTURE in models else {})


def drawn(name: str, says: str, draw: Callable[[float], Figure], key: Sequence[tuple[str, str]] = ()) -> Picture:
    """A picture of both widths.

    Args:
        name: of the picture, by which its marks are called. says: its alternative text. draw: width in inches → figure.
        key: (word, colour) of what is drawn.
    """
    with _styled():
        wide, narrow = (_svg(draw(width), f"{name}-{size}") for size, width in (("w", WIDE), ("n", NARROW)))
    return Picture(wide, narrow, says, tuple((NAMES[colour], word) for word, colour in key))


def figure(
    width: float, height: float, panels: int = 1, beside: bool = False, **more: Any
) -> tuple[Figure, list[Axes]]:
    """A figure with panels below or beside each other."""
    from matplotlib.figure import Figure

    made = Figure(figsize=(width, height), layout="constrained")
    rows, columns = (1, panels) if beside else (panels, 1)
    axes = made.subplots(rows, columns, squeeze=False, **more)
    return made, list(axes.ravel())


def plain(axes: Axes, across: bool = False) -> None:
    """Quiet axes: a grid along the values, no ticks."""
    axes.grid(True, axis="x" if across else "y")
    axes.tick_params(length=0)
    axes.spines["left" if not across else "bottom"].set_visible(False)
    if across:
        axes.spines["left"].set_visible(False)


@contextmanager
def _styled() -> Iterator[None]:
    import matplotlib as mpl

    with mpl.rc_context(SETTINGS), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font")  # a browser has it
        yield


def _svg(drawing: Figure, salt: str) -> str:
    """A figure as an element of a page: no header, no identifiers that nothing asks for, no colour of its own."""
    import matplotlib as mpl

    written = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": salt}):
        drawing.savefig(written, format="svg", transparent=True, metadata={"Date": None})
    text = written.getvalue()
    text = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", text[text.index("<svg") :], flags=re.S)
    head, body = text.split(">", 1)
    box = re.search(r'viewBox="[^"]*"', head)
    asked = set(re.findall(r"(?:href=\"#|url\(#)([^\")]+)", body))

    def tag(found: re.Match[str]) -> str:
        """What is written in a picture may look like an attribute: only tags are changed."""
        one = re.sub(r' id="([^"]*)"', lambda name: name[0] if name[1] in asked else "", found[0])
        one = re.sub(r"font: (?:\d+ )?([\d.]+px) [^;\"]*", r"font-size: \1", one)
        return re.sub("|".join(NAMES), lambda colour: f"var(--{NAMES[colour[0]]})", one)

    body = re.sub(r"<[^>]*>", tag, body)
    return f'<svg {box[0] if box else ""} aria-hidden="true">' + re.sub(r"\s*\n\s*", "\n", body).strip()
