"""What stands in `launch/`: one thin script a command."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from credit.cli.main import COMMANDS

LAUNCH = Path(__file__).resolve().parents[2] / "launch"


def python(script: str, *words: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(LAUNCH / script), *words]
    environment = os.environ | {"PYTHONPATH": str(LAUNCH.parent)}
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)


def test_every_command_has_its_script() -> None:
    assert {path.stem for path in LAUNCH.glob("*.py")} == {*COMMANDS}


@pytest.mark.parametrize(
    "command", [pytest.param(name, marks=() if name == "train" else pytest.mark.thorough) for name in COMMANDS]
)
def test_a_script_is_its_command(command: str, tmp_path: Path) -> None:
    told = python(f"{command}.py", "--help", cwd=tmp_path)
    assert (told.returncode, told.stderr) == (0, "")
    assert "usage" in told.stdout.lower() or f"credit {command}" in told.stdout
    refused = python(f"{command}.py", "--colour=red", cwd=tmp_path)
    assert refused.returncode == 2
    assert refused.stderr.startswith(f"credit {command}: ")
    assert "--colour" in refused.stderr
    assert "Traceback" not in refused.stderr
    assert not list(tmp_path.iterdir())
