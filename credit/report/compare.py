"""From finished runs to a folder of tables and figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from credit.core.errors import UserError
from credit.report import tables
from credit.report.comparison import Comparison, metrics_of, summarise
from credit.report.pointmaze.videos import make_videos
from credit.report.published import load_paper
from credit.report.runs import load_runs

if TYPE_CHECKING:
    from matplotlib.figure import Figure


KINDS = ("diagnostics", "maps", "demonstrations", "trajectories")  # figures that not every report has


@dataclass(frozen=True, repr=False)
class Report:
    """What a comparison left behind.

    Attributes:
        folder: where the files are.
        files: every file that was written.
        comparisons: the numbers of each setting.
        remark: why videos of a maze were not made, in one line; empty where they were, or were not asked for.
    """

    folder: Path
    files: tuple[Path, ...]
    comparisons: tuple[Comparison, ...]
    remark: str = ""

    @property
    def metrics(self) -> dict[str, float]:
        """Its numbers by name."""
        return metrics_of(self.comparisons)

    @property
    def table(self) -> pd.DataFrame:
        """A row a method and variant, setting after setting: the columns of `Comparison.table`."""
        parts = [part.table.assign(setting=part.runs.setting.words) for part in self.comparisons]
        return pd.concat(parts, ignore_index=True).set_index(["setting", "method", "slug"])

    def __repr__(self) -> str:
        """In a line."""
        return f"Report({self.folder}: {len(self.table)} rows, {len(self.files)} files)"


def compare(
    output: Path,
    experiment: str,
    *,
    methods: Sequence[str] | None = None,
    slugs: Sequence[str] | None = None,
    feedback: Sequence[str] | None = None,
    where: Mapping[str, Any] | None = None,
    commits: Sequence[str] | None = None,
    seed: int | None = None,
    replicas: int | None = None,
    trapped_above: float = 300.0,
    reference: str = "reference",
    diagnostics_seed: int | None = None,
    videos: bool = True,
    metric: str | None = None,
) -> Report:
    """Compare finished runs: write tables and figures to `<output>/reports/<experiment>`.

    Args:
        output: the folder that holds all experiments.
        experiment: which one.
        methods: only these; all by default.
        slugs: only these variants of a method; all by default.
        feedback: only settings of these names; all by default. Each is compared on its own.
        where: only settings with these values of the problem and the budget, such as `{"env.maze": "Large"}`.
        commits: only runs that were made by these commits of credit, by their first digits.
        seed: the first seed.
        replicas: how many seeds.
        trapped_above: final regret above which a seed counts as trapped.
        reference: the method that the others are compared to.
        diagnostics_seed: draw the maps of this seed; by default the mean over seeds. In a maze its trajectories and
            videos too; by default those of the seed of median success.
        videos: film the final policies in a maze, where a video is missing or older than its run.
        metric: by which methods are ranked; None for what their judge ranks by.

    Returns:
        The report.

    Raises:
        UserError: there is nothing finished to compare, or runs that cannot be averaged.
    """
    runs = load_runs(output, experiment, methods=methods, slugs=slugs, seed=seed, replicas=replicas, commits=commits)
    paper = load_paper(experiment)
    comparisons = tuple(
        summarise(part, reference=reference, trapped_above=trapped_above, paper=paper, metric=metric)
        for part in runs.by_setting(feedback, where)
    )
    figures = _figures(comparisons, diagnostics_seed)
    texts = {
        "table.md": tables.markdown(*comparisons),
        "table.csv": tables.csv(*comparisons),
        "table.tex": tables.latex(*comparisons),
        "runs.csv": tables.runs_csv(*comparisons),
    }
    folder = output / "reports" / experiment
    try:
        files = _write(folder, texts, figures)
        films, remark = make_videos(comparisons, folder, diagnostics_seed) if videos else ([], "")
    except OSError as error:
        raise UserError(f"Cannot write the report to {folder}: {error.strerror}.") from error
    return Report(folder, (*files, *films), comparisons, remark)


def _figures(comparisons: Sequence[Comparison], diagnostics_seed: int | None) -> dict[str, Figure | None]:
    # Matplotlib takes half a second to import, which `credit --help` should not wait for.
    from credit.report import style
    from credit.report.figures import curves_figure, distribution_figure
    from credit.report.heatmaps import heatmaps_figure
    from credit.report.pointmaze.figures import maze_figures
    from credit.report.recovered import recovered_maps

    figures: dict[str, Figure | None] = {}
    with style.styled():
        figures["curves"] = curves_figure(comparisons)
        figures["distribution"] = distribution_figure(comparisons)
        for comparison in comparisons:
            maps = recovered_maps(comparison.runs, diagnostics_seed)
            if maps is not None:
                kind = "diagnostics" if maps.by_cell else "maps"
                figures["_".join(filter(None, [kind, comparison.runs.setting.name]))] = heatmaps_figure(maps)
        figures |= maze_figures(comparisons, diagnostics_seed)
    return figures


def _write(folder: Path, texts: Mapping[str, str], figures: Mapping[str, Figure | None]) -> list[Path]:
    from credit.report import style

    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    files = [folder / name for name in texts]
    # An earlier report may have had other settings.
    old = {path.stem for kind in KINDS for path in folder.glob(f"{kind}*.svg")}
    with style.styled():
        for name, figure in {**figures, **dict.fromkeys(sorted(old - figures.keys()))}.items():
            files += style.save(figure, folder, name)
    return files
