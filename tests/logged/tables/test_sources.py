from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from credit.core.errors import UserError
from credit.logged.tables import csvs
from credit.logged.tables.sources import located

TABLE = "a,b\n1,x\n2,y\n3,z\n"


def _latin(path: Path) -> None:
    path.write_bytes("a,b\n1,x\n2,Köln\n".encode("latin1"))


def _parquet(path: Path) -> None:
    pd.DataFrame({"a": range(1000)}).to_parquet(path)


def _truncated(path: Path) -> None:
    _parquet(path)
    path.write_bytes(path.read_bytes()[:-50])


BAD = {
    "nothing.csv": (lambda path: path.write_bytes(b""), r"is empty \(0 bytes\)"),
    "nothing.parquet": (lambda path: path.write_bytes(b""), r"is empty \(0 bytes\)"),
    "latin.csv": (_latin, r"not written in UTF-8: byte 11 \(line 3\) is 0xf6"),
    "utf16.csv": (
        lambda path: path.write_text(TABLE, encoding="utf-16"),
        r"is written in UTF-16 \(its first byte is 0xff",
    ),
    "excel.csv": (lambda path: path.write_bytes(b"PK\x03\x04rest"), r"ends in \.csv, but it is an Excel or ZIP file"),
    "parquet.csv": (_parquet, r"ends in \.csv, but it is Parquet"),
    "text.parquet": (lambda path: path.write_text(TABLE), r"ends in \.parquet, but it is text"),
    "broken.parquet": (
        _truncated,
        r"is a damaged Parquet file \(what a Parquet file says of itself at its end is missing",
    ),
    "ragged.csv": (lambda path: path.write_text(TABLE + "1,2,3\n"), r"cannot be read as a table"),
    "twice.csv": (lambda path: path.write_text("a,a\n1,2\n"), r"two columns are called 'a'"),
    "headless.csv": (lambda path: path.write_text("1,2\n3,4\n"), r"the first line holds numbers"),
    "names.csv": (lambda path: path.write_text("a,b\n"), r"there are no rows in it"),
    "blank.csv": (lambda path: path.write_text("\n\n"), r"nothing in it but blank lines"),
    "other.xlsx": (lambda path: path.write_text("x"), r"tables end in one of \.csv"),
}


@pytest.mark.parametrize("name", BAD)
def test_files_that_are_no_tables_are_named(name: str, tmp_path: Path) -> None:
    make, message = BAD[name]
    make(tmp_path / name)
    with pytest.raises(UserError, match=message):
        located(tmp_path / name)


@pytest.mark.parametrize("name", ["latin.csv", "ragged.csv"])
def test_large_files_are_told_the_same(name: str, tmp_path: Path) -> None:
    make, message = BAD[name]
    make(tmp_path / name)
    with pytest.raises(UserError, match=message):
        located(tmp_path / name, memory=1)


def test_of_a_folder_files_that_end_like_tables_are_read_and_others_are_named(tmp_path: Path) -> None:
    (tmp_path / "deep" / "deeper").mkdir(parents=True)
    (tmp_path / "deep" / "a.csv").write_text(TABLE)
    for name in ("deep/deeper/notes.txt", "readme.md", "b.txt", "c.log"):
        (tmp_path / name).write_text("some words\n")
    source = located(tmp_path)
    assert source.rows == 3
    assert source.said[-1].endswith("were skipped: b.txt, c.log, deep/deeper/notes.txt, and 1 more")
    (tmp_path / "deep" / "a.csv").unlink()
    with pytest.raises(UserError, match=r"text that is a table is given by its name, or by a pattern"):
        located(tmp_path)
    (tmp_path / "b.txt").write_text(TABLE)
    assert located(str(tmp_path / "b*.txt")).rows == 3


def test_a_file_that_is_not_there_has_a_neighbour(tmp_path: Path) -> None:
    (tmp_path / "weeks.csv").write_text(TABLE)
    with pytest.raises(UserError, match=r"there is no such file; did you mean 'weeks\.csv'"):
        located(str(tmp_path / "week.csv"))
    (tmp_path / "empty").mkdir()
    with pytest.raises(UserError, match="no file in this folder"):
        located(tmp_path / "empty")
    with pytest.raises(UserError, match=r"there is no such file; no table lies in .*empty"):
        located(tmp_path / "empty" / "week.csv")
    with pytest.raises(UserError, match=r"there is no folder .*nowhere; give the path of a table"):
        located(tmp_path / "nowhere" / "week.csv")


@pytest.mark.parametrize("memory", [2**20, 1])
def test_separators_and_decimals_are_found(memory: int, tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text("\ufeffa;b\n1,5;x\n2,25;y\n", encoding="utf-8")
    source = located(tmp_path / "x.csv", memory)
    assert source.columns == ("a", "b")
    assert source.whole(["a", "b"])[0].a.tolist() == [1.5, 2.25]
    assert source.said[0] == "columns are separated by ';', decimals by ','"


def test_types_of_large_files_widen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(csvs, "BLOCK", 64)
    lines = [f"{i},{i},{i}" for i in range(40)] + ["1.5,x,"] + ["2,3,4"]
    (tmp_path / "x.csv").write_text("a,b,c\n" + "\n".join(lines) + "\n")
    frame, rows = located(tmp_path / "x.csv", memory=1).whole(["a", "b", "c"])
    assert rows.tolist() == [*range(42)]
    assert frame.a.iloc[40] == 1.5
    assert frame.b.iloc[40] == "x"
    assert pd.isna(frame.c.iloc[40])


def test_files_of_a_table_are_alike(tmp_path: Path) -> None:
    pd.DataFrame({"a": [1, 2], "b": [1, 2]}).to_parquet(tmp_path / "0.parquet")
    pd.DataFrame({"a": [1.5, 2], "b": ["x", "y"]}).to_parquet(tmp_path / "1.parquet")
    with pytest.raises(UserError, match=r"b is int64 in 0\.parquet and .*string in 1\.parquet"):
        located(tmp_path)
    pd.DataFrame({"a": [1.5, 2]}).to_parquet(tmp_path / "1.parquet")
    with pytest.raises(UserError, match=r"1\.parquet: there is no column 'b'"):
        located([tmp_path / "0.parquet", tmp_path / "1.parquet"])
    pd.DataFrame({"b": [1.5, 2], "a": [1, 2]}).to_parquet(tmp_path / "1.parquet")
    assert located(tmp_path).whole(["b"])[0].b.tolist() == [1, 2, 1.5, 2]
    (tmp_path / "2.csv").write_text(TABLE)
    with pytest.raises(UserError, match="CSV and Parquet"):
        located(tmp_path)
