"""What `credit recover` shows: before the fit what it will do, and behind it what was found."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from credit.cli.output import page
from credit.logged.fits.folds import folds_of
from credit.logged.panel import LABEL_IS
from credit.logged.registered import Registered

if TYPE_CHECKING:
    from rich.console import Console

    from credit.cli.recovery_words import Request
    from credit.logged.panel import Panel
    from credit.logged.recovered import AnyModel, Options
    from credit.logged.result import LoggedCredit


def explained(panel: Panel, models: Sequence[AnyModel], asked: Request) -> None:
    """What the table is taken to be, and what is to be fitted."""
    console, roles, windows = page(), panel.roles, panel.windows
    groups = f" in {len(windows.groups)} groups ({roles.group})" if roles.group else ""
    labels = int(windows.labelled.sum())
    console.print(f"{panel.source}: {panel.rows:,} rows, {len(windows):,} windows ({roles.window}){groups}")
    console.print(f"label    {roles.label}, {LABEL_IS[roles.label_is]}; {labels:,} windows have one")
    for name, columns in (("actions", roles.actions), ("states", roles.states), ("stock", roles.stock)):
        if columns:
            console.print(f"{name:<8} {', '.join(columns)}")
    for model in models:
        formula = model.terms.formula or "1 + every column"
        shown = f"{model.name:<8} {formula}  ({len(model.terms.names)} columns with all candidates)"
        console.print(shown if model.terms.choices else f"{model.name:<8} {formula}")
    for sentence in panel.said:
        console.print(f"  · {sentence}")
    if asked.ask.mixer is not None and len(models) == 1:
        console.print("  · mixer has no effect: there is one model, and nothing is mixed")
    for model in models:
        if isinstance(model, Registered) and model.unsaved:
            console.print(f"  · there will be no model/ for new rows: {model.name}: {model.unsaved}")
    if asked.explain:
        options = asked.ask.options
        console.print(
            f"{options.draws} draws, intervals of {options.level:.0%}, {_folds(panel, options)}, residual "
            f"{options.residual}; the result goes to {asked.folder}; nothing was fitted"
        )


def _folds(panel: Panel, options: Options) -> str:
    """What labels will be held out in."""
    folds = folds_of(panel.windows, options.folds, options.gap or 0)
    count = len(folds.of)
    if options.gap is None:
        return f"{count} contiguous folds with a gap as long as residuals hang together"
    return f"{count} contiguous folds with a gap of {folds.gap} windows"


@contextmanager
def progress() -> Iterator[None]:
    """A bar of what is done at the moment, where somebody looks."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from credit.logged.progress import told_to

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f}%"))
    bar = Progress(*columns, TimeElapsedColumn(), console=console, transient=True, disable=not console.is_terminal)
    with bar:
        task = bar.add_task("", total=None, visible=False)
        with told_to(lambda what, done, of: bar.update(task, description=what, completed=done, total=of, visible=True)):
            yield


def shown(found: LoggedCredit, folder: Path) -> None:
    """What was found."""
    console = page()
    for sentence in found.said[len(found.found.panel.said) :]:
        console.print(f"  · {sentence}")
    for name, choice in found.chosen.items():
        if choice:
            console.print(f"  · {name}: {', '.join(choice.values())}")
    if unsaved := found.found.fitted.unsaved:
        console.print(f"  · there is no model/ for new rows: {unsaved}")
    _untold(console, found)
    _effects(console, found)
    for name, (alike, last) in found.r_squared.items():
        if alike != alike:  # nothing was held out, or nothing is left to explain
            continue
        console.print(f"held-out R² of {name}: {alike:.3f} against all steps alike, {last:.3f} against the last window")
    console.print(f"\nresult   {folder}", soft_wrap=True)
    console.print("  " + "  ".join(sorted(path.name for path in folder.iterdir())))


def _untold(console: Console, found: LoggedCredit) -> None:
    for one in found.found.telling.relations:
        console.print(f"  · not told by these windows: {one.text}; {one.remedy}")
    for line in found.told[found.told["told"] == "badly"].to_dict("records"):
        console.print(
            f"  · told badly: {line['column']} moves with {line['partner']} (its variance is "
            f"{line['inflation']:.0f} times as large)"
        )


def _effects(console: Console, found: LoggedCredit) -> None:
    from rich import box
    from rich.table import Table

    effects = found.effects
    if not len(effects):
        return
    main = effects[effects["model"] == found.models[-1]]
    table = Table(
        box=box.SIMPLE, title=f"what actions were worth ({found.models[-1]}, {_level(found)})", title_justify="left"
    )
    for name in ("action", "baseline", "per unit", "total", "note"):
        table.add_column(name, justify="left" if name in ("action", "note") else "right")
    for line in main.to_dict("records"):
        named = line["action"] if line["level"] is None else f"{line['action']}={line['level']}"
        table.add_row(
            named, str(line["baseline"]), _interval(line, "per_unit"), _interval(line, "total"), line["note"]
        )  # fmt: skip
    console.print(table)


def _level(found: LoggedCredit) -> str:
    return f"{found.found.options.level:.0%} intervals" if found.found.enough else "no intervals"


def _interval(line: Mapping[Any, Any], key: str) -> str:
    value, low, high = (line[name] for name in (key, f"{key}_low", f"{key}_high"))
    if value != value:
        return "—"
    return f"{value:.4g}" if low != low else f"{value:.4g} [{low:.4g}, {high:.4g}]"
