"""Frames as a video: mp4 or gif."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from credit.core.errors import UserError

SUFFIXES = (".mp4", ".gif")
PACKAGES = ("imageio", "imageio_ffmpeg")


def require(path: Path) -> None:
    """Refuse a video that could not be written.

    Raises:
        UserError: it is no mp4 or gif, its folder is not there, or packages are not.
    """
    if path.suffix not in SUFFIXES:
        raise UserError(f"video={path}: files of videos end in {' or '.join(SUFFIXES)}")
    if not path.parent.is_dir():
        raise UserError(f"video={path}: there is no folder {path.parent}; make it, or give another one")
    if any(importlib.util.find_spec(name) is None for name in PACKAGES):
        raise UserError(f"video={path}: videos need `pip install 'credit-rl[video]'`; without video=… there is a text")


def write_video(path: Path, frames: Iterable[NDArray[np.uint8]], fps: float) -> None:
    """Write frames [height, width, 3], all or nothing.

    Args:
        path: an mp4 or a gif. frames: the pictures. fps: how many a second.
    """
    import imageio.v2 as imageio

    part = path.with_suffix(f".part{path.suffix}")
    film = {"codec": "libx264", "quality": 6, "fps": fps, "macro_block_size": 2}
    options: dict[str, Any] = film if path.suffix == ".mp4" else {"duration": 1000 / fps, "loop": 0}
    writer: Any  # its type knows no append_data
    with imageio.get_writer(part, **options) as writer:
        for frame in frames:
            writer.append_data(frame)
    part.replace(path)
