"""`make test-processors`: the numerical tests of `make test` under every other instruction set that there is.

PyTorch, MKL, OpenBLAS and NumPy choose their code by what the processor can, and round by what they chose. Each has a
switch of its own. To ask for what is not there is an illegal instruction, so only what the kernel lists is asked for.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

ASK = "import torch; print(torch.backends.cpu.get_cpu_capability().lower())"
ARGUMENTS = ("-n", "2", "--dist", "loadfile", "-m", "numerical and not slow and not thorough")


@dataclass(frozen=True)
class Level:
    """An instruction set: its name for PyTorch, the flags that it needs, and what MKL and OpenBLAS call it."""

    name: str
    needs: frozenset[str]
    mkl: str
    openblas: str
    beyond: tuple[str, ...]  # parts of the names that NumPy gives to what lies beyond

    def environment(self, extensions: Collection[str]) -> dict[str, str]:
        """The switches; `extensions` are those that NumPy found, and are turned off where they lie beyond."""
        switches = {"ATEN_CPU_CAPABILITY": self.name, "OPENBLAS_CORETYPE": self.openblas}
        if self.mkl:
            switches["MKL_ENABLE_INSTRUCTIONS"] = self.mkl
        off = [name for name in extensions if any(part in name for part in self.beyond)]
        return switches | ({"NPY_DISABLE_CPU_FEATURES": " ".join(off)} if off else {})


X86 = (
    Level("default", frozenset(), "SSE4_2", "Nehalem", ("V3", "AVX", "FMA", "V4")),
    Level("avx2", frozenset({"avx2", "fma"}), "AVX2", "Haswell", ("V4", "AVX512")),
    Level("avx512", frozenset({"avx512f", "avx512bw", "avx512dq", "avx512vl", "fma"}), "AVX512", "SkylakeX", ()),
)
ARM = (Level("default", frozenset(), "", "ARMV8", ("SVE",)),)


def others(machine: str, flags: Collection[str], native: str) -> list[Level]:
    """The levels that a processor has, without the one that PyTorch takes by itself.

    Args:
        machine: `platform.machine()`. flags: of the processor. native: what PyTorch takes, in lower case.
    """
    levels = ARM if machine.lower() in ("arm64", "aarch64") else X86
    return [level for level in levels if level.name != native and level.needs <= set(flags)]


def flags_of(cpuinfo: str) -> set[str]:
    """The flags in the text of /proc/cpuinfo."""
    lines = (line.partition(":") for line in cpuinfo.splitlines())
    return {flag for key, _, rest in lines if key.strip().lower() in ("flags", "features") for flag in rest.split()}


def main() -> int:
    """Run the tests once for every other level; the first exit code that is not zero."""
    import numpy as np

    cpuinfo = Path("/proc/cpuinfo")
    flags = flags_of(cpuinfo.read_text()) if cpuinfo.exists() else set()
    native = subprocess.check_output([sys.executable, "-c", ASK], text=True).strip()
    extensions = np.show_config(mode="dicts")["SIMD Extensions"].get("found", ())
    levels = others(platform.machine(), flags, native)
    print(f"PyTorch takes {native} here; again with: {', '.join(level.name for level in levels) or 'nothing else'}")
    for level in levels:
        switches = level.environment(extensions)
        print(" ".join(f"{name}={value!r}" for name, value in switches.items()), flush=True)
        environment = os.environ | switches
        taken = subprocess.check_output([sys.executable, "-c", ASK], env=environment, text=True).strip()
        if taken != level.name:
            print(f"PyTorch took {taken}, not {level.name}: these tests would show nothing")
            return 1
        if code := subprocess.call([sys.executable, "-m", "pytest", *ARGUMENTS, *sys.argv[1:]], env=environment):
            return code
    return 0


if __name__ == "__main__":
    sys.exit(main())
