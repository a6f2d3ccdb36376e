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
    "twice": (b"a: 1\na: 2", r"duplicate key a.*mine\.yaml"),
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
