"""Run inside namespaces of its own: a Ray cluster of two nodes, a sweep on it, and one node dies in mid-sweep."""

from __future__ import annotations

import os
import secrets
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

SITE, HERE = Path(sys.argv[1]), Path(__file__).parent
sys.path.insert(0, str(HERE))
from launching import ROOT, SHORT, begin, until  # noqa: E402

HOST = "127.0.0.1"
ADDRESS = f"{HOST}:6379"


def node(*words: str) -> subprocess.Popen[Any]:
    """Start a node of one core, which stays in the foreground."""
    command = [str(ROOT / "launch/ray.sh"), *words, "--block", "--num-cpus=1"]
    return subprocess.Popen(command, cwd=SITE, stdout=(SITE / "ray.log").open("a"), stderr=subprocess.STDOUT)


def raylets() -> list[int]:
    """Process ids of the nodes."""
    names = {int(path.parent.name): path.read_text() for path in Path("/proc").glob("[0-9]*/comm")}
    return sorted(pid for pid, name in names.items() if name.strip() == "raylet")


def node_of(worker: int) -> int:
    """The raylet that a worker belongs to: its parent."""
    return int(Path(f"/proc/{worker}/stat").read_text().rpartition(")")[2].split()[1])


subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
with tempfile.TemporaryDirectory(prefix="ray") as folder:  # a short path: Ray puts sockets there
    os.environ |= {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(16)}
    os.environ["PATH"] = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    node("head", HOST, f"--temp-dir={folder}")
    until(lambda: len(raylets()) == 1)
    (head,) = raylets()
    node("join", HOST, f"--node-ip-address={HOST}")
    until(lambda: len(raylets()) == 2)
    (SITE / "wait").touch()
    launcher = ("hydra/launcher=ray", f"hydra.launcher.ray.init.address={ADDRESS}")
    command = begin(SITE, "train", "-m", "feedback=waiting", "seed=0,1,2,3", *launcher, *SHORT)
    begun = until(lambda: len(found := list(SITE.glob("begun-*"))) == 2 and found)
    workers = {node_of(pid): pid for pid in (int(path.name.partition("-")[2]) for path in begun)}
    (other,) = workers.keys() - {head}
    for pid in (other, workers[other]):
        os.kill(pid, signal.SIGKILL)
    (SITE / "wait").unlink()
    out, err = command.communicate(timeout=200)
    print(out, err)
    sys.exit(command.returncode)
