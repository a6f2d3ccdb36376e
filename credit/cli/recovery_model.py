"""`credit recover NEW --model DIR`: rows scored by a model that was fitted to another table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from credit.cli.output import page
from credit.logged.panel import LABEL_IS

if TYPE_CHECKING:
    from credit.cli.recovery_words import Request
    from credit.logged.saving import SavedModel
    from credit.logged.scored import ScoredTable
    from credit.logged.tables.table import Table


def without_effect(keys: Sequence[str], config_dirs: Sequence[str]) -> list[str]:
    """A sentence on each key that does nothing where a saved model scores; keys of `data` are for it to judge."""
    named = [key for key in keys if key != "data"] + ["--config-dir"] * bool(config_dirs)
    return [f"{key} has no effect with --model: the model was fitted, and says it; leave it out" for key in named]


def score(asked: Sequence[Request]) -> None:
    """Score, once all that can be refused was."""
    for number, (one, model, panel) in enumerate(list(_prepared(asked))):
        if len(asked) > 1:
            print(f"[{number + 1}/{len(asked)}] {' '.join(one.words)}")
        _explained(one, model, panel)
        if not one.explain:
            _one(one, model, panel)


def _prepared(asked: Sequence[Request]) -> Iterator[tuple[Request, SavedModel, Table]]:
    from credit.cli.recovery_place import placed
    from credit.logged.saving import SavedModel
    from credit.logged.tables.again import opened_again
    from credit.logged.writing import Folder

    taken: list[Path] = []
    for one in asked:
        assert one.model is not None
        model = SavedModel.read(one.model)
        Folder.require_free(one.folder, keep_models=True)
        place = placed(one, taken)
        taken.append(place.folder)
        yield place, model, opened_again(one.data, one.ask.data, model.known, models=model.fitted.names)


def _explained(asked: Request, model: SavedModel, panel: Table) -> None:
    """What the table is taken to be, and by what it is scored."""
    console, roles, windows = page(), panel.roles, panel.windows
    counted = f", {len(windows):,} windows ({roles.window})" if roles.window else ""
    groups = f" in {len(windows.groups)} groups ({roles.group})" if roles.group else ""
    console.print(f"{panel.source}: {panel.rows:,} rows{counted}{groups}")
    console.print(f"model    {', '.join(model.fitted.names)}, fitted to {model.source} ({asked.model})")
    if roles.label:
        labels = int(windows.labelled.sum())
        console.print(f"label    {roles.label}, {LABEL_IS[roles.label_is]}; {labels:,} windows have one")
    for sentence in panel.said:
        console.print(f"  · {sentence}")
    if asked.explain:
        console.print(f"the result goes to {asked.folder}; nothing was scored")


def _one(asked: Request, model: SavedModel, panel: Table) -> None:
    from credit.cli.recovery_place import CONFIG, parameters, written
    from credit.logged.writing import Folder

    assert asked.model is not None
    with Folder.made(asked.folder, asked.words) as folder:
        folder.write_text(CONFIG, written(asked))
        table = model.score(panel)
        folder.write_scored(table, asked.model, asked.format)
    _shown(table, asked)
    if asked.tracked:
        from credit.tracking.report_run import log_folder

        print(
            log_folder(asked.output, "recover", asked.name, asked.folder, table.metrics, dict(parameters(asked.tree)))
        )


def _shown(table: ScoredTable, asked: Request) -> None:
    console = page()
    for sentence in table.said[len(table.panel.said) :]:
        console.print(f"  · {sentence}")
    if table.r_squared == table.r_squared:
        console.print(f"R² of labels in this table: {table.r_squared:.3f} against all steps alike")
    console.print(f"\nresult   {asked.folder}", soft_wrap=True)
    console.print("  " + "  ".join(sorted(path.name for path in asked.folder.iterdir())))
