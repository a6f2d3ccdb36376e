"""The law of the house: who may import whom. Imports inside functions and for type checkers count, too.

core  ◄  networks, planning, data  ◄  envs · recovery · rivals · agents · judges  ◄  trainer  ◄  runs  ◄  cli
         config, on core ◄ runs, cli        tracking, report: on run folders ◄ cli        bench, testing: all
         tuning: Optuna's studies, on runs ◄ cli        logged: on core, recovery and what is registered ◄ cli
         bridges, on core and encoders, for agents of other libraries        api: what commands do, from Python, on cli
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import credit

HOUSE = Path(credit.__file__).resolve().parent
CORE = {"core"}
TOOLS = {"networks", "planning", "data"}
COMPONENTS = {"envs", "recovery", "rivals", "agents", "judges"}
LOOP = CORE | TOOLS | COMPONENTS | {"trainer", "rounds"}
READERS = {"tracking", "report"}
EVERYBODYS = {"renamed"}  # a table of old names, which imports nothing
BELOW: dict[str, set[str]] = {  # room → the rooms that it may import, beside itself
    "core": set(),
    **dict.fromkeys(TOOLS, CORE),
    **dict.fromkeys(COMPONENTS, CORE | TOOLS),
    "rivals": CORE | TOOLS | {"recovery.models"},  # a rival may use a model of recovery's
    "rounds": CORE,
    "trainer": LOOP,
    # the recovery half alone, on tables of rows; a saved model may name what is registered, and nothing else
    "logged": CORE | {"recovery", "data", "config.classes"},
    "bridges": CORE | {"envs", "rivals"},  # for agents of other libraries: labels of environments, and rules
    "config": CORE,
    "runs": LOOP | {"config"},
    "tuning": CORE | {"config", "runs"},
    **dict.fromkeys(READERS, CORE | {"runs"}),
    "cli": LOOP | READERS | {"config", "logged", "runs", "tuning", "bench", "testing"},
    "bench": LOOP | READERS | {"config", "logged", "runs", "cli", ""},  # the last: `credit` itself
    "testing": LOOP | READERS | {"config", "runs", "cli"},
    "renamed": set(),
    "api": {"core", "config", "logged", "runs", "report", "cli"},  # what commands do, from Python
    "__main__": {"cli"},
    "": {
        "api",
        "logged",
        "runs",
        "envs.registration",
        "core",
    },  # credit/__init__.py
}
ONLY = {  # package → the rooms that know it
    "hydra": {"config", "cli"},
    "hydra_plugins": {"config", "cli"},
    "omegaconf": {"config", "cli"},
    "mlflow": {"tracking", "bench"},
    "tensorboard": {"tracking"},
    "wandb": {"tracking"},
    "mujoco": {"envs", "report", "bench"},
    "stable_baselines3": {"bridges", "bench"},
    "optuna": {"tuning"},
}
# What stands against the law today, each with its reason. A line whose import has gone must go, too.
KNOWN = {
    ("report.pointmaze.maps", "envs.pointmaze.maze"): "maps draw the walls of a maze",
    ("report.pointmaze.pictures", "envs.pointmaze.maze"): "pictures draw its walls",
    ("report.pointmaze.pictures", "envs.pointmaze.task"): "pictures show start and goal",
    ("report.pointmaze.render", "envs.pointmaze.maze"): "videos are filmed in it",
    ("report.pointmaze.render", "envs.pointmaze.physics"): "videos are filmed by its simulator",
    ("report.pointmaze.tracks", "envs.pointmaze.maze"): "tracks lie in its cells",
}
LIGHT = ("core", "networks", "planning", "data", "recovery", "rivals", "agents", "judges", "config.signatures")
HEAVY = ("hydra", "omegaconf", "mlflow", "tensorboard", "wandb", "mujoco", "gymnasium_robotics", "matplotlib", "pandas")


def modules() -> Iterator[tuple[str, Path]]:
    """Name, without `credit.`, and file of every module."""
    for path in sorted(HOUSE.rglob("*.py")):
        parts = path.relative_to(HOUSE).with_suffix("").parts
        yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts), path


def imported(path: Path, name: str) -> set[str]:
    """Full names of all that a module imports; `from a import b` is `a.b` where that is a module, and else `a`."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                package = (
                    ["credit", *name.split(".")] if path.name == "__init__.py" else ["credit", *name.split(".")][:-1]
                )
                base = ".".join([*package[: len(package) - node.level + 1], *filter(None, [node.module])])
            for alias in node.names:
                found.add(f"{base}.{alias.name}" if _is_module(f"{base}.{alias.name}") else base)
    return found


