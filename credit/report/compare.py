"""From finished runs to a folder of tables and figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from credit.core.errors import UserError
from credit.report import tables
from credit.report.comparison import Comparison, metrics_of, summarise
from credit.report.groups import ordered_groups, require_reference
from credit.report.pointmaze.videos import make_videos
from credit.report.published import load_paper
from credit.report.runs import load_runs
from credit.report.settings import file_name, typed

if TYPE_CHECKING:
    from matplotlib.figure import Figure


TEXTS = {  # every report has these
    "table.md": tables.markdown,
    "table.csv": tables.csv,
    "table.tex": tables.latex,
    "runs.csv": tables.runs_csv,
}
KINDS = ("diagnostics", "maps", "doubts", "demonstrations", "trajectories")  # figures that not every report has


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
    def headline(self) -> dict[str, float]:
        """The few numbers that say what came out: the best row's mean of the first measure, rows and runs."""
        found = dict[str, float]()
        for part in self.comparisons:
            scores = part.table[f"{part.primary.metric}/mean"]
            best = scores.min() if part.primary.lower_is_better else scores.max()
            numbers = {"best": best, "rows": len(part.table), "runs": len(part.runs.frame)}
            prefix = f"{part.runs.setting.name}/" if len(self.comparisons) > 1 else ""
            found |= {f"{prefix}{name}": float(value) for name, value in numbers.items()}
        return found

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
    reference: str | None = None,
    diagnostics_seed: int | None = None,
    videos: bool = True,
    metric: str | None = None,
    sort: str | None = None,
    best: int | None = None,
    report: Path | None = None,
) -> Report:
    """Compare finished runs: write tables and figures to a folder of their own.

    Args:
        output: the folder that holds all experiments.
        experiment: which one.
        methods: only these; all by default.
        slugs: only these variants of a method, as `credit.report.variants.choose_variants` reads them; all by default.
        feedback: only settings of these names; all by default. Each is compared on its own.
        where: only settings with these values of the problem and the budget, such as `{"env.maze": "Large"}`.
        commits: only runs that were made by these commits of credit, by their first digits.
        seed: the first seed.
        replicas: how many seeds.
        trapped_above: final regret above which a seed counts as trapped.
        reference: what the others are compared to, METHOD, VARIANT or METHOD/VARIANT; by default the method
            `reference`, or the default variant of the only method.
        diagnostics_seed: draw the maps of this seed; by default the mean over seeds. In a maze its trajectories and
            videos too; by default those of the seed of median success.
        videos: film the final policies in a maze, where a video is missing or older than its run.
        metric: by which methods are ranked; None for what their judge ranks by.
        sort: order rows by this metric, the best first.
        best: show only so many rows of a setting, the best by `metric`.
        report: where it goes, a folder that is new, empty or has an earlier report. By default that is
            `<output>/reports/<experiment>`, and beside it, by what was asked for, where runs are left out.

    Returns:
        The report.

    Raises:
        UserError: there is nothing finished to compare, runs cannot be averaged, a name is that of none, or the folder
            has files of others.
    """
    chosen = {"method": methods, "variant": slugs, "feedback": feedback, **(where or {}), "commit": commits}
    chosen |= {"seed": seed, "replicas": replicas, "best": best}
    folder = report or output / "reports" / folder_name(experiment, chosen)
    if report:
        _require_own(folder)
    runs = load_runs(
        output,
        experiment,
        methods=methods,
        slugs=slugs,
        seed=seed,
        replicas=replicas,
        commits=commits,
        where=where,
    )
    paper = load_paper(experiment)
    parts = runs.by_setting(feedback, where)
    if reference is not None:
        require_reference([row for part in parts for row in ordered_groups(part.frame)], reference, experiment)
    look = partial(summarise, reference=reference, trapped_above=trapped_above, paper=paper, metric=metric)
    comparisons = tuple(look(part, sort=sort, best=best) for part in parts)
    figures = _figures(comparisons, diagnostics_seed)
    texts = {name: make(*comparisons) for name, make in TEXTS.items()}
    try:
        files = _write(folder, texts, figures)
        films, remark = make_videos(comparisons, folder, diagnostics_seed) if videos else ([], "")
    except OSError as error:
        raise UserError(f"Cannot write the report to {folder}: {error.strerror}.") from error
    return Report(folder, (*files, *films), comparisons, remark)


def folder_name(experiment: str, chosen: Mapping[str, Any]) -> str:
    """The name of a report's folder: the experiment's, and what was asked for where that leaves out runs.

    Args:
        experiment: its name. chosen: key → what was asked for; None is all.

    Example:
        >>> folder_name("advertiser", {"method": ["reference", "delayed"], "seed": 1000, "replicas": None})
        'advertiser-method=reference,delayed-seed=1000'
    """
    words = []
    for key, value in chosen.items():
        if value is not None:
            listed = value if isinstance(value, list | tuple) and all(isinstance(part, str) for part in value) else None
            words.append(f"{key}={','.join(listed) if listed else typed(value)}")
    return file_name("-".join([experiment, *words])) if words else experiment


def _require_own(folder: Path) -> None:
    """Stop where a report would be written over what is none."""
    if folder.exists() and not folder.is_dir():
        raise UserError(f"report={folder} is a file; name a folder")
    if folder.exists() and any(folder.iterdir()) and not all((folder / name).exists() for name in TEXTS):
        raise UserError(f"report={folder} has files that are no report's; name a new or an empty folder")


def _figures(comparisons: Sequence[Comparison], diagnostics_seed: int | None) -> dict[str, Figure | None]:
    # Matplotlib takes half a second to import, which `credit --help` should not wait for.
    from credit.report import style
    from credit.report.distribution import distribution_figure
    from credit.report.figures import curves_figure
    from credit.report.heatmaps import heatmaps_figure
    from credit.report.pointmaze.figures import maze_figures
    from credit.report.recovered import recovered_maps

    figures: dict[str, Figure | None] = {}
    with style.styled():
        figures["curves"] = curves_figure(comparisons)
        figures["distribution"] = distribution_figure(comparisons)
        for comparison in comparisons:
            for doubts in (False, True):
                maps = recovered_maps(comparison.runs, diagnostics_seed, doubts)
                if maps is not None:
                    kind = "doubts" if doubts else "diagnostics" if maps.by_cell else "maps"
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
