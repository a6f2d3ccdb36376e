"""A report (tables and figures) as a run of its own beside the runs it speaks of."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Mapping
from pathlib import Path

from credit.tracking.store import open_experiment, quiet_environment, resolve_uri

MAX_METRICS = 1000


def log_report(output: Path, uri: str | None, experiment: str, folder: Path, metrics: Mapping[str, float]) -> str:
    """Log a folder of tables and figures as one MLflow run named `compare`.

    Args:
        output: output folder.
        uri: tracking URI; None is the default store.
        experiment: the experiment that the report is about.
        folder: the folder whose files become artifacts.
        metrics: the report's numbers, logged as `report/<name>`; what is not finite is left out.

    Returns:
        The run's id.

    Raises:
        mlflow.exceptions.MlflowException: the store cannot be reached or written.
    """
    os.environ.update(quiet_environment())
    from mlflow.entities import Metric

    from credit.tracking.describe import safe_name

    client, identity = open_experiment(resolve_uri(uri, output), output, experiment)
    now = round(time.time() * 1000)
    run = client.create_run(identity, now, {"level": "report"}, run_name="compare").info.run_id
    # One section of the UI holds them all, folded: beside the curves they would be hundreds of bars.
    names = {name: safe_name(f"report/{name.replace('/', '_')}") for name in metrics}
    points = [Metric(names[name], x, now, 0) for name, x in metrics.items() if math.isfinite(x)]
    for start in range(0, len(points), MAX_METRICS):
        client.log_batch(run, metrics=points[start : start + MAX_METRICS])
    client.log_artifacts(run, str(folder))
    client.set_terminated(run)
    return str(run)
