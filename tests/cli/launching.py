"""What the tests of launchers share: commands in processes of their own, and a package with parts that misbehave."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import credit

ROOT = Path(credit.__file__).resolve().parents[1]
SHORT = ("experiment=advertiser", "method=random", "trainer.steps=700", "replicas=1", "tracking=none")
PARTS = """
import os
import time
from pathlib import Path

from credit.envs.feedback import BlockSum


class Calm(BlockSum):
    pass


class Late(BlockSum):
    # behaves in its first windows, as many as are tried before a run

    def start(self, problem):
        super().start(problem)
        self._calls = 0

    def __call__(self, rewards):
        self._calls += 1
        if self._calls > 3:
            self.misbehave()
        return super().__call__(rewards)


class Failing(Late):
    def misbehave(self):
        raise ArithmeticError("no labels today")


class Waiting(Late):
    def misbehave(self):
        Path(f"begun-{os.getpid()}").touch()
        end = time.monotonic() + 1  # a round ends: that is where a run hears that it shall stop
        while Path("wait").exists() and time.monotonic() < end:
            time.sleep(0.02)


class Killed(Late):
    def misbehave(self):
        if Path("kill").exists():
            Path("kill").unlink()
            os.kill(os.getpid(), 9)
"""


def misbehaving(folder: Path) -> None:
    """Put a package into a folder, which announces itself.

    `feedback=failing` raises, `waiting` computes for as long as there is a file `wait`, and `killed` has its process
    killed, as one that takes too much memory is, and takes the file `kill` with it.
    """
    package = folder / "misbehaving"
    (package / "conf" / "feedback").mkdir(parents=True)
    (package / "__init__.py").write_text(PARTS)
    for name in ("Calm", "Failing", "Waiting", "Killed"):
        text = f"# Misbehaves.\n_target_: misbehaving.{name}\nwindow: 7  # steps\n"
        (package / "conf" / "feedback" / f"{name.lower()}.yaml").write_text(text)
    facts = folder / "misbehaving-1.0.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: misbehaving\nVersion: 1.0\n")
    (facts / "entry_points.txt").write_text("[credit.components]\nmisbehaving = misbehaving\n")


def environment(folder: Path, **more: str) -> dict[str, str]:
    """In which credit and the package are found, by workers too."""
    return os.environ | {"PYTHONPATH": f"{folder}{os.pathsep}{ROOT}", **more}


def command(*words: str) -> list[str]:
    return [sys.executable, "-m", "credit.cli.main", *words]


def run(folder: Path, *words: str, **more: str) -> subprocess.CompletedProcess[str]:
    env = environment(folder, **more)
    return subprocess.run(command(*words), env=env, cwd=folder, capture_output=True, text=True, check=False)


def begin(folder: Path, *words: str) -> subprocess.Popen[str]:
    """Start a command in a process group of its own, as a shell does."""
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command(*words), env=environment(folder), cwd=folder, start_new_session=True, **pipes)


def until(condition: Callable[[], Any], seconds: float = 60) -> Any:
    """Wait for a condition, and return what it said."""
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end, "it never happened"
        time.sleep(0.05)
    return found


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def kill_group(process: subprocess.Popen[str]) -> None:
    """End what is left of a command."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def session(folder: Path) -> Path:
    """The folder of the only session."""
    (found,) = (folder / "outputs/sessions").iterdir()
    return found


def done(folder: Path) -> int:
    """How many runs are done."""
    return len(list((folder / "outputs").rglob("DONE")))


def status(folder: Path) -> list[str]:
    """The statuses of the session and of its jobs, as their records have them."""
    files = [session(folder) / "session.json", *sorted(session(folder).glob("job-*.json"))]
    return [json.loads(file.read_text())["status"] for file in files]
