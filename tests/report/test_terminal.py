"""Tables on a terminal: they fit, nothing in them is cut, and long names stand beside their numbers."""

from __future__ import annotations

import io
import re
from pathlib import Path

import pytest
from rich.console import Console

from credit.report.comparison import Comparison, summarise
from credit.report.published import load_paper
from credit.report.runs import load_runs
from credit.report.tables import csv, markdown
from credit.report.terminal import terminal_tables

from .conftest import WriteRun

LONG = [f"agent.first_updates=2,agent.updates={n},bonus.count.scale=0.1,reference.first_steps={n}" for n in (2, 3)]
ROUNDS = {"eval/success": 0.5, "eval/success_averaged": 0.5}
ROUNDS |= {f"eval/{name}{kind}": 0.5 for name in ("final", "auc", "lost", "learned") for kind in ("", "_averaged")}


def printed(comparison: Comparison, width: int) -> str:
    """What a terminal of this width shows."""
    console = Console(width=width, file=io.StringIO(), record=True)
    for table in terminal_tables(comparison, width):
        console.print(table)
    return console.export_text()


@pytest.fixture
def long(write_run: WriteRun, tmp_path: Path) -> Comparison:
    """A method, two variants of it with long names, and another with a long title; as many measures as there are."""
    for seed in range(2):
        for slug in ("default", *LONG):
            write_run("reference", seed, {name: value + 0.1 * seed for name, value in ROUNDS.items()}, slug=slug)
        write_run("a method with quite a long name, longer than a third", seed, ROUNDS)
    return summarise(load_runs(tmp_path / "outputs", "advertiser"))


@pytest.mark.parametrize("width", [60, 80, 100])
def test_terminal_tables_fit(write_run: WriteRun, tmp_path: Path, width: int) -> None:
    for seed, regret in enumerate((100.0, 110.0, 120.0, 130.0)):
        write_run("reference", seed, {"regret/cumulative": regret, "reward/mse": 0.002 + seed * 1e-4})
        write_run("block", seed, {"regret/cumulative": 2000.0 + seed, "reward/mse": None})
    comparison = summarise(load_runs(tmp_path / "outputs", "advertiser"), paper=load_paper("advertiser"))
    text = printed(comparison, width)
    assert "…" not in text
    assert "#1" not in text
    assert "115.0 ± 6.5" in text
    assert "[195.4 ± 42.1]" in text
    assert "P(improvement)" in text


@pytest.mark.parametrize("width", [40, 80, 100])
def test_no_cell_is_cut_whatever_the_names(long: Comparison, width: int) -> None:
    text = printed(long, width)
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= width
    assert text.count("(n = 2)") == 4


def test_long_variants_are_numbers_and_their_names_stand_above(long: Comparison) -> None:
    text = printed(long, 80)
    assert len(terminal_tables(long, 80)) <= 8  # the legend and three tables in parts; there are fifteen columns
    legend, _, tables = text.partition("Mean ± standard error")
    names = re.sub(r"\s+", "", legend)
    assert all(f"#{number}{slug}" in names for number, slug in enumerate(LONG, 1))
    assert "agent.updates" not in tables
    assert re.search(r"Ridge-UCB\s+#2", tables)
    assert all(slug in markdown(long) and slug in csv(long) for slug in LONG)


def test_the_same_variant_of_two_methods_has_one_number(write_run: WriteRun, tmp_path: Path) -> None:
    for method in ("reference", "disagreement"):
        for slug in LONG:
            write_run(method, 0, {"regret/cumulative": 50.0}, slug=slug)
    text = printed(summarise(load_runs(tmp_path / "outputs", "advertiser")), 80)
    assert "#2" in text
    assert "#3" not in text
