"""All pictures of a report on mazes, by file name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pandas as pd

from credit.report.comparison import Comparison
from credit.report.groups import display_name
from credit.report.labels import circumstances
from credit.report.pointmaze.tracks import file_name, load_tracks, typical

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class Shown:
    """A method and slug of one setting, and how it is called in titles and in file names."""

    comparison: Comparison
    group: pd.DataFrame
    title: str
    method: str
    slug: str

    def file(self, kind: str) -> str:
        """The name of a picture, without its ending."""
        return file_name(kind, self.comparison.runs.setting.name, self.method, self.slug)


def methods(comparisons: Sequence[Comparison]) -> Iterator[Shown]:
    """Every method and slug of every setting that is a maze."""
    for comparison in comparisons:
        if comparison.is_maze:
            for method, slug, group in comparison.groups:
                title = f"{comparison.runs.experiment}: {display_name(group)}{circumstances(comparison.runs, slug)}"
                yield Shown(comparison, group, title, method, slug)


def maze_figures(comparisons: Sequence[Comparison], seed: int | None) -> dict[str, Figure | None]:
    """Demonstrations, and of every method its trajectories and the maps of what it believes, and how far.

    Args:
        comparisons: one a setting; those that are no mazes are left out.
        seed: take this seed alone; by default maps are means, and trajectories are those of the median seed.

    Raises:
        UserError: a method has no such seed.
    """
    mazes = [comparison for comparison in comparisons if comparison.is_maze]
    if not mazes:
        return {}
    from credit.report.pointmaze.doubts import doubts_figure, load_doubts
    from credit.report.pointmaze.maps import beliefs_figure, load_beliefs
    from credit.report.pointmaze.pictures import demonstrations_figure, tracks_figure

    figures: dict[str, Figure | None] = {"demonstrations": demonstrations_figure(mazes)}
    for shown in methods(mazes):
        run = typical(shown.group, shown.comparison, seed)
        if run is not None:
            which = f"seed {run['seed']}" if seed is not None or len(shown.group) == 1 else f"median seed {run['seed']}"
            figures[shown.file("trajectories")] = tracks_figure(f"{shown.title}, {which}", load_tracks(run["folder"]))
        chosen = shown.group if seed is None else shown.group[shown.group["seed"] == seed]
        beliefs = load_beliefs(chosen)
        if beliefs is not None:
            who = f"seed {chosen['seed'].iloc[0]}" if beliefs.seeds == 1 else f"mean over {beliefs.seeds} seeds"
            figures[shown.file("maps")] = beliefs_figure(f"{shown.title}, {who}", beliefs)
        doubts = load_doubts(chosen)
        if doubts is not None:
            who = f"seed {chosen['seed'].iloc[0]}" if doubts.seeds == 1 else f"mean over {doubts.seeds} seeds"
            figures[shown.file("doubts")] = doubts_figure(f"{shown.title}, {who}", doubts)
    return figures
