"""What stands at the top level starts what it says, and nothing advises to install somebody else's package."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from credit.cli.main import COMMANDS

ROOT = Path(__file__).resolve().parents[1]
SCRIPTS = sorted((ROOT / "launch").glob("*.py"))
TEXTS = [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("credit/**/*.py"), ROOT / "pyproject.toml"]


def test_there_is_a_script_for_every_command() -> None:
    assert {script.stem for script in SCRIPTS} == set(COMMANDS)


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_script_is_its_command(script: Path, tmp_path: Path) -> None:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, str(script), "--no-such-flag"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith(f"credit {script.stem}: ")
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("script", sorted((ROOT / "launch").glob("*.s*")), ids=lambda script: script.name)
def test_shell_files_are_well_formed(script: Path) -> None:
    subprocess.run(["bash", "-n", str(script)], check=True)


def test_nobody_is_told_to_install_another_credit() -> None:
    advice = re.compile(r"pip install\s+['\"]?credit(?!-rl)\b")
    assert [str(path) for path in TEXTS if advice.search(path.read_text(encoding="utf-8"))] == []


def test_the_environments_are_known_to_gymnasium_without_pytorch() -> None:
    code = (
        "import sys, credit, gymnasium\n"
        "assert 'torch' not in sys.modules\n"
        "assert {'credit/Advertiser-v0', 'credit/Sepsis-v0'} <= set(gymnasium.registry)\n"
        "env = gymnasium.make('credit/Sepsis-v0')\n"
        "print(env.reset(seed=0)[0])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_environments_are_found_by_the_name_of_their_module() -> None:
    code = "import gymnasium; print(gymnasium.make('credit.envs:credit/Advertiser-v0').reset(seed=0)[0])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
