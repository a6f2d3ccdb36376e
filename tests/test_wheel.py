"""A wheel works outside the checkout: the YAML files are inside it."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def test_the_wheel_trains_outside_the_checkout(tmp_path):
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(tmp_path), str(ROOT)]
    subprocess.run(command, check=True, capture_output=True)
    with zipfile.ZipFile(next(tmp_path.glob("*.whl"))) as wheel:
        wheel.extractall(tmp_path / "site")
    assert (tmp_path / "site/credit/conf/config.yaml").exists()
    code = (
        "import credit, sys; from credit.cli.main import main; assert 'site' in credit.__file__; "
        "sys.exit(main(['train', 'method=random', 'replicas=1', 'trainer.steps=70', 'tracking=none']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"PYTHONPATH": str(tmp_path / "site")},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "outputs/advertiser/random/trainer.steps=70/seed-0/DONE").exists()
