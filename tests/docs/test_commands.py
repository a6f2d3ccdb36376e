"""Commands of the pages: what stands behind `<!-- run -->` is run, and prints what the page shows, but for numbers.

`<!-- run: slow -->` and `<!-- run: thorough -->` are marks of pytest; `, exit 2` says how the commands end. The blocks
of a page with one mark run one after the other, in one folder.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"^<!-- run(?:: (slow|thorough))?(?:, exit (\d))? -->\n```(console|python)\n(.*?)^```$", re.M | re.S)
NUMBER = re.compile(r"[+−-]?\d[\d.,]*")


class Block(NamedTuple):
    """Commands, and what they print."""

    mark: str
    code: int
    language: str
    text: str


def blocks(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    found = [Block(mark, int(code or 0), *rest) for mark, code, *rest in BLOCK.findall(text)]
    assert len(found) == text.count("<!-- run"), f"{page.name}: a block that is to run is none"
    return found


GROUPS = [
    pytest.param(page, mark, id=f"{page.stem}-{mark or 'fast'}", marks=[getattr(pytest.mark, mark)] if mark else [])
    for page in PAGES
    for mark in sorted({block.mark for block in blocks(page)})
]


def normal(text: str) -> str:
    """Without numbers and widths."""
    return " ".join(re.sub(r"─+", "─", NUMBER.sub("#", text)).split())


def commands(text: str) -> list[tuple[str, list[str]]]:
    """Command → the lines that it prints, of `$ command` and lines below."""
    found: list[tuple[str, list[str]]] = []
    for line in text.splitlines():
        if line.startswith("$ "):
            found.append((line[2:], []))
        elif line.strip() not in ("", "…"):
            found[-1][1].append(line)
    return found


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """`credit` and `python` are this checkout's, whatever a command says of PYTHONPATH."""
    path = tmp_path / "bin"
    path.mkdir()
    for name, words in (("python", ""), ("credit", "-m credit.cli.main ")):
        file = path / name
        file.write_text(f'#!/bin/sh\nPYTHONPATH="{ROOT}:$PYTHONPATH" exec "{sys.executable}" {words}"$@"\n')
        file.chmod(0o755)
    kept = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "PYTHONPATH")}
    return kept | {"PATH": f"{path}:{os.environ['PATH']}", "OMP_NUM_THREADS": "1"}


@pytest.mark.parametrize(("page", "mark"), GROUPS)
def test_commands_of_a_page(page: Path, mark: str, tmp_path: Path, environment: dict[str, str]) -> None:
    folder = tmp_path / "work"
    folder.mkdir()
    (folder / "examples").symlink_to(ROOT / "examples")
    for block in blocks(page):
        if block.mark != mark:
            continue
        if block.language == "python":
            file = folder / "block.py"
            file.write_text(block.text, encoding="utf-8")
            said = [("python block.py", list[str]())]
        else:
            said = commands(block.text)
        for command, lines in said:
            done = subprocess.run(
                command, shell=True, cwd=folder, env=environment, capture_output=True, text=True, check=False
            )
            assert done.returncode == block.code, f"{command}\n{done.stdout}{done.stderr}"
            printed = normal(done.stdout + done.stderr)
            for line in lines:
                assert normal(line) in printed, f"{command}\ndoes not print\n{line}\nbut\n{done.stdout}{done.stderr}"


def test_every_page_of_commands_has_one_that_is_fast() -> None:
    assert any(not block.mark for page in PAGES for block in blocks(page))


@pytest.mark.parametrize(
    ("text", "other", "same"),
    [
        ("a  12.3 s\n", "a 4 s", True),
        ("[−6.3, +4.1]", "[1, 2]", True),
        ("────", "──", True),
        ("a 1", "b 1", False),
        ("0–4", "0 4", False),
    ],
)
def test_what_counts_as_the_same(text: str, other: str, same: bool) -> None:
    assert (normal(text) == normal(other)) == same
