"""The law of the house: who may import whom, and who knows Hydra, MLflow and MuJoCo."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import credit

ROOT = Path(credit.__file__).parent
COMPONENTS = {"envs", "recovery", "rivals", "agents", "judges"}
LOW = {"core"}
MIDDLE = LOW | {"networks", "planning", "data"}
MAY = {  # room → the rooms that it may import; itself, always
    "core": set(),
    "networks": LOW,
    "planning": LOW,
    "data": LOW | {"networks"},
    **dict.fromkeys(COMPONENTS, MIDDLE),
    "trainer": MIDDLE | COMPONENTS,
    "config": LOW,
    "runs": MIDDLE | COMPONENTS | {"trainer", "config"},
    "tracking": LOW | {"runs"},
    "report": LOW | {"runs"},
    "cli": None,
    "bench": None,
    "testing": None,
    "renamed": set(),
}
MAY["rivals"] = MIDDLE | {"recovery"}
LIBRARIES = {  # library → the only rooms that know it
    "hydra": {"config", "cli"},
    "mlflow": {"tracking", "cli", "bench"},
    "mujoco": {"envs", "report"},
}
TORCHRL = {"agents", "data", "networks"}  # its import looks for MuJoCo
EXCEPTIONS = {  # what still stands against the law, and why; this list may only become shorter
    "config/registry.py → tracking": "the slot of tracking is named by its class, as a string",
    "report/pointmaze/maps.py → envs": "maps draw the geometry of a maze",
    "report/pointmaze/pictures.py → envs": "pictures draw its walls",
    "report/pointmaze/render.py → envs": "videos are rendered by its simulator",
    "report/pointmaze/tracks.py → envs": "tracks lie in its cells",
    "report/style.py → tracking": "figures and the dashboard have the same colours",
    "report/compare.py → tracking": "a comparison is put into MLflow beside the runs",
}


def imports(file: Path) -> Iterator[str]:
    """Dotted names that a file imports, wherever in it."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


EVERYBODYS = {"renamed"}  # a table of names that imports nothing


def room_of(file: Path) -> str:
    return file.relative_to(ROOT).parts[0].removesuffix(".py")


FILES = [file for file in sorted(ROOT.rglob("*.py")) if room_of(file) != "__init__"]


def violations() -> set[str]:
    found = set()
    for file in FILES:
        room, name = room_of(file), str(file.relative_to(ROOT))
        allowed = MAY[room]
        for imported in imports(file):
            parts = imported.split(".")
            if parts[0] == "credit" and len(parts) > 1 and (ROOT / parts[1]).with_suffix("") != ROOT:
                other = parts[1]
                known = (ROOT / other).is_dir() or (ROOT / f"{other}.py").is_file()
                if known and other != room and allowed is not None and other not in allowed | EVERYBODYS:
                    found.add(f"{name} → {other}")
            if parts[0] in LIBRARIES and room not in LIBRARIES[parts[0]]:
                found.add(f"{name} → {parts[0]}")
    return found


def test_nobody_imports_what_stands_above_or_beside() -> None:
    assert violations() == {name for name in EXCEPTIONS if name in violations()}


def test_every_exception_still_stands() -> None:
    text = (ROOT / "config" / "registry.py").read_text(encoding="utf-8")
    kept = {"config/registry.py → tracking"} if '"credit.tracking:' in text else set()
    assert set(EXCEPTIONS) == (violations() & set(EXCEPTIONS)) | kept


def test_every_room_has_its_law() -> None:
    assert {room_of(file) for file in FILES} <= MAY.keys()


@pytest.mark.parametrize("room", sorted(MIDDLE | COMPONENTS - {"envs"}))
def test_rooms_of_equations_are_light(room: str) -> None:
    """Who fits a recovery in a notebook waits for neither Hydra nor MLflow nor MuJoCo."""
    names = [f"credit.{'.'.join(f.relative_to(ROOT).with_suffix('').parts)}" for f in FILES if room_of(f) == room]
    names = [name.removesuffix(".__init__") for name in names]
    heavy = ["hydra", "omegaconf", "mlflow", "gymnasium_robotics", "matplotlib", "pandas"]
    heavy += [] if room in TORCHRL else ["mujoco"]
    code = f"import sys, importlib\nfor n in {names}: importlib.import_module(n)\n"
    code += f"print(sorted(set({heavy!r}) & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
