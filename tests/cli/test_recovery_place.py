"""Where recoveries go: no result is lost to another one, and the folder says how to ask for the same again."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from credit.cli.main import main
from tests.logged.test_recovering import table

WORDS = ("data.window=w", "data.label=y", "data.time=t", "data.actions=[x]", "data.states=[z]", "tracking=none")
HERE = Path("outputs/recover")


@pytest.fixture
def sales(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name in ("sales.csv", "other/sales.csv"):
        Path(name).parent.mkdir(exist_ok=True)
        table(windows=20, seed=len(name)).to_csv(name, index=False)
    return Path("sales.csv")


def recover(data: str, *words: str) -> int:
    return main(["recover", data, *WORDS, *words])


def test_the_same_again_takes_its_place_and_another_one_does_not(
    sales: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for data, draws in (("sales.csv", 5), ("sales.csv", 5), ("other/sales.csv", 5), ("sales.csv", 6), ("sales.csv", 6)):
        assert recover(data, f"draws={draws}", "data.group=g") == 0
    assert sorted(path.name for path in HERE.iterdir()) == ["sales", "sales-2", "sales-3"]
    shown = capsys.readouterr().out
    assert "outputs/recover/sales holds another recovery; this one goes to outputs/recover/sales-3" in shown


def test_a_name_that_another_one_has_is_refused(sales: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert recover("sales.csv", "draws=5", "data.group=g", "name=mine") == 0
    assert recover("sales.csv", "draws=6", "data.group=g", "name=mine") == 2
    assert recover("sales.csv", "-m", "draws=6,7", "data.group=g", "name=mine") == 2
    assert capsys.readouterr().err.count("outputs/recover/mine holds another recovery") == 2
    assert [path.name for path in HERE.iterdir()] == ["mine"]


def test_a_sweep_lies_beside_the_recovery_of_its_table(sales: Path) -> None:
    assert recover("sales.csv", "draws=5", "data.group=g") == 0
    assert recover("sales.csv", "-m", "draws=5,6", "data.group=g") == 0
    assert recover("sales.csv", "draws=5", "data.group=g") == 0
    assert sorted(path.name for path in HERE.iterdir()) == ["sales", "sales-sweep"]
    assert sorted(path.name for path in (HERE / "sales-sweep").iterdir()) == ["00-draws=5", "01-draws=6"]


def test_the_folder_asks_for_the_same_again(sales: Path) -> None:
    assert recover("sales.csv", "draws=5", "data.group=g", "mixer=best", "reference.sign={x: positive}") == 0
    file = HERE / "sales" / "recover.yaml"
    text = file.read_text(encoding="utf-8")
    assert text.startswith(f"# credit recover {sales.absolute()} from=recover.yaml\n")
    keys = yaml.safe_load(text)
    assert keys["reference"] == {"formula": "1 + adstock(x) + z", "sign": {"x": "positive"}}
    assert keys["mixer"] == "best"
    before = (HERE / "sales" / "steps.csv").read_text(encoding="utf-8")
    assert main(["recover", "sales.csv", f"from={file}", "name=again", "tracking=none"]) == 0
    assert (HERE / "again" / "steps.csv").read_text(encoding="utf-8") == before
    assert yaml.safe_load((HERE / "again" / "recover.yaml").read_text(encoding="utf-8")) == keys


def test_ctrl_c_leaves_an_earlier_result(sales: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert recover("sales.csv", "draws=5", "data.group=g") == 0
    before = {path.name: path.stat().st_mtime_ns for path in (HERE / "sales").iterdir()}

    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("credit.logged.writing.Folder.write", stopped)
    assert recover("sales.csv", "draws=5", "data.group=g") not in (0, 2)
    assert {path.name: path.stat().st_mtime_ns for path in (HERE / "sales").iterdir()} == before
    assert {path.name for path in (HERE / "sales-stopped").iterdir()} == {"STOPPED", "model"}


@pytest.mark.parametrize("place", ["/proc/nowhere", "sales.csv"])
def test_a_place_where_nothing_can_be_written_is_refused(
    sales: Path, place: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert recover("sales.csv", "draws=5", "data.group=g", f"output={place}") == 2
    assert "nothing can be written there" in capsys.readouterr().err
