"""Loops: where they may be used, what they are given, and that Numba is asked for by nobody else."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import torch

from credit.core import compiled


def doubled(values: np.ndarray, times: int) -> float:
    """What a loop is: arrays changed in place, and a number."""
    for _ in range(times):
        for i in range(len(values)):
            values[i] *= 2
    return float(values.sum())


def test_a_loop_sees_tensors_as_arrays_of_the_same_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled, "kept", lambda function: function)
    values = torch.tensor([1.0, 2.0], dtype=torch.float64)
    assert compiled.Loop(doubled)(values, 2) == 12
    assert values.tolist() == [4, 8]


def test_a_loop_is_compiled_once(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(compiled, "kept", lambda function: asked.append(function) or function)
    loop = compiled.Loop(doubled)
    assert not asked
    for _ in range(3):
        loop(torch.ones(2), 1)
    assert asked == [doubled]


def test_compiled_or_not_is_the_same() -> None:
    values = torch.tensor([1.0, 2.0], dtype=torch.float64)
    assert compiled.Loop(doubled)(values, 2) == 12
    assert values.tolist() == [4, 8]


@pytest.mark.parametrize(("disabled", "expected"), [("0", True), ("1", False)])
def test_loops_can_be_switched_off(monkeypatch: pytest.MonkeyPatch, disabled: str, expected: bool) -> None:
    monkeypatch.setenv("NUMBA_DISABLE_JIT", disabled)
    assert compiled.usable(torch.zeros(1)) == expected
    assert not compiled.usable(torch.zeros(1, device="meta"))


@pytest.mark.thorough
def test_numba_is_not_imported_before_a_loop_is_called() -> None:
    code = "import sys, credit.recovery.models.linear, credit.planning.solve, credit.envs.exact.continuing\n"
    code += "assert 'numba' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
