"""`credit recover` as a user types it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from credit.cli.main import main
from tests.logged.test_recovering import table

WORDS = ("data.window=w", "data.label=y", "data.time=t", "data.group=g", "data.actions=[x]", "data.states=[z]")
QUICK = ("draws=20", "tracking=none")


@pytest.fixture
def sales(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    table(groups=2).to_csv("sales.csv", index=False)
    return Path("sales.csv")


def recover(*words: str) -> int:
    return main(["recover", *words])


def test_a_folder_holds_what_was_found(sales: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert recover("sales.csv", *WORDS, *QUICK) == 0
    folder = Path("outputs/recover/sales")
    assert (folder / "DONE").exists()
    steps = pd.read_csv(folder / "steps.csv")
    assert len(steps) == 400
    assert {"credit", "credit_low", "credit_high", "credit_balanced", "disagreement", "weight_reference"} <= {*steps}
    assert len(pd.read_csv(folder / "windows.csv")) == 80
    assert json.loads((folder / "summary.json").read_text())["metrics"]["rows"] == 400
    assert "400 rows of 2 series" in (folder / "report.html").read_text(encoding="utf-8")
    shown = capsys.readouterr().out
    for words in ("400 rows, 80 windows", "what actions were worth", "held-out R² of mixture", str(folder)):
        assert words in shown


def test_parquet_gives_parquet_and_the_same(sales: Path) -> None:
    pd.read_csv(sales).to_parquet("sales.parquet")
    assert recover("sales.parquet", *WORDS, *QUICK, "name=again") == 0
    assert recover("sales.csv", *WORDS, *QUICK) == 0
    one = pd.read_parquet("outputs/recover/again/steps.parquet")
    pd.testing.assert_frame_equal(one, pd.read_csv("outputs/recover/sales/steps.csv"), check_dtype=False)


def test_explain_fits_and_writes_nothing(sales: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert recover("sales.csv", "--explain") == 0
    assert "nothing was fitted" in " ".join(capsys.readouterr().out.split())
    assert not Path("outputs").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "5 contiguous folds with a gap as long as residuals hang together"),
        (("gap=3", "folds=4"), "4 contiguous folds with a gap of 3 windows"),
        (("mixer=best", "surrogates={}"), "mixer has no effect: there is one model"),
    ],
)
def test_what_will_be_done_is_explained(
    sales: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], said: str
) -> None:
    assert recover("sales.csv", *WORDS, *words, "--explain") == 0
    assert said in " ".join(capsys.readouterr().out.split())


def test_a_folder_and_a_pattern_of_csv_give_csv_under_their_own_name(sales: Path) -> None:
    Path("shop/deep").mkdir(parents=True)
    sales.rename("shop/deep/part-1.csv")
    for data, name in (("shop", "shop"), ("shop/*/*.csv", "shop"), ("shop/**/part-*.csv", "part")):
        assert recover(data, *WORDS, *QUICK, "surrogates={}") == 0
        assert (Path("outputs/recover") / name / "steps.csv").exists()


def test_several_values_are_several_recoveries(sales: Path) -> None:
    several = ("mixer=best,relative_mse", "reference.formula=1 + x,1 + x + z")
    assert recover("sales.csv", "-m", *WORDS, *QUICK, *several) == 0
    folders = sorted(path.name for path in Path("outputs/recover/sales-sweep").iterdir())
    assert len(folders) == 4
    assert folders[0].startswith("00-mixer=best")


def test_keys_may_stand_in_a_file_and_the_command_line_counts_more(sales: Path) -> None:
    Path("how.yaml").write_text("draws: 15\nreference: {formula: 1 + x}\nsurrogates: {z: 1 + z}\n")
    assert recover("sales.csv", *WORDS, "tracking=none", "from=how.yaml", "surrogates.z.formula=1 + x + z") == 0
    assert {"weight_reference", "weight_z"} <= {*pd.read_csv("outputs/recover/sales/steps.csv")}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "one table is needed"),
        (("none.csv",), "none.csv"),
        (("sales.csv", "drws=3"), "did you mean 'draws'"),
        (("sales.csv", "draws=0"), "draws=0"),
        (("sales.csv", "draws=3", "draws=4"), "given twice"),
        (("sales.csv", "data.window=wek"), "no such column"),
        (("sales.csv", "data.widow=w"), "did you mean 'window'"),
        (("sales.csv", "mixer=bst"), "did you mean 'best'"),
        (("sales.csv", "mixer=best", "mixer.alpha=1"), "mixer.alpha"),
        (("sales.csv", "mixer=stacking"), "stacking"),
        (("sales.csv", "mixer=best,uniform"), "add -m"),
        (("sales.csv", "reference.formula=1 + (x"), "formula"),
        (
            ("sales.csv", "reference=dnnn"),
            "a registered reward model of that name (`credit list reward`): did you mean 'dnn'",
        ),
        (("sales.csv", "reference.formula=1 + open('x')"), "open"),
        (("sales.csv", "surrogates.a.formula=x.__class__"), "surrogates.a"),
        (("sales.csv", "format=xml"), "format=xml"),
        (("sales.csv", "-m", "reference.formula=1 + x,1 + q"), "q"),  # the second of two
        (("sales.csv", "residual=uniform", "rho=.5"), "rho has no effect"),
        (("sales.csv", "mixer=own", "--config-dir=none"), "no such folder"),
        (("sales.csv", "name=../x"), "no name"),
        (("sales.csv", "--explian"), "did you mean '--explain'"),
        (("sales.csv", "from=none.yaml"), "no such file"),
    ],
)
def test_bad_input_is_refused_and_nothing_is_made(
    sales: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], said: str
) -> None:
    assert recover(*words) == 2
    assert said in capsys.readouterr().err
    assert not Path("outputs").exists()


def test_what_fails_half_way_leaves_nothing(sales: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frame = pd.read_csv(sales)
    frame.assign(y=frame["y"] - 100).to_csv("below.csv", index=False)
    assert recover("below.csv", *WORDS, *QUICK, "nonnegative=true") == 2
    assert "nonnegative" in capsys.readouterr().err
    assert not Path("outputs").exists()  # nor a folder around it


def test_a_column_may_have_any_name(sales: Path) -> None:
    frame = pd.read_csv(sales).rename(columns={"y": "net sales (k, 2024)", "w": "true"})
    frame.to_csv("odd.csv", index=False)
    words = ("data.label=net sales (k, 2024)", "data.window=true", *WORDS[2:])
    assert recover("odd.csv", *words, *QUICK) == 0


def test_mixers_of_several_folders_of_ones_own(sales: Path) -> None:
    for name in ("one", "two"):
        folder = Path(name) / "mixer"
        folder.mkdir(parents=True)
        (folder / f"{name}.yaml").write_text("_target_: credit.recovery.mixers.Best\n")
    own = ("--config-dir=one", "--config-dir", "two")
    assert recover("sales.csv", "-m", *WORDS, *QUICK, "mixer=one,two", *own) == 0


def test_a_folder_of_something_else_is_not_written_over(sales: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("outputs/recover/sales").mkdir(parents=True)
    Path("outputs/recover/sales/mine.txt").write_text("mine")
    assert recover("sales.csv", *WORDS, *QUICK) == 2
    assert Path("outputs/recover/sales/mine.txt").read_text() == "mine"


MODEL = ("--model", "outputs/recover/sales", "tracking=none")


@pytest.mark.parametrize("label", ["numbers", "bits"])
def test_rows_that_were_fitted_are_scored_as_they_were(
    sales: Path, capsys: pytest.CaptureFixture[str], label: str
) -> None:
    frame = pd.read_csv(sales)
    if label == "bits":
        frame.assign(y=(frame["y"] > frame["y"].median()).astype(int)).to_csv(sales, index=False)
    assert recover("sales.csv", *WORDS, *QUICK, "reference.formula=1 + adstock(x) + lag(z, 1) + bs(z, 4)") == 0
    capsys.readouterr()
    assert recover("sales.csv", *MODEL, "name=again") == 0
    shown = capsys.readouterr().out
    for words in ("reference, actions, fitted to sales.csv", "begin anew with the first row of each g", "R² of labels"):
        assert words in shown
    one, other = Path("outputs/recover/sales"), Path("outputs/recover/again")
    pd.testing.assert_frame_equal(
        pd.read_csv(one / "steps.csv"), pd.read_csv(other / "steps.csv"), rtol=1e-12, atol=1e-12
    )
    names = ["g", "w", "steps", "label", "predicted", "residual"]
    pd.testing.assert_frame_equal(pd.read_csv(one / "windows.csv")[names], pd.read_csv(other / "windows.csv")[names])
    held = ["DONE", "recover.yaml", "steps.csv", "summary.json", "windows.csv"]
    assert sorted(path.name for path in other.iterdir()) == held
    assert json.loads((other / "summary.json").read_text())["metrics"]["labelled"] == 80


def test_new_rows_need_neither_windows_nor_labels(sales: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert recover("sales.csv", *WORDS, *QUICK) == 0
    frame = pd.read_csv(sales)
    frame[["t", "g", "x", "z"]].to_parquet("new.parquet")
    assert recover("new.parquet", *MODEL, "--explain") == 0
    assert "nothing was scored" in capsys.readouterr().out
    assert not Path("outputs/recover/new").exists()
    assert recover("new.parquet", "--model=outputs/recover/sales/model", "tracking=none", "format=csv") == 0
    steps = pd.read_csv("outputs/recover/new/steps.csv")
    assert steps["credit_low"].notna().all()
    assert not Path("outputs/recover/new/windows.csv").exists()
    frame.rename(columns={"w": "week", "y": "sold"}).to_csv("named.csv", index=False)
    assert recover("named.csv", *MODEL, "data.window=week", "data.label=sold") == 0
    assert {"week", "residual", "told"} <= {*pd.read_csv("outputs/recover/named/windows.csv")}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("new.csv", "--model"), "--model needs a folder"),
        (("new.csv", "--model", "nowhere"), "nowhere: there is no model.json"),
        (("new.csv", *MODEL, "--model=other"), "--model is given twice"),
        (("new.csv", *MODEL, "draws=3"), "draws has no effect with --model"),
        (("new.csv", *MODEL, "mixer=best"), "mixer has no effect with --model"),
        (("new.csv", *MODEL, "reference.formula=1"), "reference has no effect with --model"),
        (("new.csv", *MODEL, "--config-dir=."), "--config-dir has no effect with --model"),
        (("new.csv", *MODEL, "data.actions=[x]"), "data.actions has no effect"),
        (("new.csv", *MODEL, "data.window=wek"), "no such column"),
        (("sales.csv", *MODEL), "a model lies there"),
        (("short.csv", *MODEL), "no column 'z', which the model needs"),
    ],
)
def test_what_does_not_go_with_a_model_is_refused(
    sales: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], said: str
) -> None:
    assert recover("sales.csv", *WORDS, "draws=2", "tracking=none", "surrogates={}") == 0
    frame = pd.read_csv(sales)
    frame.to_csv("new.csv", index=False)
    frame.drop(columns="z").to_csv("short.csv", index=False)
    assert recover(*words) == 2
    assert said in capsys.readouterr().err
    assert [path.name for path in Path("outputs/recover").iterdir()] == ["sales"]


@pytest.mark.thorough
def test_a_stranger_types_the_file_alone(tmp_path: Path) -> None:
    example = Path(__file__).parents[2] / "examples" / "marketing.csv"
    environment = os.environ | {"OMP_NUM_THREADS": "1", "COLUMNS": "80"}
    command = [sys.executable, "-m", "credit", "recover", str(example), "draws=20"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "adstock(tv, 0.8)" in done.stdout
    assert "Logged to MLflow" in done.stdout
    assert "credit dashboard`" in done.stdout  # the store of all runs, where the dashboard looks by itself
    assert list((tmp_path / "outputs").glob("mlflow*"))


def test_a_formula_that_fails_in_a_row_leaves_nothing(sales: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert recover("sales.csv", "tracking=none", "reference.formula=1 + log(x - 1000000)") == 2
    assert "a formula is to be a finite number in every row" in capsys.readouterr().err
    assert not Path("outputs").exists()


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [("t", "row", "time"), ("w", "credit", "window"), ("w", "steps", "window"), ("g", "weight_actions", "group")],
)
def test_columns_called_as_results_are_refused_before_the_fit(
    old: str, new: str, word: str, sales: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [one for one in WORDS if not one.startswith(f"data.{word}=")]
    pd.read_csv(sales).rename(columns={old: new}).to_csv("other.csv", index=False)
    for more in (["format=parquet", *QUICK], ["--explain"]):
        assert recover("other.csv", *words, f"data.{word}={new}", *more) == 2
        assert f"the column {new!r} (data.{word})" in capsys.readouterr().err
    assert recover(str(sales), *WORDS, *QUICK) == 0
    assert recover("other.csv", "--model", "outputs/recover/sales", f"data.{word}={new}", "name=new") == 2
    assert new in capsys.readouterr().err


def test_bits_and_a_gap_that_was_cut_are_said(sales: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frame = pd.read_csv(sales)
    frame.assign(y=(frame["y"] > frame["y"].median()).astype(int)).to_csv("bits.csv", index=False)
    assert recover("bits.csv", *WORDS, "--explain") == 0
    assert "y, 0 or 1, with the sum of a window's rows as log-odds" in " ".join(capsys.readouterr().out.split())
    assert recover("sales.csv", *WORDS, *QUICK, "gap=100") == 0
    assert ", and not of gap=100: more than a third of a fold" in " ".join(capsys.readouterr().out.split())
