"""The page: what is said, drawn and listed, put into `page.html`, which escapes all that comes from a table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from credit.core.version import __version__
from credit.logged.panel import MIXTURE
from credit.logged.report import figures, sentences, tables
from credit.logged.report.gathered import gathered
from credit.logged.report.numbers import number, percent, short

if TYPE_CHECKING:
    from credit.logged.result import LoggedCredit

RELATIONS = 3  # that are not folded
HERE = Path(__file__).parent


def written(found: LoggedCredit) -> str:
    """The report of a recovery as one HTML page, which asks for no other file; the same recovery, the same bytes.

    Args:
        found: what was recovered.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.get_template("page.html").render(**_filled(found))


def _filled(result: LoggedCredit) -> dict[str, Any]:
    """What the page has a place for."""
    found, data = result.found, gathered(result)
    several, policy = MIXTURE in result.models, result.policies
    differ = several and bool(result.rows.disagreement.any())
    return {
        "label": short(found.panel.roles.label, 60),
        "source": short(found.panel.source, 200),
        "version": __version__,
        "tiles": _tiles(result),
        "what": sentences.what(result, data),
        "worth": sentences.worth(result),
        "sure": list(sentences.sure(result)),
        "causes": list(sentences.causes(result)),
        "warned": list(sentences.warned(result)),
        "predicts": list(sentences.predicts(result)),
        "differ": list(sentences.differ(result)),
        "bits": found.bits,
        "main": result.models[-1],
        "several": several,
        "effects": figures.effects(result),
        "effects_tables": tables.effects(result).split(figures.MOST),
        "relations": list(sentences.untold(result))[: tables.MOST],
        "relations_shown": RELATIONS,
        "weak": _weak(result),
        "prediction": figures.prediction(result, data),
        "scores": tables.scores(result),
        "disagreement": figures.disagreement(result, data) if differ else None,
        "differing": differ,
        "where": figures.where(result, data) if differ else None,
        "by_group": tables.shares(data.groups, short(found.panel.roles.group)) if differ else None,
        "by_action": tables.shares(data.actions, "what was done") if differ else None,
        "top": tables.top(data) if differ else None,
        "time": figures.over_time(result, data),
        "details": tables.details(result),
        "durbin_watson": number(result.durbin_watson),
        "rho": found.rho,
        "said": result.said,
        "policy": policy,
        "policy_values": tables.policy_values(policy) if policy is not None and policy.values else None,
        "policy_table": tables.of_frame(policy.table, "policy.csv") if policy is not None else None,
    }


def _tiles(result: LoggedCredit) -> list[tuple[str, str]]:
    """A few numbers at the top, each with what it is."""
    found = result.found
    alike = result.r_squared[result.models[-1]][0]
    known = alike == alike
    lines = sentences.main_effects(result)
    told = sum(bool(line["told"]) for line in lines)
    less = "less" if alike >= 0 else "more"
    return [
        *(
            [(percent(abs(alike)), f"{less} squared error in windows not seen than if all rows were alike")]
            if known
            else []
        ),
        (f"{found.panel.rows:,}", f"rows in {len(found.panel.windows):,} windows"),
        *([(f"{told} of {len(lines)}", "actions that the windows tell")] if lines else []),
        (percent(found.options.level), f"intervals, from {len(found.units)} parts that are weighed anew")
        if found.enough
        else ("no", f"intervals: {len(found.units)} independent parts are too few")
        if not found.units.enough
        else ("no", f"intervals: {found.options.draws} draws are too few"),
    ]


def _weak(result: LoggedCredit) -> list[str]:
    """Columns that are told badly, a sentence each."""
    badly = result.told[result.told["told"] == "badly"].head(tables.MOST)
    return [
        f"{short(line['column'])} is told badly: it moves with {short(line['partner'])}, which makes its variance "
        f"{number(line['inflation'], 2)} times as large."
        for line in badly.to_dict("records")
    ]
