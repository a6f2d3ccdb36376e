"""`credit play RUN`: one episode of a run's policy, as text or as a video."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from credit.cli.evaluate import split
from credit.cli.main import guarded
from credit.cli.words import Reader, whole
from credit.core.errors import UserError

if TYPE_CHECKING:
    from credit.runs.play import Played

HELP = """\
Let the kept policy of a finished run act, step by step.

Usage: credit play RUN [KEY=VALUE ...]

  RUN              the folder of a seed (…/seed-0), or of all seeds of a run: then the first
  episodes=N       how many                                                          (1)
  video=FILE       a video, .mp4 or .gif, where the environment can be looked at     (a text)
  env.KEY=VALUE    another parameter of the environment
  policy=NAME      another of a run's policies: greedy, averaged                     (behaviour)
  seed=N           of the random numbers                                             (0)

Examples:
  credit play outputs/advertiser/disagreement/default/seed-0
  credit play outputs/CartPole-v1/reference/default/seed-0 video=cartpole.mp4
"""
READERS: dict[str, Reader] = {
    "episodes": ("episodes", whole(1), "a whole number, 1 or more"),
    "video": ("video", Path, "a file, .mp4 or .gif"),
    "policy": ("policy", str, "the name of a policy, such as greedy"),
    "seed": ("seed", whole(0), "a whole number, 0 or more"),
}
SHOWN = 8  # numbers of a vector


def main(argv: list[str]) -> int:
    """Play, and print the steps or write the video."""
    if {"-h", "--help"} & set(argv):
        print(HELP, end="")
        return 0
    folders, changes, options = split(argv, READERS, "play")
    if len(folders) > 1:
        raise UserError(f"one folder is played, got {len(folders)}: {', '.join(map(str, folders))}")
    video: Path | None = options.pop("video", None)
    if video is not None:
        from credit.report.video import require

        require(video)
        if not os.environ.get("DISPLAY"):
            os.environ.setdefault("MUJOCO_GL", "egl")  # which MuJoCo reads once, when it is imported
            os.environ.setdefault("SDL_VIDEODRIVER", "dummy")  # pygame
    from credit.runs.play import play
    from credit.runs.threads import limited

    with limited(1):
        played = play(folders[0], changes=changes, frames=video is not None, **options)
    for line in told(played) if video is None else filmed(played, video):
        print(line)
    return 0


def told(played: Played) -> list[str]:
    """The episodes as text, a line a step."""
    lines = [f"{played.source}"]
    for episode, steps in played.steps.groupby("episode"):
        rows = [
            (str(row["step"]), shown(row["state"]), shown(row["action"]), f"{row['reward']:.4g}")
            for row in steps.to_dict("records")
        ]
        rows.insert(0, ("step", "state", "action", "reward"))
        widths = [max(len(row[column]) for row in rows) for column in range(4)]
        lines += [
            "",
            *("  ".join(f"{cell:<{w}}" for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows),
        ]
        lines.append(f"episode {episode}: {summed(steps)}")
    return lines


def filmed(played: Played, video: Path) -> list[str]:
    """The episodes as a video, and what they came to.

    Raises:
        UserError: the environment cannot be looked at.
    """
    if played.frames:
        from credit.report.video import write_video

        write_video(video, played.frames, played.fps)
    elif played.arrays:
        import numpy as np

        from credit.report.pointmaze.videos import render

        with tempfile.TemporaryDirectory() as folder:
            np.savez(Path(folder) / "played.npz", **played.arrays)  # type: ignore[arg-type]
            if problem := render({video.resolve(): Path(folder) / "played.npz"}):
                raise UserError(f"video={video}: {problem}; without video=… there is a text")
    else:
        raise UserError(
            f"video={video}: this environment has no pictures (one of Gymnasium needs the render mode rgb_array); "
            "without video=… there is a text"
        )
    episodes = played.steps.groupby("episode")
    return [*(f"episode {episode}: {summed(steps)}" for episode, steps in episodes), f"video    {video}"]


def summed(steps: Any) -> str:
    """What an episode came to."""
    success = f", success {str(bool(steps['success'].iloc[-1])).lower()}" if "success" in steps else ""
    return f"{len(steps)} steps, return {steps['reward'].sum():.4g}{success}"


def shown(value: Any) -> str:
    """A number, or the first numbers of a vector."""
    if not hasattr(value, "shape"):
        return f"{value}"
    flat = value.reshape(-1)
    return f"[{', '.join(f'{number:.3g}' for number in flat[:SHOWN])}{', …' if flat.size > SHOWN else ''}]"


if __name__ == "__main__":
    sys.exit(guarded("play", sys.argv[1:]))
