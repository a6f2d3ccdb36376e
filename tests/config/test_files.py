"""YAML files of somebody's own that cannot be read: each is named, and hides no other."""

from __future__ import annotations

from pathlib import Path

import pytest

from credit.cli.main import main
from credit.config import registry
from credit.core.errors import UserError

BAD = {
    "utf16": ("_target_: x".encode("utf-16"), r"mine\.yaml: no UTF-8 \(byte 0xff at 0\)"),
    "binary": (bytes(range(256)), r"mine\.yaml: no UTF-8 \(byte 0x80 at 128\)"),
    "malformed": (b"a: [1", r"mine\.yaml.*line 1"),
    "tab": (b"a:\n\tb: 1", r"mine\.yaml.*line 2"),
    "twice": (b"a: 1\nb: {c: 1}\na: 2", r"mine\.yaml.*the key a is written twice, in lines 1 and 3\); mend it"),
    "alias": (b"a: *b", r"mine\.yaml.*undefined alias 'b'"),
    "python": (b"a: !!python/object/apply:os.system ['true']", r"mine\.yaml.*os\.system"),
    "empty": (b"# mine\n", r"mine\.yaml: it is empty; name a class in it: _target_: "),
    "list": (b"- 1", r"mine\.yaml: a mapping belongs here"),
    "number": (b"3", r"mine\.yaml: a mapping belongs here"),
}


@pytest.fixture(params=BAD)
def bad(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[str, str]:
    text, said = BAD[request.param]
    (tmp_path / "mixer").mkdir()
    (tmp_path / "mixer" / "mine.yaml").write_bytes(text)
    return str(tmp_path), said


def test_who_chooses_one_is_told_which_it_is(bad: tuple[str, str]) -> None:
    folder, said = bad
    with pytest.raises(UserError, match=said):
        registry.compose(["mixer=mine"], [folder])
    assert registry.compose(["mixer=best"], [folder])["mixer"]


def test_others_are_listed_beside_it(bad: tuple[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "mixer", "--config-dir", bad[0]]) == 0
    assert "relative_mse" in capsys.readouterr().out


def test_a_list_tells_a_key_that_is_written_twice(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mixer").mkdir()
    (tmp_path / "mixer" / "mine.yaml").write_bytes(BAD["twice"][0])
    assert main(["list", "mixer", "--config-dir", str(tmp_path)]) == 0
    assert "mixer=mine is skipped" in (said := capsys.readouterr().err)
    assert "the key a is written twice, in lines 1 and 3" in said


def test_an_experiment_that_cannot_be_read_hides_no_keys_of_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "mine.yaml").write_bytes(BAD["malformed"][0])
    assert main(["list", "bonus", "experiment", "--config-dir", str(tmp_path)]) == 0
    said = capsys.readouterr()
    assert "scale = 0.35" in said.out
    assert said.err.count("warning: ") == said.err.count("experiment=mine is skipped") == 1
