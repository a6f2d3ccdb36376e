"""Which instruction sets are tried again: never one that the processor lacks."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

AVX2 = {"sse4_2", "avx", "avx2", "fma"}
AVX512 = AVX2 | {"avx512f", "avx512bw", "avx512dq", "avx512vl"}


@pytest.fixture(scope="module")
def processors() -> ModuleType:
    spec = importlib.util.spec_from_file_location("processors", Path(__file__).with_name("processors.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["processors"] = module  # a dataclass looks its module up
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("machine", "flags", "native", "expected"),
    [
        ("x86_64", AVX512, "avx512", ["default", "avx2"]),
        ("x86_64", AVX512, "avx2", ["default", "avx512"]),
        ("x86_64", AVX512 - {"avx512dq"}, "avx2", ["default"]),  # Xeon Phi: not what PyTorch calls avx512
        ("AMD64", AVX2, "avx2", ["default"]),
        ("x86_64", {"sse4_2"}, "default", []),
        ("aarch64", {"asimd", "sve"}, "sve256", ["default"]),
        ("arm64", set(), "default", []),
    ],
)
def test_what_is_there_and_not_taken_anyway(
    processors: ModuleType, machine: str, flags: set[str], native: str, expected: list[str]
) -> None:
    assert [level.name for level in processors.others(machine, flags, native)] == expected


def test_switches_of_every_library(processors: ModuleType) -> None:
    default, avx2, avx512 = (level.environment(["X86_V3", "X86_V4", "AVX512_ICL"]) for level in processors.X86)
    assert default["NPY_DISABLE_CPU_FEATURES"] == "X86_V3 X86_V4 AVX512_ICL"
    assert avx2 == {
        "ATEN_CPU_CAPABILITY": "avx2",
        "MKL_ENABLE_INSTRUCTIONS": "AVX2",
        "OPENBLAS_CORETYPE": "Haswell",
        "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL",
    }
    assert "NPY_DISABLE_CPU_FEATURES" not in avx512
    assert processors.ARM[0].environment([]) == {"ATEN_CPU_CAPABILITY": "default", "OPENBLAS_CORETYPE": "ARMV8"}


def test_flags_of_a_processor(processors: ModuleType) -> None:
    assert processors.flags_of("model name\t: X\nflags\t\t: fpu avx2 fma\n\nflags\t\t: fpu\n") == {"fpu", "avx2", "fma"}
    assert processors.flags_of("Features\t: fp asimd sve\nCPU part\t: 0xd40\n") == {"fp", "asimd", "sve"}
