"""Trackers are optional: without a package, credit runs, and says which extra has it where it is asked for."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WITHOUT = """
import sys
for name in ("mlflow", "tensorboard", "wandb"):
    sys.modules[name] = None
from credit.cli.main import main
sys.exit(main(sys.argv[1:]))
"""
SHORT = ["experiment=advertiser", "method=reference", "trainer.steps=14", "replicas=1"]


def without(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A command where no tracker is installed."""
    return subprocess.run([sys.executable, "-c", WITHOUT, *words], cwd=folder, capture_output=True, text=True)


def test_credit_is_imported_without_any_tracker() -> None:
    code = WITHOUT.partition("from credit")[0] + "import credit, credit.tracking, credit.cli.compare, credit.cli.sync\n"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.thorough
def test_a_run_needs_no_tracker(tmp_path: Path) -> None:
    done = without(tmp_path, "train", "tracking=none", *SHORT)
    assert done.returncode == 0, done.stderr
    assert list(tmp_path.glob("outputs/advertiser/reference/*/seed-0/DONE"))


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["mlflow", "tensorboard", "wandb"])
def test_a_tracker_that_is_not_there_is_named_with_its_extra(tmp_path: Path, kind: str) -> None:
    done = without(tmp_path, "train", f"tracking={kind}", *SHORT)
    assert done.returncode == 2
    assert f"pip install 'credit-rl[{kind}]'" in done.stderr
    assert "tracking=none" in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir()), "nothing was made"


def test_the_dashboard_says_so_too(tmp_path: Path) -> None:
    done = without(tmp_path, "dashboard")
    assert done.returncode == 2
    assert "credit-rl[mlflow]" in done.stderr
