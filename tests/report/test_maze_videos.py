"""Videos of final policies, and what is said where they cannot be made."""

import importlib.util
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from credit.cli.compare import main
from credit.report.comparison import Comparison, summarise
from credit.report.pointmaze import videos
from credit.report.pointmaze.videos import make_videos
from credit.report.runs import load_runs

from .mazes import journal, write_maze_run


@pytest.fixture
def comparison(tmp_path: Path) -> Comparison:
    for method in ("delayed", "reference"):
        write_maze_run(tmp_path / "outputs", method, 5, [0.5, 0.9], tracks=journal())
    return summarise(load_runs(tmp_path / "outputs", "pointmaze"))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    path = tmp_path / "report"
    path.mkdir()
    return path


def test_without_opengl_there_is_one_line(comparison: Comparison, folder: Path, monkeypatch: pytest.MonkeyPatch):
    for module in ("imageio_ffmpeg", "mujoco", "gymnasium_robotics"):
        pytest.importorskip(module)
    monkeypatch.setenv("MUJOCO_GL", "disable")
    made, remark = make_videos([comparison], folder, None)
    assert made == []
    assert remark == (
        "No new videos: OpenGL is missing (tried MUJOCO_GL=disable): `apt install libegl1` or `apt install libosmesa6`."
    )


@pytest.mark.parametrize("code", [1, -6])
def test_both_kinds_of_opengl_are_tried_and_may_abort(
    comparison: Comparison, folder: Path, monkeypatch: pytest.MonkeyPatch, code: int
):
    tried: list[str] = []

    def run(command: list[str], *, env: dict[str, str], **_: Any) -> subprocess.CompletedProcess[str]:
        tried.append(env["MUJOCO_GL"])
        return subprocess.CompletedProcess(command, code, "", "some traceback")

    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: True)
    monkeypatch.setattr(subprocess, "run", run)
    assert "libegl1" in make_videos([comparison], folder, None)[1]
    assert tried == ["egl", "osmesa"]


def test_what_goes_wrong_later_is_not_blamed_on_opengl(
    comparison: Comparison, folder: Path, monkeypatch: pytest.MonkeyPatch
):
    done = subprocess.CompletedProcess([], 1, "READY\n", "Traceback\nOSError: disk full.")
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: True)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: done)
    assert make_videos([comparison], folder, None) == ([], "No new videos: OSError: disk full.")


def test_missing_packages_are_named(
    comparison: Comparison, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "imageio_ffmpeg" else found("json"))
    monkeypatch.setattr("credit.report.compare._figures", lambda *_: {})
    words = [f"output={tmp_path / 'outputs'}", "experiment=pointmaze", "tracking=none"]
    assert main(words) == 0
    assert "No new videos: they need `pip install imageio-ffmpeg`." in capsys.readouterr().out
    assert main([*words, "videos=false"]) == 0
    assert "videos" not in capsys.readouterr().out


def test_only_new_videos_are_made(comparison: Comparison, folder: Path, monkeypatch: pytest.MonkeyPatch):
    asked: list[list[str]] = []

    def render(sources: dict[Path, Path]) -> str:
        asked.append([video.name for video in sources])
        for video in sources:
            video.touch()
        return ""

    monkeypatch.setattr(videos, "render", render)
    (folder / "policy_delayed_seed-9.mp4").touch()
    names = ["policy_delayed_seed-5.mp4", "policy_reference_seed-5.mp4"]
    for _ in range(2):
        made, remark = make_videos([comparison], folder, None)
        assert ([path.name for path in made], remark) == (names, "")
    assert sorted(path.name for path in folder.iterdir()) == names
    later = (folder / names[0]).stat().st_mtime + 10
    source = Path(comparison.runs.frame.loc[0, "folder"]) / "trajectories.npz"  # type: ignore[arg-type]
    os.utime(source, (later, later))
    make_videos([comparison], folder, None)
    assert asked == [names, names[:1]]


@pytest.mark.slow
def test_a_video_shows_the_ball_move(comparison: Comparison, folder: Path):
    for module in ("imageio_ffmpeg", "mujoco", "gymnasium_robotics"):
        pytest.importorskip(module)
    import imageio.v2 as imageio

    made, remark = make_videos([comparison], folder, None)
    if "OpenGL" in remark:
        pytest.skip(remark)
    assert (len(made), remark) == (2, "")
    assert all(path.stat().st_size < 2e6 for path in made)
    with imageio.get_reader(made[0]) as reader:
        frames = np.stack(list(reader.iter_data())).astype(float)
    lengths = journal()["evaluation/lengths"][:3]
    assert len(frames) == sum(-(-(length - 1) // 4) + 12 for length in lengths)
    assert frames.shape[1:] == (400, 400, 3)
    # the ball moves; the walls around it do not
    first = frames[: -(-(lengths[0] - 1) // 4)]
    assert np.abs(first[-1] - first[0]).max() > 60
    assert np.abs(first[:, 5] - first[0, 5]).max() < 12
