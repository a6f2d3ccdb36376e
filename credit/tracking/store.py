"""Opening MLflow: the store's address, the experiment, and quiet."""

from __future__ import annotations

import fcntl
import logging
import math
import os
import re
import shlex
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from json import JSONDecodeError
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.request import pathname2url, url2pathname

if TYPE_CHECKING:
    from mlflow import MlflowClient

ALLOWED = "sqlite:///FILE, postgresql://..., mysql://..., mssql://..., http://HOST:PORT or https://HOST"
_URI = re.compile(r"sqlite:///\S|(postgresql|mysql|mssql)(\+\w+)?://\S|https?://[\w\[]")
VARIABLE = "MLFLOW_TRACKING_URI"  # of the environment, where every tool of MLflow looks
_SQLITE = "sqlite:///"
FOLDERS = ("tensorboard", "wandb")  # trackers whose store is a folder: `tensorboard:FOLDER?option=value`
STORE, ARTIFACTS = "mlflow.db", "artifacts"  # in an output folder
_QUIET = {
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "DO_NOT_TRACK": "true",
    "MLFLOW_LOGGING_LEVEL": "ERROR",
    "MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT": "true",
    "GIT_PYTHON_REFRESH": "quiet",
    # MLflow's own retries can hide an unreachable server for minutes; the uploader has its own back-off.
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "0",
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "8",
}


def kind_of(uri: str) -> str:
    """Which tracker has a store: the scheme of its address, or MLflow, which has many."""
    scheme = uri.partition(":")[0]
    return scheme if scheme in FOLDERS else "mlflow"


def uri_problem(uri: str | None) -> str | None:
    """What is wrong with a tracking URI, or None where it can be used."""
    if uri is None or _URI.match(uri):
        return None
    hint = "; a folder of files is no longer supported by MLflow" if "://" not in uri else ""
    told = f" (by the environment's {VARIABLE})" if uri == os.environ.get(VARIABLE) else ""
    return f"tracking.uri={uri!r}{told} is not a tracking URI{hint}; allowed: {ALLOWED}, or null for the default"


def resolve_uri(uri: str | None, output: Path) -> str:
    """The store's full address: by default in the output folder; SQLite paths become absolute, and quoted.

    Example:
        >>> resolve_uri(None, Path("/50% off?/outputs"))
        'sqlite:////50%25%20off%3F/outputs/mlflow.db'
    """
    if uri is not None and kind_of(uri) in FOLDERS:
        kind, _, rest = uri.partition(":")
        path, mark, options = rest.partition("?")
        return f"{kind}:{pathname2url(str((output / url2pathname(path)).resolve()))}{mark}{options}"
    file = output / STORE if uri is None else sqlite_file(uri)
    return f"{_SQLITE}{pathname2url(str(file.resolve()))}" if file is not None else str(uri)


def name_in(output: Path, uri: str) -> str:
    """What the records of a folder call a store: one in it by its name alone, so that both may move."""
    if kind_of(uri) in FOLDERS:
        return uri.replace(f":{pathname2url(str(output.resolve()))}/", ":", 1)
    return STORE if uri == resolve_uri(None, output) else uri


def folder_of(uri: str) -> Path:
    """The folder of a store that is one."""
    return Path(url2pathname(uri.partition(":")[2].partition("?")[0]))


def dashboard(output: Path, uri: str | None) -> str:
    """The command that opens this store.

    Args:
        output: the folder of the runs. uri: tracking URI; None is the store in this folder.
    """
    words = ["credit", "dashboard"]
    if uri:
        words.append(f"uri={uri if '@' not in uri else '…'}")  # a password is not printed
    elif str(output) != "outputs":
        words.append(f"output={output}")
    return shlex.join(words)


def reason(error: BaseException) -> str:
    """What is wrong with a store, in one line: the first cause, which MLflow buries in words of its own."""
    while inner := error.__cause__ or (None if error.__suppress_context__ else error.__context__):
        error = inner
    line = (str(error).splitlines() or [""])[0][:300]
    if isinstance(error, JSONDecodeError):
        return f"what answers is no MLflow server ({line})"
    return f"{type(error).__name__}: {line}"


def sqlite_file(uri: str) -> Path | None:
    """The file behind an SQLite address; None for any other store."""
    return Path(url2pathname(uri.removeprefix(_SQLITE))) if uri.startswith(_SQLITE) else None


def is_gone(uri: str) -> bool:
    """Whether the folder of a local store is not there any more: who has moved it wants no empty one in its place."""
    file = folder_of(uri) if kind_of(uri) in FOLDERS else sqlite_file(uri)
    return file is not None and not file.parent.exists()


def born(uri: str) -> float:
    """Since when a local store is there, epoch seconds: what was told before went to another one.

    Infinity where there is none, or one that cannot be read; 0 where nobody can tell from here.
    """
    if kind_of(uri) in FOLDERS:
        return 0.0 if folder_of(uri).exists() else math.inf
    if (file := sqlite_file(uri)) is None:
        return 0.0
    if not file.exists():
        return math.inf
    try:
        with closing(sqlite3.connect(f"{file.as_uri()}?mode=ro", uri=True, timeout=30)) as store:
            ((first,),) = store.execute("SELECT MIN(creation_time) FROM experiments")
    except sqlite3.DatabaseError:
        return math.inf
    return (first or 0) / 1000


