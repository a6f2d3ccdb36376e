"""`credit new`: what it writes works at once, and what it cannot write it says."""

from __future__ import annotations

import ast
import importlib
import os
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml

import credit as package
from credit.cli.new import TRY
from credit.config import classes, files, kinds
from credit.testing import check

from .conftest import Ended

ROOT = Path(package.__file__).resolve().parents[1]
Credit = Callable[..., Ended]


def written(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_there_is_a_template_for_every_kind_that_runs() -> None:
    assert TRY.keys() == kinds.KINDS.keys() - {"tracking"}


@pytest.mark.parametrize("kind", sorted(TRY))
def test_it_writes_a_package(credit: Credit, folder: Path, kind: str) -> None:
    ended = credit("new", kind, "my_own")
    assert (ended.code, ended.err) == (0, "")
    assert written(folder) == [
        "my_own/my_own/__init__.py",
        f"my_own/my_own/conf/{kind}/my_own.yaml",
        "my_own/my_own/my_own.py",
        "my_own/pyproject.toml",
        "my_own/tests/test_my_own.py",
    ]
    for name in written(folder):
        assert name in ended.out
        text = (folder / name).read_text(encoding="utf-8")
        assert "$" not in text, name
        if name.endswith(".py"):
            (first, *_) = ast.parse(text).body
            assert isinstance(first, ast.Expr), f"{name} says nothing of itself"
    node = yaml.safe_load((folder / f"my_own/my_own/conf/{kind}/my_own.yaml").read_text(encoding="utf-8"))
    assert node["_target_"] == "my_own.my_own.MyOwn"
    project = tomllib.loads((folder / "my_own/pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["entry-points"] == {"credit.components": {"my_own": "my_own"}}
    for words in ("credit train", "my_own", "cd my_own", "pip install -e .", "pytest"):
        assert words in ended.out


@pytest.fixture
def announced(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder for a package, which this process takes for installed."""
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setattr(files, "package_dirs", lambda: tuple(folder.glob("*/conf")))
    monkeypatch.setattr(classes, "allowed_packages", lambda: frozenset({"credit", *os.listdir(folder)}))
    yield folder
    for name in [name for name in sys.modules if name.startswith("tried_")]:
        del sys.modules[name]


@pytest.mark.parametrize(
    "kind",
    [pytest.param(kind, marks=() if kind == "mixer" else pytest.mark.slow) for kind in sorted(TRY)],
)
def test_what_it_writes_keeps_all_promises(credit: Credit, announced: Path, kind: str) -> None:
    name = f"tried_{kind}"
    assert credit("new", kind, name, "--into", str(announced)).code == 0
    importlib.invalidate_caches()
    check(f"{kind}/{name}")  # as its own test does with the class
    words = shlex.split(TRY[kind].replace("$name", name))
    ended = credit("check", *words, "tracking=none")
    assert ended.code == 0, ended.err


@pytest.mark.slow
def test_what_it_writes_runs_from_outside(credit: Credit, folder: Path) -> None:
    """All kinds in one package: its tests as pytest finds them, and runs with some."""
    for kind in TRY:
        assert credit("new", kind, f"my_{kind}", "--into", "mine").code == 0
    facts = folder / "site" / "mine-0.1.dist-info"
    facts.mkdir(parents=True)
    module = next(iter(TRY)).join(("my_", ""))
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 0.1\n")
    (facts / "entry_points.txt").write_text(f"[credit.components]\n{module} = {module}\n")
    path = os.pathsep.join(map(str, (folder / "mine", folder / "site", ROOT)))

    def run(*words: str) -> None:
        done = subprocess.run(
            [sys.executable, "-m", *words],
            cwd=folder / "mine",
            env=os.environ | {"PYTHONPATH": path},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr

    run("pytest", "-p", "no:cacheprovider")
    for kind in ("env", "reward", "agent"):
        typed = shlex.split(TRY[kind].replace("$name", f"my_{kind}"))
        run("credit.cli.main", "train", *typed, "replicas=1", "trainer.steps=70", "tracking=none")


def test_a_second_component_goes_beside_the_first(credit: Credit, folder: Path) -> None:
    credit("new", "mixer", "first", "--into", "mine")
    before = {name: (folder / name).read_text(encoding="utf-8") for name in written(folder)}
    assert credit("new", "bonus", "second", "--into", "mine").code == 0
    assert sorted(set(written(folder)) - before.keys()) == [
        "mine/first/conf/bonus/second.yaml",
        "mine/first/second.py",
        "mine/tests/test_second.py",
    ]
    assert {name: (folder / name).read_text(encoding="utf-8") for name in before} == before
    assert "_target_: first.second.Second" in (folder / "mine/first/conf/bonus/second.yaml").read_text(encoding="utf-8")


BAD = {
    "no kind": (("mixers", "mine"), ["'mixers' is no kind", "did you mean 'mixer'?"]),
    "a kind without a template": (("tracking", "mine"), ["'tracking' is no kind", "valid: agent"]),
    "no name": (("mixer",), ["'mixer'", "a kind and a name", "usage: credit new"]),
    "a word too many": (("mixer", "mine", "more"), ["'mixer mine more'", "nothing else"]),
    "no identifier": (("mixer", "my-own"), ["'my-own' is no name", "small letters"]),
    "a word of Python": (("mixer", "lambda"), ["'lambda' is no name"]),
    "a large letter": (("mixer", "Mine"), ["'Mine' is no name"]),
    "a name that is registered": (("mixer", "best"), ["mixer=best is registered already", "best.yaml", "another name"]),
    "a module's name": (("mixer", "json"), ["'json'", "a module of this name"]),
    "no such option": (("mixer", "mine", "--in=x"), ["'--in=x' is no option here", "--into"]),
    "no folder": (("mixer", "mine", "--into"), ["--into needs a folder"]),
    "no kind at all": (("--into", "x"), ["a kind and a name", "usage: credit new"]),
}


@pytest.mark.parametrize(("words", "said"), BAD.values(), ids=BAD)
def test_bad_input(credit: Credit, folder: Path, words: tuple[str, ...], said: list[str]) -> None:
    ended = credit("new", *words)
    assert ended.code == 2
    assert ended.err.startswith("credit new: ")
    for piece in said:
        assert piece in ended.err
    assert written(folder) == []


def test_nothing_is_overwritten(credit: Credit, folder: Path) -> None:
    credit("new", "mixer", "mine")
    before = written(folder)
    (folder / "mine/mine/mine.py").write_text("mine")
    ended = credit("new", "mixer", "mine")
    assert ended.code == 2
    assert "there already; nothing was written" in ended.err
    assert written(folder) == before
    assert (folder / "mine/mine/mine.py").read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize(
    ("text", "said"), [("[project]\nname = 'a'\n", "announces nothing to credit"), ("[project", "no TOML")]
)
def test_a_folder_of_another_project_is_refused(credit: Credit, folder: Path, text: str, said: str) -> None:
    (folder / "pyproject.toml").write_text(text)
    ended = credit("new", "mixer", "mine", "--into", ".")
    assert ended.code == 2
    assert said in ended.err
    assert written(folder) == ["pyproject.toml"]


def test_help(credit: Credit) -> None:
    assert "credit new KIND NAME" in credit("--help").out
    told = credit("new", "--help").out
    assert all(f"  {kind} " in told for kind in TRY)
