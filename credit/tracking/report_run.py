"""A report (tables and figures) as a run of its own beside the runs it speaks of."""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from credit.core.naming import metric_name
from credit.tracking.describe import MAX_TAG, user
from credit.tracking.mirrored import missing
from credit.tracking.store import VARIABLE, dashboard, open_experiment, quiet_environment, resolve_uri

MAX_METRICS, MAX_PARAMETERS, MAX_PARAMETER = 1000, 100, 6000  # at once, at once, letters


def log_beside_runs(output: Path, experiment: str, folder: Path, metrics: Mapping[str, float]) -> str:
    """Log a report to the store that the newest training session of its experiment used.

    Args:
        output, experiment, folder, metrics: as in `log_report`.

    Returns:
        What became of it, in one line.
    """
    tracking = _newest_tracking(output, experiment)
    if tracking is None:
        return "Not logged to MLflow: the newest training session was not tracked there."
    if problem := missing("mlflow"):
        return f"Not logged to MLflow: {problem}."
    try:
        log_report(output, tracking["uri"] or os.environ.get(VARIABLE), experiment, folder, metrics)
    except Exception as error:  # a store that is down must not cost the user the report
        reason = (str(error).splitlines() or [""])[0]
        return f"Not logged to MLflow: {type(error).__name__}: {reason}"
    return f"Logged to MLflow as run `compare`; look at it with `{dashboard(output, tracking['uri'])}`."


def log_folder(
    output: Path,
    experiment: str,
    name: str,
    folder: Path,
    metrics: Mapping[str, float],
    parameters: Mapping[str, str] | None = None,
) -> str:
    """Log a folder as a run of its own to the store of an output folder, or to the one that the environment names.

    Args:
        output: output folder. experiment: of MLflow. name: of the run. folder, metrics, parameters: as in `log_report`.

    Returns:
        What became of it, in one line.
    """
    if problem := missing("mlflow"):
        return f"Not logged to MLflow: {problem}."
    try:
        log_report(output, os.environ.get(VARIABLE), experiment, folder, metrics, name, parameters)
    except Exception as error:  # a store that is down must not cost the user what was found
        reason = (str(error).splitlines() or [""])[0]
        return f"Not logged to MLflow: {type(error).__name__}: {reason}"
    return f"Logged to MLflow as run `{name}`; look at it with `{dashboard(output, None)}`."


def log_report(
    output: Path,
    uri: str | None,
    experiment: str,
    folder: Path,
    metrics: Mapping[str, float],
    name: str = "compare",
    parameters: Mapping[str, str] | None = None,
) -> str:
    """Log a folder of tables and figures as one MLflow run.

    Args:
        output: output folder.
        uri: tracking URI; None is the default store.
        experiment: the experiment that the report is about.
        folder: the folder whose files become artifacts.
        metrics: the few numbers that matter, logged as `report/<name>`; what is not finite is left out.
        name: of the run. parameters: key → value, by which runs are told apart.

    Returns:
        The run's id.

    Raises:
        mlflow.exceptions.MlflowException: the store cannot be reached or written.
    """
    os.environ.update(quiet_environment())
    from mlflow.entities import Metric, Param

    command = f"credit compare experiment={experiment}" if name == "compare" else f"credit {experiment} {name}"
    client, identity = open_experiment(resolve_uri(uri, output), output, experiment)
    now = round(time.time() * 1000)
    tags = {
        "level": "report",
        "mlflow.note.content": _table_of(folder),
        "mlflow.user": user(),
        "mlflow.source.name": command,
        "mlflow.source.type": "LOCAL",
    }
    run = client.create_run(identity, now, tags, run_name=name).info.run_id
    # One section of the UI holds them all, folded; each is a column of the table of runs, so there should be few.
    names = {name: metric_name(f"report/{name.replace('/', '_')}") for name in metrics}
    points = [Metric(names[name], x, now, 0) for name, x in metrics.items() if math.isfinite(x)]
    params = [Param(metric_name(key), value[:MAX_PARAMETER]) for key, value in (parameters or {}).items()]
    for start in range(0, len(params), MAX_PARAMETERS):
        client.log_batch(run, params=params[start : start + MAX_PARAMETERS])
    for start in range(0, len(points), MAX_METRICS):
        client.log_batch(run, metrics=points[start : start + MAX_METRICS])
    client.log_artifacts(run, str(folder))
    client.set_terminated(run)
    return str(run)


def _table_of(folder: Path) -> str:
    """The report's table, which is Markdown, as far as a description can hold it."""
    file = folder / "table.md"
    text = file.read_text(encoding="utf-8") if file.exists() else ""
    return text if len(text) <= MAX_TAG else text[: text.rindex("\n", 0, MAX_TAG)]


def _newest_tracking(output: Path, experiment: str) -> dict[str, Any] | None:
    """How the newest session of the experiment was tracked, or None."""
    own: list[tuple[float, Any]] = []
    for path in output.glob("sessions/*/session.json"):
        try:
            session = json.loads(path.read_text(encoding="utf-8"))
            if session["experiment"] == experiment:
                own.append((float(session["started"]), session["tracking"]))
        except (OSError, ValueError, KeyError, TypeError):  # a damaged one must not cost the user the report
            continue
    tracking = max(own, key=lambda session: session[0], default=(0.0, None))[1]
    return tracking if tracking and "uri" in tracking else None