@contextmanager
def _only_one_process(uri: str, output: Path) -> Iterator[None]:
    """Alone on a store: on its file, where it is one, whichever output folder a process writes to."""
    file = sqlite_file(uri)
    lock = file.with_name(f".{file.name}.lock") if file else output / ".mlflow.lock"
    lock.parent.mkdir(parents=True, exist_ok=True)
    with open(lock, "w") as handle:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield


def _make_sqlite(file: Path) -> None:
    """Make a fresh store beside its place and move it there whole: a half-made schema can never be opened again."""
    unfinished = file.with_name(f".{file.name}.new")
    unfinished.unlink(missing_ok=True)
    try:
        client_of(resolve_uri(f"{_SQLITE}{pathname2url(str(unfinished))}", file.parent)).search_experiments(
            max_results=1
        )
    except BaseException:
        unfinished.unlink(missing_ok=True)
        raise
    os.replace(unfinished, file)


def client_of(uri: str) -> MlflowClient:
    """MLflow's client of a resolved address.

    MLflow takes the quoted path of an SQLite file for a real one, too, and makes its folders: they go again.
    """
    from mlflow import MlflowClient

    quoted = Path(uri.removeprefix(_SQLITE)) if uri.startswith(_SQLITE) else Path()
    missing = [folder for folder in quoted.parents if not folder.exists()]
    try:
        client = MlflowClient(uri)
        if missing:
            client.search_experiments(max_results=1)  # it opens the store when it is first asked
        return client
    finally:
        for folder in missing:
            with suppress(OSError):
                folder.rmdir()


def follow(output: Path) -> None:
    """Let the artifacts of a folder's own store lie where the folder lies now; MLflow writes down where that was."""
    file, here = output.resolve() / STORE, (output / ARTIFACTS).resolve().as_uri()
    if not file.exists():
        return
    with closing(sqlite3.connect(file, timeout=30)) as store, store:
        known = store.execute("SELECT DISTINCT artifact_location FROM experiments").fetchall()
        for (there,) in known:
            if str(there).startswith("file://") and there != here and there.endswith(f"/{ARTIFACTS}"):
                store.execute(
                    "UPDATE runs SET artifact_uri = ? || substr(artifact_uri, ?) WHERE substr(artifact_uri, 1, ?) = ?",
                    (here, len(there) + 1, len(there) + 1, f"{there}/"),
                )
                store.execute("UPDATE experiments SET artifact_location = ? WHERE artifact_location = ?", (here, there))


def quiet_environment() -> dict[str, str]:
    """The environment with what keeps MLflow silent, and makes it give up on a dead server soon.

    MLflow reads it when it is imported, so every entry point sets it before.
    """
    return _QUIET | os.environ


def open_experiment(uri: str, output: Path, name: str) -> tuple[MlflowClient, str]:
    """Open the store and an experiment in it; create what is missing.

    Args:
        uri: resolved address of the store.
        output: output folder; artifacts go to `<output>/artifacts` unless a server keeps them.
        name: the experiment's name.

    Returns:
        MLflow's client and the experiment's id.

    Raises:
        RuntimeError: the experiment was deleted in MLflow, or what answers is no MLflow server.
    """
    from mlflow.exceptions import MlflowException

    for noisy in ("mlflow", "alembic"):
        logging.getLogger(noisy).setLevel(logging.ERROR)
    # Two processes that migrate the schema of a fresh SQLite file at once kill each other.
    with _only_one_process(uri, output):
        file = sqlite_file(uri)
        if file is not None and not file.exists():
            _make_sqlite(file)
        if uri == resolve_uri(None, output):
            follow(output)
        client = client_of(uri)
        experiment = client.get_experiment_by_name(name)
        if experiment is None:
            location = None if uri.startswith("http") else (output / ARTIFACTS).resolve().as_uri()
            try:
                identity = client.create_experiment(
                    name, location, tags={"mlflow.experimentKind": "custom_model_development"}
                )
            except MlflowException:
                # Someone on another machine may have been faster on a shared server.
                experiment = client.get_experiment_by_name(name)
                if experiment is None:
                    raise
            else:
                return client, _named(identity, uri)
    if experiment.lifecycle_stage == "deleted":
        raise RuntimeError(
            f"the experiment {name!r} was deleted in MLflow ({uri}); restore it with "
            f"`mlflow experiments restore --experiment-id {experiment.experiment_id}`"
        )
    return client, _named(experiment.experiment_id, uri)


def _named(identity: str, uri: str) -> str:
    """An id that a store gave: MLflow's client takes an empty answer for an object without one."""
    if not identity:
        raise RuntimeError(f"{uri} answers, but not as an MLflow server does")
    return str(identity)
