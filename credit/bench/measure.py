"""Clocks and memory for benchmarks: CPU seconds of this process, peak memory of a fresh one."""

from __future__ import annotations

import gc
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import torch


@dataclass(frozen=True)
class Row:
    """One line of the report: what was measured, the figure, what it should be, whether it is."""

    what: str
    figure: str
    target: str = ""
    met: bool | None = None


def cpu_seconds(work: Callable[[], object], repeat: int = 1) -> float:
    """CPU seconds of one call, the least of several: noise on a shared machine only ever adds."""
    best = float("inf")
    for _ in range(repeat):
        start = time.process_time()
        work()
        best = min(best, time.process_time() - start)
    return best


def peak_megabytes(code: str) -> float:
    """Peak resident memory of a fresh Python process that runs `code`, MiB."""
    report = "\nimport resource; print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
    done = subprocess.run([sys.executable, "-c", code + report], capture_output=True, text=True, check=True)
    return int(done.stdout.split()[-1]) / 1024


def tensor_megabytes() -> float:
    """Memory of all live tensors of this process, each storage once, MiB."""
    gc.collect()
    storages = [x.untyped_storage() for x in gc.get_objects() if type(x) is torch.Tensor]
    return sum({storage.data_ptr(): storage.nbytes() for storage in storages}.values()) / 2**20
