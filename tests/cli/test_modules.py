"""A module of one's own in the working folder: found by the command, by workers of a sweep, and by their workers."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from credit.cli.modules import findable

from .launching import ROOT

OWN = """
import gymnasium
import numpy as np


class Five(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(-1, 1, (2,), np.float64)
    action_space = gymnasium.spaces.Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return np.zeros(2), {}

    def step(self, action):
        return np.zeros(2), 5.0, False, False, {}


gymnasium.register("Five-v0", entry_point=Five, max_episode_steps=5)
"""
WORDS = ("env=gymnasium", "env.id=mine:Five-v0", "env.evaluation_episodes=1", "trainer.steps=20", "tracking=none")
SCRIPT = "import sys\nfrom credit.cli.main import main\nsys.exit(main())\n"


@pytest.fixture
def script(tmp_path: Path) -> list[str]:
    """The installed command, whose own folder comes first in its path, not the working folder."""
    file = tmp_path / "bin" / "credit"
    file.parent.mkdir()
    file.write_text(SCRIPT)
    return [sys.executable, str(file)]


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.thorough
def test_a_module_in_the_working_folder_is_found(tmp_path: Path, script: list[str]) -> None:
    folder = tmp_path / "work"
    folder.mkdir()
    (folder / "mine.py").write_text(OWN)
    done = run(folder, *script, "check", *WORDS, "method=random")
    assert done.returncode == 0, done.stderr
    (folder / "mine.py").unlink()
    gone = run(folder, *script, "check", *WORDS, "method=random")
    assert gone.returncode == 2
    assert "No module named 'mine'" in gone.stderr
    assert "found in the working folder" in gone.stderr


@pytest.mark.slow
def test_environments_step_in_workers_of_a_sweeps_workers(tmp_path: Path, script: list[str]) -> None:
    """Those of joblib's have a way of their own to start processes."""
    folder = tmp_path / "work"
    folder.mkdir()
    (folder / "mine.py").write_text(OWN)
    words = (*WORDS, "method=random", "seed=0,1", "replicas=1", "env.workers=2", "hydra/launcher=joblib")
    done = run(folder, *script, "train", "-m", *words)
    assert done.returncode == 0, done.stdout + done.stderr
    assert len([*folder.glob("outputs/*/random/*/seed-*/DONE")]) == 2


def test_what_is_installed_comes_before_the_working_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", ["/one", "/two"])
    with findable(tmp_path), findable(tmp_path):
        assert sys.path == ["/one", "/two", str(tmp_path)]
    assert sys.path == ["/one", "/two"]
