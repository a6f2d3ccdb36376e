"""The numbers that the paper prints, for the column beside ours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml


@dataclass(frozen=True)
class PaperValues:
    """What the paper reports: where, from how many seeds, and {method: {metric: (mean, standard error)}}.

    `setting` is what it is about, key → value as `credit.report.settings.values_of` has them; other keys are free.
    """

    source: str
    seeds: int
    setting: Mapping[str, Any]
    methods: Mapping[str, Mapping[str, tuple[float, float]]]


def load_paper(experiment: str) -> PaperValues | None:
    """The paper's numbers for an experiment, or None where it prints none."""
    path = Path(__file__).parent / "paper" / f"{experiment}.yaml"
    if not path.exists():
        return None
    data = yaml.safe_load(path.read_text(encoding="utf-8"))
    methods = {
        method: {metric: (float(mean), float(error)) for metric, (mean, error) in values.items()}
        for method, values in data["methods"].items()
    }
    return PaperValues(data["source"], int(data["seeds"]), data["setting"], methods)
