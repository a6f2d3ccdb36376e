"""The pictures of a recovery: what actions were worth, what is predicted, credit over time, where models disagree."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from credit.logged.panel import MIXTURE
from credit.logged.report import look
from credit.logged.report.gathered import Gathered
from credit.logged.report.look import INK, OTHERS, QUIET, REFERENCE, UNSURE, WIDE, Picture
from credit.logged.report.names import called, named
from credit.logged.report.numbers import number, short

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from credit.logged.result import LoggedCredit

MOST = 20  # actions, or their categories, in a picture
LINES = 5  # actions over time
BARS = 10
ROW = 0.26  # inches


def effects(result: LoggedCredit) -> Picture | None:
    """A dot and an interval for each action: in total, and per unit; hollow ones are what other models say."""
    frame = result.effects
    if not len(frame):
        return None
    own = look.colours(result.models)
    main = frame[frame["model"] == result.models[-1]]
    size = main["total"].abs().fillna(-1.0)
    main = main.loc[size.sort_values(ascending=False, kind="stable").index].head(MOST)
    others = [(name, frame[frame["model"] == name]) for name in result.models[:-1]]
    lines = main.to_dict("records")
    places = {(line["action"], line["level"]): len(lines) - 1 - at for at, line in enumerate(lines)}
    titles = {"total": "in total", "per_unit": "per unit"}

    def draw(width: float) -> Figure:
        beside = width == WIDE
        height = (0.55 + ROW * len(lines)) * (1 if beside else 2) + (0 if beside else 0.2)
        figure, panels = look.figure(width, height, 2, beside, sharey=beside)
        for panel, (key, title) in zip(panels, titles.items(), strict=True):
            for name, other in others:
                _dots(panel, other.to_dict("records"), places, key, own[name], hollow=True)
            _dots(panel, lines, places, key, own[result.models[-1]])
            _rows(panel, [named(line, 28 if beside else 18) for line in lines][::-1], title)
            _numberless(panel, lines, places)
        return figure

    said = "; ".join(f"{named(line)} {number(line['total'])}" for line in lines if line["told"])
    key = [(called(name), colour) for name, colour in own.items()] if others else []
    return look.drawn(
        "effects", f"What actions were worth in total, with intervals: {said or 'none is told'}", draw, key
    )


def _dots(
    panel: Axes,
    lines: Sequence[dict[Any, Any]],
    places: dict[Any, int],
    key: str,
    colour: str,
    hollow: bool = False,
) -> None:
    """A dot with its interval at the place of each line that has a number."""
    for line in lines:
        place = places.get((line["action"], line["level"]))
        value, low, high = (float(line[f"{key}{end}"]) for end in ("", "_low", "_high"))
        if place is None or line["note"]:
            continue
        if hollow:
            panel.plot(value, place + 0.22, "o", ms=3.6, mfc="none", mec=colour, mew=1)
            continue
        if np.isfinite(low):
            panel.plot([low, high], [place, place], color=colour, lw=2, solid_capstyle="butt")
        panel.plot(value, place, "o", ms=5.5, color=colour)


def _numberless(panel: Axes, lines: Sequence[dict[Any, Any]], places: dict[Any, int]) -> None:
    """Words in the place of a number, beside zero, where there is room."""
    low, high = panel.get_xlim()
    side = 1 if high > -low else -1
    for line in lines:
        if line["note"]:
            panel.annotate(
                "never moved" if line["told"] or not line["rows"] else "not told apart",
                (0, places[line["action"], line["level"]]),
                (6 * side, 0),
                textcoords="offset points",
                ha="left" if side > 0 else "right",
                va="center",
                color=QUIET,
                style="italic",
                fontsize=7.5,
            )


def _rows(panel: Axes, names: Sequence[str], title: str) -> None:
    """A line a name, and where zero is."""
    look.plain(panel, across=True)
    panel.axvline(0, color=QUIET, lw=0.8, zorder=0.5)
    panel.set_yticks(range(len(names)), names)
    panel.tick_params(axis="y", labelcolor=INK)
    panel.set_ylim(-0.6, len(names) - 0.4)
    panel.set_title(title)
    _values(panel.xaxis, 4)


def _values(axis: Any, many: int) -> None:
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    axis.set_major_locator(MaxNLocator(many))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.10g}".replace("-", "−")))


def _marks(at: np.ndarray) -> dict[str, Any]:
    """Dots where there are few."""
    return {"marker": "o", "ms": 2.5} if len(at) < 40 else {}


def _times(panel: Axes, when: Sequence[str], wide: bool) -> None:
    """A few of the times, in words, without their hour where all have the same."""
    many = min(len(when), 5 if wide else 3)
    at = np.unique(np.linspace(0, len(when) - 1, many).round().astype(int))
    panel.set_xticks(at, [short(when[one], 16) for one in at])
    labels = panel.get_xticklabels()
    if len(labels) > 1:
        labels[0].set_horizontalalignment("left")
        labels[-1].set_horizontalalignment("right")
    panel.margins(x=0)
    _values(panel.yaxis, 4)
    look.plain(panel)


def prediction(result: LoggedCredit, data: Gathered) -> Picture | None:
    """Labels over time, and what fits predict that had not seen them."""
    if not np.isfinite(data.held_out[-1]).any():
        return None
    own = look.colours(result.models)[result.models[-1]]
    label = short(result.found.panel.roles.label)

    def draw(width: float) -> Figure:
        figure, (panel,) = look.figure(width, 2.3)
        at = np.arange(len(data.when))
        panel.plot(at, data.label, color=INK, lw=1.1, **_marks(at))
        panel.plot(at, data.held_out[-1], color=own, lw=1.6, **_marks(at))
        _times(panel, data.when, width == WIDE)
        return figure

    says = f"{label} over time, and what was predicted of it by fits that had not seen it"
    return look.drawn("prediction", says, draw, [(label, INK), ("predicted, unseen", own)])


def over_time(result: LoggedCredit, data: Gathered) -> Picture:
    """Expected credit of a row over time with its interval, and what actions brought of it."""
    own = look.colours(result.models)[result.models[-1]]
    lines = _largest(result, data)
    palette = (REFERENCE, UNSURE, *OTHERS)

    def draw(width: float) -> Figure:
        figure, panels = look.figure(width, 2.2 + (2.2 if lines else 0), 2 if lines else 1, sharex=True)
        at = np.arange(len(data.when))
        if np.isfinite(data.low).any():
            panels[0].fill_between(at, data.low, data.high, color=own, alpha=0.25, lw=0)
        panels[0].plot(at, data.credit, color=own, **_marks(at))
        panels[0].set_title("all of a row’s credit")
        for (_, values), colour in zip(lines, palette, strict=False):
            panels[-1].plot(at, values, color=colour, lw=1.3, **_marks(at))
        if lines:
            panels[-1].set_title("of which by action")
        for panel in panels:
            _times(panel, data.when, width == WIDE)
        return figure

    says = "Expected credit of a row over time" + (
        f", and of it by action: {', '.join(name for name, _ in lines)}" if lines else ""
    )
    return look.drawn("time", says, draw, [(name, colour) for (name, _), colour in zip(lines, palette, strict=False)])


def _largest(result: LoggedCredit, data: Gathered) -> list[tuple[str, np.ndarray]]:
    """Of the largest actions, what a row's credit has of each, over time; the rest of them together."""
    frame = result.effects_over_time
    if not len(frame):
        return []
    totals = frame.groupby("action", sort=False)["effect"].agg(lambda one: one.abs().sum())
    largest = list(totals.sort_values(ascending=False, kind="stable").index)
    by_action: pd.DataFrame = frame.pivot_table(index="period", columns="action", values="effect", aggfunc="sum")
    found = [(short(name), by_action[name].to_numpy() / data.rows) for name in largest[:LINES]]
    if rest := largest[LINES:]:
        found.append((f"{len(rest)} more", by_action[rest].sum(axis=1).to_numpy() / data.rows))
    return found


