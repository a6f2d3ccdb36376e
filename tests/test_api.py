"""What the commands do, from Python: light to import, shown by `dir`, with objects and errors instead of exits."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import credit


def test_import_is_light_and_dir_shows_all() -> None:
    code = "import sys, credit; print(*dir(credit)); print(*{'torch', 'pandas', 'hydra'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    names, heavy = done.stdout.splitlines()
    assert {*credit.__all__} <= {*names.split()}
    assert heavy == ""


def test_all_names_are_there_with_an_example() -> None:
    for name in credit.__all__:
        thing = getattr(credit, name)
        if callable(thing) and name not in ("Result", "Run", "UserError"):
            assert "Example" in (thing.__doc__ or ""), name


@pytest.mark.parametrize("call", ["run", "sweep", "check", "compose"])
@pytest.mark.parametrize("wrong", [[{"method": "x"}], "method=x", [1], None])
def test_what_is_no_list_of_words(call: str, wrong: Any) -> None:
    with pytest.raises(credit.UserError, match=r"overrides: .* is a \w+; give a list of words: \['method=reference'"):
        getattr(credit, call)(wrong)
    with pytest.raises(credit.UserError, match=r"config_dirs: 'conf' is a str"):
        getattr(credit, call)(["method=reference"], config_dirs="conf")


@pytest.mark.parametrize("call", ["run", "check", "compose"])
def test_several_values_are_a_sweep(call: str) -> None:
    with pytest.raises(credit.UserError, match=r"'method=reference,delayed' names several values.*credit\.sweep"):
        getattr(credit, call)(["method=reference,delayed"])


def test_list() -> None:
    kinds = credit.list()
    assert "count" in kinds.loc["bonus", "options"]
    bonus = credit.list("bonus")
    assert bonus.index.name == "bonus"
    assert bonus.loc["count", "what"].startswith("Count bonus")
    assert any(line.startswith("scale = ") for line in bonus.loc["count", "parameters"])
    assert credit.list("method").loc["reference", "parameters"] == []
    with pytest.raises(credit.UserError, match="did you mean 'bonus'"):
        credit.list("bonsu")


def test_check() -> None:
    row = credit.check(["method=disagreement", "mixer.alpha=.3"]).loc["mixer.alpha"]
    assert (row["value"], row["origin"]) == (0.3, "command line")
    with pytest.raises(credit.UserError, match=r"mixer\.alfa"):
        credit.check(["mixer.alfa=1"])


def swept(output: Path) -> pd.DataFrame:
    words = ["trainer.steps=70", "replicas=2", "tracking=none", f"output='{output}'", "hydra/launcher=basic"]
    return credit.sweep(["method=reference,random", *words])


def test_sweep(tmp_path: Path) -> None:
    runs = swept(tmp_path)
    assert runs.index.tolist() == [(0, 0), (0, 1), (1, 0), (1, 1)]
    assert runs["method"].tolist() == ["reference"] * 2 + ["random"] * 2
    assert runs["overrides"].iloc[0] == "method=reference"
    assert (runs["status"] == "FINISHED").all()
    assert runs["regret/cumulative"].notna().all()
    assert all((folder / "policy.pt").exists() for folder in runs["folder"])


@pytest.mark.thorough
def test_compare(tmp_path: Path) -> None:
    swept(tmp_path)
    report = credit.compare("advertiser", tmp_path, methods=["reference", "random"])
    assert report.table.index.get_level_values("method").tolist() == ["reference", "random"]
    assert repr(report).endswith("files)")
    with pytest.raises(credit.UserError, match="no choice 'method'; did you mean 'methods'"):
        credit.compare("advertiser", tmp_path, method="reference")
    with pytest.raises(credit.UserError, match="No finished runs"):
        credit.compare("sepsis", tmp_path)


def test_a_job_that_fails_is_a_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from credit.agents.random import Random
    from credit.core.errors import RunError

    def fail(*_: Any) -> None:
        raise RunError("no more")

    monkeypatch.setattr(Random, "improve", fail)
    words = [
        "method=random",
        "trainer.steps=70",
        "replicas=1",
        "tracking=none",
        f"output='{tmp_path}'",
        "hydra/launcher=basic",
    ]
    assert credit.sweep(words)["status"].tolist() == ["FAILED"]
