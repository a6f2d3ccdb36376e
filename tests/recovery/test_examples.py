"""The examples of recovery run as they stand, and find the reward behind their labels."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


def run(name: str) -> dict[str, float]:
    made: dict[str, Any] = runpy.run_path(str(EXAMPLES / name))
    found: dict[str, float] = made["main"]()
    return found


def test_steps_are_recovered_from_episodes(capsys: pytest.CaptureFixture[str]) -> None:
    found = run("recover_steps.py")
    assert found["correlation"] > 0.85
    assert found["network"] + found["speed"] == pytest.approx(1, abs=1e-4)
    assert "correlation" in capsys.readouterr().out