def disagreement(result: LoggedCredit, data: Gathered) -> Picture:
    """What each model says of a row over time, and how far the one that is best there may be off."""
    own = {name: colour for name, colour in look.colours(result.models).items() if name != MIXTURE}

    def draw(width: float) -> Figure:
        figure, (above, below) = look.figure(width, 3.6, 2, sharex=True)
        at = np.arange(len(data.when))
        for colour, values in zip(own.values(), data.each, strict=True):
            above.plot(at, values, color=colour, lw=1.3, **_marks(at))
        above.set_title("a row’s credit by each model")
        below.fill_between(at, 0, data.disagreement, color=UNSURE, alpha=0.2, lw=0)
        below.plot(at, data.disagreement, color=UNSURE, **_marks(at))
        below.set_ylim(bottom=0)
        below.set_title("disagreement")
        for panel in (above, below):
            _times(panel, data.when, width == WIDE)
        return figure

    key = [(called(name), colour) for name, colour in own.items()]
    return look.drawn("disagreement", "A row’s credit by each model, and disagreement, over time", draw, key)


def where(result: LoggedCredit, data: Gathered) -> Picture | None:
    """How far models lie apart in the groups and under the actions where they do most."""
    by = (f"by {short(result.found.panel.roles.group)}", data.groups), ("by what was done", data.actions)
    shown = [(title, sorted(shares, key=lambda one: -one.apart)[:BARS]) for title, shares in by if len(shares) > 1]
    if not shown:
        return None

    def draw(width: float) -> Figure:
        beside = width == WIDE
        sizes = [0.45 + ROW * len(shares) for _, shares in shown]
        height = max(sizes) if beside else sum(sizes) + 0.2
        figure, panels = look.figure(width, height, len(shown), beside, **({} if beside else {"height_ratios": sizes}))
        for panel, (title, shares) in zip(panels, shown, strict=True):
            names = [short(one.name, 24 if beside else 20) for one in shares][::-1]
            panel.barh(range(len(names)), [one.apart for one in shares][::-1], color=UNSURE, height=0.55)
            _rows(panel, names, title)
            panel.set_xlim(left=0)
        return figure

    said = "; ".join(f"{title}: {short(shares[0].name)}" for title, shares in shown)
    return look.drawn("where", f"Where models lie farthest apart, {said}", draw)
