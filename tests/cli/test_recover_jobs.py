"""`credit recover 'shards/*.parquet' hydra/launcher=…`: one job a file, and the figures of one process."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from credit.cli.main import main
from credit.cli.recovery_jobs import Pass, runner
from credit.core.errors import RunError, UserError
from credit.logged.panel import Panel
from tests.logged.test_recovering import table

from .launching import environment

WORDS = ("data.window=w", "data.label=y", "data.time=t", "data.group=g", "data.actions=[x]", "data.states=[z]")
QUICK = ("draws=10", "tracking=none", "reference.formula=1 + x + z", "format=csv")


@pytest.fixture
def shards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    Path("shards").mkdir()
    for name, rows in table(groups=4).groupby("g"):
        rows.to_parquet(f"shards/{name}.parquet", index=False)
    return "shards/*.parquet"


@pytest.mark.slow
@pytest.mark.parametrize("launcher", ["local", "ray"])
def test_shards_on_a_launcher_give_the_figures_of_one_process(shards: str, launcher: str) -> None:
    if launcher == "ray":
        pytest.importorskip("ray")
    spread = [f"hydra/launcher={launcher}", "output=spread"]
    for words in (["output=alone"], spread):
        command = [sys.executable, "-m", "credit", "recover", shards, *WORDS, *QUICK, "name=it", *words]
        ended = subprocess.run(
            command, env=environment(Path.cwd()), capture_output=True, text=True, timeout=500, check=False
        )
        assert ended.returncode == 0, ended.stdout + ended.stderr
    for name in ("steps.csv", "windows.csv", "effects.csv", "told.csv"):
        alone, spread_ = (pd.read_csv(Path(where, "recover/it", name)) for where in ("alone", "spread"))
        pd.testing.assert_frame_equal(alone, spread_, rtol=1e-10, atol=1e-10)
    assert [path.name for path in Path("spread/recover").iterdir()] == ["it"]  # nothing of the jobs is left


@pytest.mark.parametrize(
    ("data", "words", "said"),
    [
        ("shards/g0.parquet", ("hydra/launcher=local",), r"hydra/launcher=local has no effect: .* is one table"),
        ("shards/*.parquet", ("hydra/launcher=loca",), r"hydra/launcher=loca: no such option; did you mean 'local'"),
        ("shards/*.parquet", ("hydra/launcher=local", "--model", "m"), r"has no effect: rows are scored in this"),
        ("split/*.parquet", ("hydra/launcher=local",), r"0\.parquet: group g0 goes on in the next file"),
    ],
)
def test_a_launcher_that_has_nothing_to_launch_is_refused(
    shards: str, data: str, words: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("split").mkdir()
    whole = table(groups=2)
    whole[:100].to_parquet("split/0.parquet", index=False)
    whole[100:].to_parquet("split/1.parquet", index=False)
    assert main(["recover", data, *WORDS, *QUICK, *words]) == 2
    assert re.search(said, " ".join(capsys.readouterr().err.split()))
    assert not Path("outputs").exists()


class _Section(Panel):
    def __init__(self, number: int) -> None:
        self.number = number

    def parts(self) -> None:  # type: ignore[override]
        raise NotImplementedError


def _named(section: _Section) -> int:
    if section.number == 1:
        raise UserError("page 3 of b.parquet is damaged")
    if section.number == 2:
        raise ZeroDivisionError
    return section.number


def test_what_ends_a_job_ends_the_command_with_its_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def launch(task: Pass, jobs: int, *others: object) -> dict[int, str]:
        failed = {}
        for number in range(jobs):
            monkeypatch.setattr("credit.config.launchers.job_number", lambda number=number: number)
            try:
                task(None)
            except ArithmeticError as error:
                failed[number] = f"{type(error).__name__}: {error}"
        return failed

    monkeypatch.setattr("credit.config.launchers.launch", launch)
    run = runner(["hydra/launcher=local"], tmp_path / "jobs", [])
    assert run(_named, [_Section(0), _Section(5)]) == [0, 5]  # type: ignore[arg-type]
    with pytest.raises(UserError, match=r"page 3 of b\.parquet is damaged"):
        run(_named, [_Section(0), _Section(1)])  # type: ignore[arg-type]
    with pytest.raises(RunError, match="the job of file 1 found nothing: ZeroDivisionError"):
        run(_named, [_Section(0), _Section(2)])  # type: ignore[arg-type]
    assert not (tmp_path / "jobs").exists()
