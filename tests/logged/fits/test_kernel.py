"""The compiled loop is compiled once for all processes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

CALL = """
import numpy as np
from credit.logged.fits.kernel import relative_mse_rows

relative_mse_rows(np.random.default_rng(0).normal(size=(2, 3, 5)), 1.0, 1e-8)
"""


@pytest.mark.thorough
def test_what_one_process_compiled_another_one_finds(tmp_path: Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "NUMBA_DISABLE_JIT": "0"}
    found = []
    for _ in range(2):
        subprocess.run([sys.executable, "-c", CALL], env=environment, check=True)
        found.append(sorted(path.name for path in tmp_path.rglob("*.nb*")))
    assert found[0]
    assert found[0] == found[1]
