"""`pytest --credit=PACKAGE`: a test for every component that a package announces, and no cost where nobody asks."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import credit
from credit.cli.main import main
from credit.testing import plugin

ROOT = Path(credit.__file__).resolve().parents[1]
LOOK = """
import sys

def pytest_sessionfinish(session):
    print("heavy:", sorted({"torch", "numpy", "hydra", "yaml"} & {*sys.modules}))
"""


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join(map(str, (folder, folder / "site", ROOT)))
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-p", "credit.testing.plugin", "-v", *words]
    environment = os.environ | {"PYTHONPATH": path, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package with a mixer that is right and a scaler that is not, as `pip install -e` leaves it."""
    for kind in ("mixer", "scaler"):
        assert main(["new", kind, f"my_{kind}", "--into", str(tmp_path)]) == 0
    facts = tmp_path / "site" / "my_mixer-0.1.dist-info"
    facts.mkdir(parents=True)
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: my_mixer\nVersion: 0.1\n")
    (facts / "entry_points.txt").write_text("[credit.components]\nmy_mixer = my_mixer\n")
    file = tmp_path / "my_mixer" / "my_scaler.py"
    file.write_text(file.read_text(encoding="utf-8").replace("return rewards / unit", "return -rewards / unit"))
    return tmp_path


@pytest.mark.slow
def test_every_component_of_a_package_is_tested(package: Path) -> None:
    done = run(package, "--credit=my_mixer", "--ignore=tests")
    assert done.returncode == 1, done.stdout
    assert "component[mixer/my_mixer] PASSED" in done.stdout
    assert "component[scaler/my_scaler] FAILED" in done.stdout
    assert "scaler/my_scaler in experiment=" in done.stdout
    assert "two steps changed their order" in done.stdout
    assert "Traceback" not in done.stdout
    assert "1 failed, 1 passed" in done.stdout


@pytest.mark.slow
def test_components_can_be_chosen_by_name(package: Path) -> None:
    done = run(package, "--credit=my_mixer", "--ignore=tests", "-k", "my_mixer]")
    assert "1 passed, 1 deselected" in done.stdout, done.stdout


def test_it_costs_nothing_where_nobody_asks(tmp_path: Path) -> None:
    (tmp_path / "look.py").write_text(LOOK)
    done = run(tmp_path, "-p", "look", "-s")
    assert "heavy: []" in done.stdout, done.stdout


def test_a_package_that_announces_nothing_is_refused() -> None:
    with pytest.raises(pytest.UsageError, match=r"--credit=nobody: nothing to test; .*'credit\.components'"):
        list(plugin.announced("nobody"))
