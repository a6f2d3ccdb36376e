"""Someone else's package adds a surrogate: one feature map, one YAML file, an entry point."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import credit

ROOT = Path(credit.__file__).resolve().parents[1]
FEATURES = '''
from typing import ClassVar

import torch

from credit.core.seams import FeatureMap


class Parity(FeatureMap):
    """Even and odd states apart."""

    domain: ClassVar = "tabular"

    def start(self, problem):
        pass

    def __call__(self, steps):
        return torch.nn.functional.one_hot(steps.states % 2, 2).double()
'''
REWARD = """# Surrogate that tells even from odd states.
_target_: credit.recovery.models.linear.LinearModel
name: parity
features: {_target_: parity_surrogate.Parity}
regularization: 0.1
"""


@pytest.fixture
def site(tmp_path: Path) -> Path:
    package = tmp_path / "site" / "parity_surrogate"
    (package / "conf" / "reward").mkdir(parents=True)
    (package / "__init__.py").write_text(FEATURES)
    (package / "conf" / "reward" / "parity.yaml").write_text(REWARD)
    facts = tmp_path / "site" / "parity_surrogate-1.0.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: parity-surrogate\nVersion: 1.0\n")
    (facts / "entry_points.txt").write_text("[credit.components]\nparity = parity_surrogate\n")
    return tmp_path / "site"


def run(site: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": f"{site}{os.pathsep}{ROOT}"}
    command = [sys.executable, "-m", "credit.cli.main", *words]
    return subprocess.run(command, env=environment, cwd=site, capture_output=True, text=True, check=False)


@pytest.mark.slow  # the example of a surrogate of one's own is the same among the default tests
def test_it_is_listed_and_runs(site):
    assert "Surrogate that tells even from odd states" in run(site, "list", "reward").stdout
    words = ("train", "+reward@surrogates.parity=parity", "replicas=1", "trainer.steps=210", "tracking=none")
    done = run(site, *words)
    assert done.returncode == 0, done.stderr
    summary = json.loads(next((site / "outputs").rglob("seed-0/summary.json")).read_text())
    assert 0 <= summary["metrics"]["weight/parity"] <= 1


@pytest.mark.thorough
def test_a_package_that_did_not_announce_itself_is_refused(site):
    (site / "parity_surrogate-1.0.dist-info" / "entry_points.txt").unlink()
    done = run(site, "train", "--config-dir", "parity_surrogate/conf", "+reward@surrogates.parity=parity")
    assert done.returncode == 2
    assert "parity_surrogate.Parity" in done.stderr
    assert "entry point 'credit.components'" in done.stderr
