"""The numbers that the paper prints, for the column beside ours."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import yaml


@dataclass(frozen=True)
class PaperValues:
    """What the paper reports: where, from how many seeds, and {method: {metric: (mean, standard error)}}.

    `feedback` is the setting it is about, as the text that `credit.report.settings.read_feedback` gives.
    """

    source: str
    seeds: int
    feedback: str
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
    return PaperValues(data["source"], int(data["seeds"]), json.dumps(data["feedback"], sort_keys=True), methods)
