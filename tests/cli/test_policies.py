"""`credit evaluate` and `credit play`: what they print, and what they refuse."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import credit as library
from tests.runs.test_evaluate import CART

RUN = "outputs/advertiser/reference/trainer.steps=140"


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A working folder with finished runs."""
    folder = tmp_path_factory.mktemp("project")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        library.run(["method=reference", "trainer.steps=140", "replicas=2", "tracking=none"])
        library.run(
            [*CART, "replicas=1", "tracking=none", "agent.updates=1", "env.evaluation_episodes=1", "output=other"]
        )
    return folder


@pytest.fixture
def run(project: Path, credit: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    monkeypatch.chdir(project)
    return credit


def cart() -> str:
    (folder,) = Path("other/CartPole-v1/delayed").iterdir()
    return str(folder)


def test_evaluate_prints_a_row_a_run(run: Callable[..., Any]) -> None:
    found = run("evaluate", RUN, f"{RUN}/seed-0")
    assert (found.code, found.err) == (0, "")
    assert RUN in found.out
    assert "each judged exactly" in found.out
    assert found.out.count(RUN) == 1  # of two seeds, of which one was named twice
    assert "of one seed, exactly" in run("evaluate", f"{RUN}/seed-0").out
    found = run("evaluate", f"{cart()}", "episodes=5", "env.max_steps=30")
    assert found.code == 0, found.err
    assert "episodes" in found.out
    assert "over its episodes; that says nothing of what another seed" in found.out


def test_play_prints_steps(run: Callable[..., Any]) -> None:
    found = run("play", RUN)
    assert found.code == 0, found.err
    lines = found.out.splitlines()
    assert lines[0] == f"{RUN}/seed-0"
    assert lines[2].split() == ["step", "state", "action", "reward"]
    assert lines[3].split()[0] == "0"
    assert lines[-1].startswith("episode 0: 7 steps, return ")


@pytest.mark.thorough
def test_play_films(run: Callable[..., Any]) -> None:
    pytest.importorskip("pygame")
    for video in ("film.mp4", "film.gif"):
        found = run("play", cart(), f"video={video}")
        assert found.code == 0, found.err
        assert Path(video).stat().st_size > 1000
        assert not list(Path().glob("*.part.*"))


@pytest.mark.thorough
def test_export_writes_a_file(run: Callable[..., Any]) -> None:
    pytest.importorskip("onnxscript")
    found = run("export", RUN, "kept.onnx")
    assert (found.code, found.out, found.err) == (0, "policy   kept.onnx\n", "")
    assert Path("kept.onnx").stat().st_size > 1000
    assert "FILE.onnx" in run("export", "--help").out


REFUSED = {
    "no folder": (("evaluate",), ["the folder of a run is needed"]),
    "a folder that is nowhere": (("evaluate", "outputs/none"), ["outputs/none: there is no such folder"]),
    "a folder without runs": (("play", "outputs"), ["no run lies here", RUN]),
    "no file": (("export", RUN), ["a run and a file are needed", RUN]),
    "a file of another kind": (("export", RUN, "kept.pt"), ["kept.pt", ".onnx"]),
    "a run that is nowhere to export": (
        ("export", "outputs/none", "kept.onnx"),
        ["outputs/none: there is no such folder"],
    ),
    "a word": (("play", RUN, "fast"), ["fast: there is no such folder"]),
    "an unknown key": (("evaluate", RUN, "episods=3"), ["episods", "'episodes'"]),
    "no episodes": (("evaluate", RUN, "episodes=0"), ["episodes=0", "1 or more"]),
    "another part": (("evaluate", RUN, "mixer.alpha=1"), ["mixer.alpha"]),
    "an unknown parameter": (("evaluate", RUN, "env.p_dwon=.1"), ["env.p_dwon", "'p_down'"]),
    "a value that cannot be read": (("evaluate", RUN, "env.p_down=[.1"), ["env.p_down=[.1", "cannot be read"]),
    "other spaces": (("evaluate", RUN, "env.states=6"), ["observations Discrete(10)", "Discrete(6)"]),
    "no such policy": (("play", RUN, "policy=best"), ["policy=best", "it has behaviour"]),
    "two folders": (("play", RUN, RUN), ["one folder is played, got 2"]),
    "no video": (("play", RUN, "video=a.avi"), ["video=a.avi", ".mp4 or .gif"]),
    "a video nowhere": (("play", RUN, "video=none/a.mp4"), ["there is no folder none"]),
    "no pictures": (("play", RUN, "video=a.mp4"), ["no pictures", "rgb_array"]),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_done_ends_with_a_message(name: str, run: Callable[..., Any]) -> None:
    words, said = REFUSED[name]
    found = run(*words)
    assert found.code == 2
    assert [part for part in said if part not in found.err] == []
    assert "Traceback" not in found.err
    assert found.out == ""
    assert not Path("a.mp4").exists()
