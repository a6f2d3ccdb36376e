"""What a run is called in MLflow, and its tags and parameters: pure functions of the journal's JSON files."""

from __future__ import annotations

import getpass
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from credit.core.naming import metric_name
from credit.runs.palette import COLOURS, tint

MAX_PARAM, MAX_TAG = 6000, 8000
COLOUR = "mlflow.runColor"
PARENT = "mlflow.parentRunId"


@dataclass(frozen=True)
class RunCard:
    """The face of one MLflow run: its name, when it started (epoch seconds), tags and flat parameters."""

    name: str
    started: float
    tags: dict[str, str]
    params: dict[str, str]


def flatten(config: Mapping[str, Any]) -> dict[str, str]:
    """A nested configuration as flat text: `{"env": {"size": 10}}` becomes `{"env.size": "10"}`."""
    return {metric_name(key): _cut(text, MAX_PARAM) for key, text in _leaves("", config)}


def _leaves(prefix: str, node: Any) -> Iterator[tuple[str, str]]:
    if isinstance(node, Mapping) and node:
        for key, value in node.items():
            yield from _leaves(f"{prefix}.{key}" if prefix else str(key), value)
    elif prefix:
        yield prefix, node if isinstance(node, str) else json.dumps(node)


def _cut(text: str, limit: int) -> str:
    return text if len(text) <= limit else f"{text[: limit - 3]}..."


def sweep_card(session: Mapping[str, Any]) -> RunCard:
    """The run of a whole `credit train -m` command."""
    tags = _common(session) | {"level": "sweep"}
    return RunCard(f"sweep {session['id']}", session["started"], _text(tags), {})


def job_card(session: Mapping[str, Any], job: Mapping[str, Any], parent: str | None) -> RunCard:
    """The run of one method with all its replicas."""
    seeds = job["seeds"]
    tags = _common(session) | _of_job(job, parent)
    span = f"{seeds[0]}..{seeds[-1]}" if len(seeds) > 1 else str(seeds[0])
    tags |= {"level": "job", "seeds": span}
    slug = "" if job["slug"] == "default" else f" {job['slug']}"
    return RunCard(f"{job['method']}{slug}", job["started"], _text(tags), flatten(job["config"]))


def seed_card(session: Mapping[str, Any], job: Mapping[str, Any], seed: int, parent: str | None) -> RunCard:
    """The run of one seed of a job."""
    tags = _common(session) | _of_job(job, parent)
    tags |= {"level": "seed", "seed": seed}
    tags |= {f"data.{name}": digests[str(seed)] for name, digests in job.get("data", {}).items()}
    if COLOUR in tags:
        tags[COLOUR] = tint(tags[COLOUR])
    return RunCard(f"seed-{seed}", job["started"], _text(tags), flatten({**job["config"], "seed": seed}))


def _common(session: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "session": session["id"],
        "host": session["host"],  # with the next two: whose a run is that says RUNNING
        "pid": session["pid"],
        "process_started": session["process_started"],
        "mlflow.user": _user(),
        "mlflow.source.name": session["command"],
        "mlflow.source.type": "LOCAL",
    }


def _user() -> str:
    """Who that is; a container may have a number that nobody gave a name."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return str(os.getuid())


def _of_job(job: Mapping[str, Any], parent: str | None) -> dict[str, Any]:
    tags = {
        "method": job["method"],
        "slug": job["slug"],
        "environment": job["env"],
        "job": job["number"],
        "config_hash": job["config_hash"],
        "git_commit": job["git_commit"],
        "mlflow.source.git.commit": job["git_commit"],
        PARENT: parent,
    }
    if job["slug"] == "default":  # variants of one method must not share a colour: MLflow chooses theirs
        tags[COLOUR] = COLOURS.get(job["method"])
    return {name: value for name, value in tags.items() if value is not None}


def _text(tags: Mapping[str, Any]) -> dict[str, str]:
    return {name: _cut(str(value), MAX_TAG) for name, value in tags.items()}
