"""Runs of every experiment that are killed twenty times come out as if nothing had happened."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

import credit
from credit.bench import reliability

SHORT = ["experiment=advertiser", "method=reference", "trainer.steps=280", "tracking=none", "replicas=1"]


@pytest.mark.slow
@pytest.mark.parametrize("overrides", reliability.RUNS.values(), ids=reliability.RUNS.keys())
def test_a_run_that_is_killed_at_any_moment(tmp_path: Path, overrides: Sequence[str]) -> None:
    found = reliability.killed(overrides, tmp_path, reliability.KILLS)
    assert found.different == []
    assert found.kills >= reliability.KILLS
    assert found.writing > 0


def test_a_difference_is_noticed(tmp_path: Path) -> None:
    first, second = (tmp_path / name for name in ("first", "second"))
    for folder in (first, second):
        credit.run([*SHORT, f"output={folder}"])
    assert reliability.different(first, second) == []  # though the times differ
    (run,) = second.glob("*/*/*/seed-0")
    for name, spoil in (
        ("metrics.csv", lambda data: data.replace(b"280", b"281", 1)),
        ("recovery.npz", None),
        ("DONE", None),
    ):
        file, before = run / name, (run / name).read_bytes()
        file.write_bytes(spoil(before)) if spoil else file.unlink()
        assert [Path(path).name for path in reliability.different(first, second)] == [name]
        file.write_bytes(before)
