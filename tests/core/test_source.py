"""Signatures from source are those of the classes themselves."""

from __future__ import annotations

import importlib
import subprocess
import sys
from typing import Any

import pytest

from credit.config import files
from credit.core import signatures, source

TARGETS = sorted(
    {
        str(node["_target_"])
        for path in files.conf_dir().rglob("*.yaml")
        if str((node := files.read(path)).get("_target_", "")).startswith("credit.")
    }
)


def facts(found: dict[str, tuple[Any, Any]]) -> dict[str, tuple[Any, ...]]:
    """What a signature says, without the classes' identity."""
    return {
        name: (
            getattr(signatures.component_kind(hint), "__name__", None),
            signatures.takes_several(hint),
            signatures.describe(hint),
            default,
        )
        for name, (hint, default) in found.items()
    }


@pytest.mark.parametrize("target", TARGETS)
def test_the_source_says_what_the_class_says(target: str, monkeypatch: pytest.MonkeyPatch) -> None:
    module, _, name = target.rpartition(".")
    cls = getattr(importlib.import_module(module), name)
    monkeypatch.delitem(sys.modules, module)  # as if nobody had imported it
    read = source.signature(target)
    assert read is not None, "such a class would have to be imported to be listed"
    assert facts(read) == facts(signatures.signature(cls))


def test_nothing_is_imported_for_it() -> None:
    code = (
        "import sys; from credit.core import source; "
        f"assert all(source.signature(target) is not None for target in {TARGETS!r}); "
        "assert 'torch' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("target", ["numpy.ndarray", "credit.nowhere.Thing", "credit.envs.feedback.Nothing"])
def test_what_it_cannot_tell_is_left_to_the_import(target: str) -> None:
    assert source.signature(target) is None
