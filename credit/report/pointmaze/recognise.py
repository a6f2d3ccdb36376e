"""What is a maze: an environment of this name, or one whose runs keep a maze; names of metrics do not tell."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import pandas as pd

ENVIRONMENT = "point_maze"  # as `credit.report.settings` spells the class
FILE = "trajectories.npz"
_ARRAY = "maze/walls.npy"


def is_maze(frame: pd.DataFrame) -> bool:
    """Whether runs are of a maze.

    Args:
        frame: rows of `Runs.frame` of one setting.
    """
    return json.loads(frame["setting"].iloc[0])["env"] == ENVIRONMENT or any(map(_keeps_maze, frame["folder"]))


def _keeps_maze(folder: str) -> bool:
    try:
        with zipfile.ZipFile(Path(folder) / FILE) as file:
            return _ARRAY in file.namelist()
    except (OSError, zipfile.BadZipFile):  # another environment's file of this name is its own affair
        return False
