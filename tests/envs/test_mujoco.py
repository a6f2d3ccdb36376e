"""MuJoCo's warnings are said once, and leave no file in the user's folder."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

CODE = """
import mujoco
from credit.envs.gymnasium.making import make
from credit.envs.mujoco import warn_once
for _ in range(2):
    make("HalfCheetah-v5", {}, None, [])  # whose file says what this MuJoCo calls deprecated
mine = lambda message: None
mujoco.set_mju_user_warning(mine)
warn_once()
assert mujoco.get_mju_user_warning() is mine
"""


def test_warnings_are_said_once_and_not_written_down(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", CODE], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert [line.partition(":")[0] for line in done.stderr.splitlines()] == ["note     MuJoCo"]
    assert done.stdout == ""
    assert not list(tmp_path.iterdir())
