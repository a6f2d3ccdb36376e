"""Short videos of final policies; where they cannot be made, one line that says what to install."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from credit.report.comparison import Comparison
from credit.report.pointmaze.figures import methods
from credit.report.pointmaze.recognise import FILE
from credit.report.pointmaze.tracks import typical

PACKAGES = {
    "gymnasium_robotics": "gymnasium-robotics",
    "mujoco": "mujoco",
    "imageio": "imageio",
    "imageio_ffmpeg": "imageio-ffmpeg",
}
BACKENDS = ("egl", "osmesa")
LIMIT = 600  # seconds for all videos of a report


def make_videos(comparisons: Sequence[Comparison], folder: Path, seed: int | None) -> tuple[list[Path], str]:
    """Film the final policy of every method in a maze, `policy_<method>_seed-<n>.mp4`.

    A video that is newer than its run is kept; those of other seeds and methods are removed.

    Args:
        comparisons: one a setting. folder: where videos go.
        seed: film this seed; by default the one of median success.

    Returns:
        The videos that there are, and why some are not, in one line ("" if all are).

    Raises:
        UserError: a method has no such seed.
    """
    sources: dict[Path, Path] = {}
    for shown in methods(comparisons):
        run = typical(shown.group, shown.comparison, seed)
        if run is not None:
            sources[folder / f"{shown.file('policy')}_seed-{run['seed']}.mp4"] = Path(run["folder"]) / FILE
    for path in folder.glob("policy_*.mp4"):
        if path not in sources or path.stat().st_mtime < sources[path].stat().st_mtime:
            path.unlink()
    missing = {video: source for video, source in sources.items() if not video.exists()}
    problem = render(missing) if missing else ""
    for path in folder.glob("policy_*.part.mp4"):
        path.unlink()
    return [video for video in sources if video.exists()], f"No new videos: {problem}." if problem else ""


def render(sources: Mapping[Path, Path]) -> str:
    """Film in another process; returns what stood in the way.

    Args:
        sources: video → the arrays of a run's trajectories.
    """
    absent = [name for module, name in PACKAGES.items() if importlib.util.find_spec(module) is None]
    if absent:
        return f"they need `pip install {' '.join(absent)}`"
    jobs = json.dumps([[str(source), str(video)] for video, source in sources.items()])
    command = [sys.executable, "-m", "credit.report.pointmaze.render", jobs]
    asked = os.environ.get("MUJOCO_GL")
    for backend in [asked] if asked else BACKENDS:
        # PyOpenGL has to be told the same
        environment = {**os.environ, "MUJOCO_GL": backend, "PYOPENGL_PLATFORM": backend}
        try:
            done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=LIMIT)
        except subprocess.TimeoutExpired:
            return f"they took more than {LIMIT} s with MUJOCO_GL={backend}"
        if done.returncode == 0:
            return ""
        if "READY" in done.stdout:
            return (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1].rstrip(".")
    tried = " and ".join(f"MUJOCO_GL={backend}" for backend in ([asked] if asked else BACKENDS))
    return f"OpenGL is missing (tried {tried}): `apt install libegl1` or `apt install libosmesa6`"