def _is_module(name: str) -> bool:
    path = HOUSE.parent.joinpath(*name.split("."))
    return name.startswith("credit.") and (path.with_suffix(".py").exists() or path.is_dir())


def room(name: str) -> str:
    """The room of a module, `recovery.models.linear` → `recovery`; a file at the top is a room of its own."""
    return name.partition(".")[0]


def may(name: str, other: str) -> bool:
    """Whether a module may import another one of credit's."""
    allowed = BELOW[room(name)] | EVERYBODYS
    return room(name) == room(other) or any(f"{other}.".startswith(f"{place}.") for place in allowed)


def against() -> set[tuple[str, str]]:
    """(module, what it imports) of every import against the law."""
    found = set()
    for name, path in modules():
        for other in imported(path, name):
            top, _, inside = other.partition(".")
            if top == "credit" and inside and not may(name, inside):
                found.add((name, inside))
            if other == "credit" and "" not in BELOW[room(name)]:
                found.add((name, ""))
            if room(name) not in ONLY.get(top, {room(name)}):
                found.add((name, top))
    return found


def test_the_rooms_are_those_of_the_law() -> None:
    assert {room(name) for name, _ in modules()} <= {*BELOW}
    assert {room(name) for name, _ in modules()} >= COMPONENTS | TOOLS


@pytest.mark.parametrize(
    ("name", "other", "allowed"),
    [
        ("agents.dqn", "core.seams", True),
        ("agents.dqn", "agents.sac", True),
        ("agents.dqn", "recovery.recovery", False),
        ("rivals.rrd", "recovery.models.neural", True),
        ("rivals.rrd", "recovery.mixers", False),
        ("core.store", "data.replay", False),
        ("trainer", "judges.exact", True),
        ("judges.exact", "trainer", False),
        ("config.schema", "core.errors", True),
        ("config.schema", "runs.job", False),
        ("", "envs.pointmaze.task", False),
        ("cli.list", "bench.sac", True),
    ],
)
def test_what_the_law_says(name: str, other: str, allowed: bool) -> None:
    assert may(name, other) == allowed


def test_imports_are_found_wherever_they_stand(tmp_path: Path) -> None:
    (tmp_path / "module.py").write_text(
        "import credit.core.errors as e, numpy\n"
        "from typing import TYPE_CHECKING\n"
        "from credit.envs import feedback\n"
        "from credit.core.errors import UserError\n"
        "if TYPE_CHECKING:\n    from . import mixers\n"
        "def late():\n    from ..judges.exact import Exact\n"
    )
    assert {"credit.core.errors", "credit.envs.feedback", "credit.recovery.mixers", "credit.judges.exact"} <= (
        imported(tmp_path / "module.py", "recovery.module")
    )


def test_no_import_stands_against_the_law() -> None:
    new = sorted(against() - {*KNOWN})
    assert not new, "; ".join(f"credit.{name} imports {other}" for name, other in new)


def test_what_is_known_to_stand_against_the_law_still_does() -> None:
    gone = sorted({*KNOWN} - against())
    assert not gone, f"mended, so remove it from KNOWN: {gone}"


WATCHED = """
import importlib, sys

asked = []

class Watch:
    def find_spec(self, name, path=None, target=None):
        if name in HEAVY:
            frame = sys._getframe(1)
            while "importlib" in frame.f_code.co_filename:
                frame = frame.f_back
            asked.append((name, frame.f_globals.get("__name__")))

sys.meta_path.insert(0, Watch())
for module in MODULES:
    importlib.import_module(module)
for name, module in asked:
    if name in sys.modules:  # some only look whether it is there
        print(f"{module} imports {name}")
"""


@pytest.mark.thorough
def test_who_fits_a_recovery_waits_for_neither_hydra_nor_mlflow_nor_mujoco() -> None:
    """The rooms of equations, all at once. TorchRL imports MuJoCo itself, to see whether it has a second simulator."""
    names = [f"credit.{name}" for name, _ in modules() if f"{name}.".startswith(tuple(f"{place}." for place in LIGHT))]
    assert len(names) > 50
    code = f"HEAVY, MODULES = {HEAVY!r}, {names!r}\n{WATCHED}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert [line for line in done.stdout.splitlines() if not line.startswith("torchrl.")] == []


@pytest.mark.thorough
def test_rooms_that_need_no_torchrl_do_without() -> None:
    rooms = ("core.", "planning.", "recovery.", "rivals.", "judges.")
    names = [f"credit.{name}" for name, _ in modules() if f"{name}.".startswith(rooms)]
    code = f"HEAVY, MODULES = {('torchrl', *HEAVY)!r}, {names!r}\n{WATCHED}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
