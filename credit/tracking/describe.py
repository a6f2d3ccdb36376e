"""What a run is called in a tracker, its tags, parameters, description: pure functions of the journal's JSON files."""

from __future__ import annotations

import getpass
import json
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Any

from credit.core.naming import metric_name, short_keys
from credit.runs import differing
from credit.runs.differing import parameters, typed
from credit.runs.palette import COLOURS, nth, tint

MAX_PARAM, MAX_TAG = 6000, 8000
MAX_ROWS = 60  # of a table in a description
MAX_NAME = 60  # letters of a sweep's
COLOUR = "mlflow.runColor"
PARENT = "mlflow.parentRunId"

Json = Mapping[str, Any]


@dataclass(frozen=True)
class RunCard:
    """The face of one run in a tracker: its name, when it started (epoch seconds), tags and flat parameters.

    `description` says what it is, in Markdown; `differing` has what tells a job from the others of its session;
    `job` is the name of its job, where it is a seed.
    """

    name: str
    started: float
    tags: dict[str, str]
    params: dict[str, str]
    description: str = ""
    differing: dict[str, Any] = field(default_factory=dict)
    job: str = ""


def shown_parameters(config: Json) -> dict[str, str]:
    """What a run is, as flat text: `{"env": {"_target_": …, "size": 10}}` becomes `env: advertiser`, `env.size: 10`."""
    return {metric_name(key): _cut(typed(value), MAX_PARAM) for key, value in parameters(config).items()}


def _cut(text: str, limit: int) -> str:
    return text if len(text) <= limit else f"{text[: limit - 3]}..."


def sweep_card(session: Json) -> RunCard:
    """The run of a whole `credit train -m` command."""
    tags = _common(session) | {"level": "sweep"}
    others = session.get("labels", [])
    keys = list(dict.fromkeys(key for label in others for key in label))
    rows = [[str(number), *(_cell(label.get(key)) for key in keys)] for number, label in enumerate(others)]
    told = _table(["job", *keys], rows) if rows else ""
    text = "\n\n".join(filter(None, [f"`{session['command']}`", told]))
    varied = ", ".join(short_keys(keys).values())
    name = _cut(f"sweep of {varied}", MAX_NAME) if varied else f"sweep {session['id']}"
    return RunCard(name, session["started"], _text(tags), {}, text)


def job_card(session: Json, job: Json, parent: str | None) -> RunCard:
    """The run of one method with all its replicas."""
    seeds, label = job["seeds"], _label(session, job)
    span = f"{seeds[0]}..{seeds[-1]}" if len(seeds) > 1 else str(seeds[0])
    tags = _common(session) | _of_job(session, job, parent) | {"level": "job", "seeds": span}
    tags |= {"metric": job["metric"]} if "metric" in job else {}
    tags |= {"differing": json.dumps([metric_name(key) for key in label])} if label else {}
    said = f"**{job.get('title', job['method'])}** on `{job['experiment']}`: the mean of {len(seeds)} seeds ({span})."
    rows = [[f"`{key}`", _cell(value)] for key, value in label.items()]
    where = f"In `{PurePath(job['folders'][0]).parent}`, by `{session['command']}`."
    text = "\n\n".join(filter(None, [said, _table(["", "what differs"], rows) if rows else "", where]))
    shown = shown_parameters(job["config"])
    return RunCard(_name(session, job), job["started"], _text(tags), shown, text, label)


def seed_card(session: Json, job: Json, seed: int, parent: str | None) -> RunCard:
    """The run of one seed of a job."""
    tags = _common(session) | _of_job(session, job, parent) | {"level": "seed", "seed": seed}
    tags |= {f"data.{name}": digests[str(seed)] for name, digests in job.get("data", {}).items()}
    tags[COLOUR] = tint(tags[COLOUR])
    folder, name = job["folders"][job["seeds"].index(seed)], _name(session, job)
    text = f"Seed {seed} of **{name}** on `{job['experiment']}`, in `{folder}`."
    shown = shown_parameters(job["config"]) | {"seed": str(seed)}
    return RunCard(f"seed-{seed}", job["started"], _text(tags), shown, text, _label(session, job), name)


def failure(description: str, error: str) -> str:
    """A description with why the run failed."""
    return f"{description}\n\n**Failed:**\n\n```\n{error}\n```".lstrip()


def _label(session: Json, job: Json) -> dict[str, Any]:
    """What tells a job from the others; empty where the session said nothing of it."""
    labels = session.get("labels", [])
    return labels[job["number"]] if job["number"] < len(labels) else {}


def _name(session: Json, job: Json) -> str:
    """What differs from the other jobs, or, where there are none, from the method."""
    if label := _label(session, job):
        return differing.name(label, session["labels"])
    return job["method"] if job["slug"] == "default" else f"{job['method']} {job['slug']}"


def _colour(session: Json, job: Json) -> str:
    """The method's own where there is one job of it; else one for each job, so that no two curves share it."""
    labels = session.get("labels", [])
    alone = job["slug"] == "default" if not labels else set(_label(session, job)) <= {"method", "experiment"}
    return COLOURS[job["method"]] if alone and job["method"] in COLOURS else nth(job["number"])


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows[:MAX_ROWS]]
    more = f"\n\n… and {len(rows) - MAX_ROWS} more" if len(rows) > MAX_ROWS else ""
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + more


def _cell(value: Any) -> str:
    return "" if value is None else typed(value).replace("|", "\\|")


def _common(session: Json) -> dict[str, Any]:
    return {
        "session": session["id"],
        "host": session["host"],  # with the next two: whose a run is that says RUNNING
        "pid": session["pid"],
        "process_started": session["process_started"],
        "mlflow.user": user(),
        "mlflow.source.name": source(session["command"]),
        "mlflow.source.type": "LOCAL",
    }


def source(command: str) -> str:
    """A command as far as MLflow's UI shows it, which takes it for a path: what stands before a slash is not seen.

    Example:
        >>> source("credit train -m method=block,delayed output=/tmp/runs seed=3")
        'credit train -m method=block,delayed'
    """
    return re.split(r"\s+\S*[/\\]", command, maxsplit=1)[0]


def user() -> str:
    """Who that is; a container may have a number that nobody gave a name."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return str(os.getuid())


def _of_job(session: Json, job: Json, parent: str | None) -> dict[str, Any]:
    tags = {
        "method": job["method"],
        "slug": job["slug"],
        "environment": job["env"],
        "job": job["number"],
        "config_hash": job["config_hash"],
        "git_commit": job["git_commit"],
        "mlflow.source.git.commit": job["git_commit"],
        PARENT: parent,
        COLOUR: _colour(session, job),
    }
    return {name: value for name, value in tags.items() if value is not None}


def _text(tags: Mapping[str, Any]) -> dict[str, str]:
    return {name: _cut(str(value), MAX_TAG) for name, value in tags.items()}
