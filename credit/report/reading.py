"""What a run folder says of its run: one row of the table of runs, and its arrays."""

from __future__ import annotations

import json
import re
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from credit.core.errors import UserError
from credit.report.provenance import code_of
from credit.report.settings import read_setting
from credit.report.variants import joined, variant
from credit.runs.differing import chosen
from credit.runs.rows import unusable

_CUT = re.compile(r"-[0-9a-f]{8}$")  # how the name of a folder ends that does not say all


def whole_name(parent: Path) -> str:
    """The name of a folder of runs, of which a long one is cut: then what was typed, as the record of the job has it.

    Args:
        parent: what the folders of the seeds lie in.
    """
    if not _CUT.search(parent.name):
        return parent.name
    for file in sorted(parent.glob("seed-*/summary.json")):
        with suppress(OSError, ValueError, KeyError, TypeError, AttributeError):  # a record may be lost
            summary = json.loads(file.read_text(encoding="utf-8"))
            number = summary["job"].removeprefix(f"{summary['session']}-")
            record = parent.parents[2] / "sessions" / summary["session"] / f"job-{number}.json"
            words = chosen(json.loads(record.read_text(encoding="utf-8"))["overrides"])
            if words:  # a run that was gone on with by its folder alone has none
                return joined(words)
    return parent.name


def read_run(folder: Path, settings: dict[str, str], typed: str) -> dict[str, Any]:
    """The row of a finished run: what it is, and its final metrics.

    Args:
        folder: of the run.
        typed: its overrides, as `whole_name` has them.
        settings: what is known by configuration hash, since YAML is slow to read; is added to.

    Raises:
        UserError: its summary or its configuration is damaged.
    """
    name = "summary.json"
    try:
        summary = json.loads((folder / name).read_text(encoding="utf-8"))
        row = _row(summary, folder, typed)
        name = "config.yaml"
        if row["config_hash"] not in settings:
            settings[row["config_hash"]] = read_setting(folder)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise UserError(unusable(folder, name, error)) from error
    return row | {"setting": settings[row["config_hash"]]}


@contextmanager
def arrays(folder: str | Path, name: str) -> Iterator[Mapping[str, Any]]:
    """The arrays of a finished run by their names, read when they are asked for, and only inside the `with`.

    Args:
        folder: of the run. name: of the file, such as `recovery.npz`.

    Raises:
        UserError: the file is damaged, or has not what it is asked for.
    """
    try:
        with np.load(Path(folder) / name, allow_pickle=False) as data:
            yield data
    except (OSError, EOFError, ValueError, LookupError, TypeError, zipfile.BadZipFile, zlib.error) as error:
        raise UserError(unusable(Path(folder), name, error)) from error


def setting_of_unfinished(folder: Path) -> str:
    """The setting of a run without a summary; "" where its configuration cannot be read."""
    try:
        return read_setting(folder)
    except (OSError, ValueError):
        return ""


def _row(summary: dict[str, Any], folder: Path, typed: str) -> dict[str, Any]:
    metrics = {name: np.nan if value is None else float(value) for name, value in summary["metrics"].items()}
    return {
        "method": summary["method"],
        "slug": variant(typed),
        "seed": int(summary["seed"]),
        "name": summary.get("paper", {}).get("name", summary["method"]),
        "folder": str(folder),
        "typed": typed,
        "config_hash": summary["config_hash"],
        **code_of(summary),
        **metrics,
    }
