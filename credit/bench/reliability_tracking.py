"""What tracking costs and what it bears: fresh stores, many writers, the wall time of runs."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import math
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from credit.bench.measure import Row
from credit.bench.servers import Server, postgresql, postgresql_programs
from credit.runs.journal import Journal, write_yaml
from credit.runs.session import JobRecord, Session
from credit.tracking import MLflowTracking
from credit.tracking.store import quiet_environment

WRITERS = 8
TRIALS = 10
SEEDS, ROWS, METRICS = 10, 50, 20  # of the journal that every writer uploads
PAIRS = 5
SLICE = 3.0  # seconds of SAC's updates beside a living uploader, then beside a stopped one
WRITER = """
import json, sys, time
from pathlib import Path
from mlflow import MlflowClient
from credit.tracking import mirror, uploader
print("ready", flush=True)
for line in sys.stdin:
    session, output, uri = json.loads(line)
    begin = time.time()
    state = uploader.upload(Path(session), Path(output), uri, "all")
    print(json.dumps([begin, time.time(), state.sent, state.problem]), flush=True)
"""


def run(say: Callable[[str], None] = lambda line: None) -> list[Row]:
    """Measure everything; about six minutes."""
    with workshop() as folder, writers() as processes:
        say(f"{TRIALS} fresh SQLite stores")
        rows = [fresh_stores(folder, processes)]
        say(f"{WRITERS} writers: SQLite, PostgreSQL")
        rows += throughput(folder, processes)
    say("advertiser, with and without tracking")
    rows += advertiser()
    say("SAC, with and without tracking")
    return [*rows, sac()]


@contextlib.contextmanager
def workshop() -> Iterator[Path]:
    """A temporary folder that a database's own user may enter."""
    with tempfile.TemporaryDirectory(prefix="credit-bench-") as folder:
        os.chmod(folder, 0o755)
        yield Path(folder)


@contextlib.contextmanager
def writers(count: int = WRITERS) -> Iterator[list[subprocess.Popen[str]]]:
    """Processes that have imported everything and upload what they are told."""
    path = os.pathsep.join([str(Path(__file__).resolve().parents[2]), os.environ.get("PYTHONPATH", "")])
    start = partial(subprocess.Popen, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    environment = quiet_environment() | {"PYTHONPATH": path}
    processes = [start([sys.executable, "-c", WRITER], text=True, env=environment) for _ in range(count)]
    try:
        for process in processes:
            assert process.stdout is not None
            process.stdout.readline()
        yield processes
    finally:
        for process in processes:
            process.kill()
            process.communicate()


def upload_together(
    processes: list[subprocess.Popen[str]], output: Path, uri: str, seeds: int, rows: int, metrics: int
) -> list[tuple[float, float, int, str]]:
    """All processes upload a journal each, at the same moment: (begin, end, rows sent, problem) of each."""
    sessions = [written(output, f"writer{number}", seeds, rows, metrics) for number in range(len(processes))]
    for process, session in zip(processes, sessions, strict=True):
        assert process.stdin is not None
        process.stdin.write(json.dumps([str(session), str(output), uri]) + "\n")
        process.stdin.flush()
    answers = []
    for process in processes:
        assert process.stdout is not None
        answers.append(tuple(json.loads(process.stdout.readline() or '[0, 0, 0, "died"]')))
    return answers


def written(output: Path, method: str, seeds: int, rows: int, metrics: int) -> Path:
    """The journal of a job that has ended; its session's folder."""
    session = Session.begin(output, "job", "bench", ["train"], {"uri": None, "seeds": "all"}, [{"method": method}])
    folders = [output / "bench" / method / "default" / f"seed-{seed}" for seed in range(seeds)]
    journal = Journal(folders)
    record = job_record(session, method, folders)
    for row in range(rows):
        journal.log(row + 1, {f"m/{k}": [math.sin(row * k + seed) for seed in range(seeds)] for k in range(metrics)})
    journal.flush()
    for folder in folders:
        write_yaml(folder / "config.yaml", {"method": method})
    record.finish("FINISHED")
    session.finish("FINISHED")
    return session.folder


def job_record(session: Session, method: str, folders: list[Path]) -> JobRecord:
    """The record of the only job of a session."""
    facts: dict[str, Any] = {"experiment": "bench", "method": method, "slug": "default", "env": "none"}
    facts |= {"seeds": list(range(len(folders))), "config": {"method": method}, "config_hash": "0", "overrides": []}
    facts |= {"folders": [str(folder.relative_to(session.output)) for folder in folders], "data": {}}
    return JobRecord(session, 0, time.time(), facts)


def fresh_stores(folder: Path, processes: list[subprocess.Popen[str]], trials: int = TRIALS) -> Row:
    """All processes start on a SQLite file that does not exist yet."""
    good = 0
    for trial in range(trials):
        output = folder / f"fresh-{trial}"
        answers = upload_together(processes, output, f"sqlite:///{output / 'mlflow.db'}", 1, 2, 1)
        good += sum(not problem for *_, problem in answers)
    wanted = trials * len(processes)
    what = f"{len(processes)} processes on a fresh SQLite store, {trials} trials: successes"
    return Row(what, f"{good} of {wanted}", "all", good == wanted)


def throughput(folder: Path, processes: list[subprocess.Popen[str]]) -> list[Row]:
    """Values a second that all processes together upload."""
    output = folder / "sqlite"
    upload_together(processes, output, f"sqlite:///{output / 'mlflow.db'}", 1, 1, 1)  # makes the store
    rows = [_throughput("SQLite", processes, output, f"sqlite:///{output / 'mlflow.db'}")]
    if postgresql_programs() is None:
        return [*rows, Row("values a second, PostgreSQL", "not installed: apt-get install postgresql")]
    if importlib.util.find_spec("psycopg") is None:
        return [*rows, Row("values a second, PostgreSQL", "psycopg is not installed: pip install 'credit-rl[server]'")]
    database, output = folder / "postgresql", folder / "server"
    database.mkdir()
    output.mkdir()
    with postgresql(database) as store, Server(store, output) as server:
        return [*rows, _throughput("mlflow server on PostgreSQL", processes, output, server.uri)]


def _throughput(name: str, processes: list[subprocess.Popen[str]], output: Path, uri: str) -> Row:
    answers = upload_together(processes, output, uri, SEEDS, ROWS, METRICS)
    problems = [problem for *_, problem in answers if problem]
    seconds = max(end for _, end, *_ in answers) - min(begin for begin, *_ in answers)
    # A seed's row has the metrics and the time, the job's row their intervals too.
    values = len(processes) * ROWS * (SEEDS * (METRICS + 1) + 3 * METRICS + 1)
    figure = f"{values / seconds:.0f} ({values} in {seconds:.1f} s, {len(problems)} errors)"
    return Row(f"values a second of {len(processes)} writers, {name}", figure, "no error", not problems)


def advertiser(pairs: int = PAIRS) -> list[Row]:
    """A job of 20 replicas by the command line, with tracking and without, in turns."""
    jobs: dict[str, list[float]] = {"mlflow": [], "none": []}
    work: dict[str, list[float]] = {"mlflow": [], "none": []}
    commands: dict[str, list[float]] = {"mlflow": [], "none": []}
    with workshop() as folder:
        for pair in range(pairs):
            for name in ("none", "mlflow") if pair % 2 else ("mlflow", "none"):
                output = folder / f"{name}-{pair}"
                words = ["train", "method=disagreement", "replicas=20", f"output={output}"]
                words += ["tracking=none"] if name == "none" else []
                begin = time.monotonic()
                subprocess.run([sys.executable, "-m", "credit.cli.main", *words], check=True, capture_output=True)
                commands[name].append(time.monotonic() - begin)
                summary = json.loads(next(output.glob("advertiser/*/*/seed-0/summary.json")).read_text())
                jobs[name].append(summary["wall_seconds"])
                work[name].append(summary["cpu_seconds"])
    # The least of each: noise on a shared machine only ever adds.
    ratio, cpu, whole = (min(x["mlflow"]) / min(x["none"]) for x in (jobs, work, commands))
    what = f"wall time of a 20-replica advertiser job, tracking over none, least of {pairs}"
    return [
        Row(what, f"{ratio:.3f}", "≤ 1.15", ratio <= 1.15),
        Row("the same of the job's own CPU time, on a machine with other work the better guide", f"{cpu:.3f}"),
        Row("the same of the whole command, imports and last upload included", f"{whole:.3f}"),
    ]


def sac(slices: int = 20) -> Row:
    """Wall time of SAC's updates while an uploader follows a journal, over the same while it is stopped, in turns."""
    from credit.bench.sac import learner

    work = learner((0,), width=64, batch=64)
    work()
    seconds: dict[bool, list[float]] = {True: [], False: []}
    with workshop() as folder:
        output = folder / "outputs"
        session = Session.begin(output, "job", "bench", ["train"], {"uri": None, "seeds": "auto"}, [])
        tracking = MLflowTracking()
        tracking.start(session.folder, output)
        folders = [output / "bench" / "sac" / "default" / f"seed-{seed}" for seed in range(4)]
        journal = Journal(folders)
        record = job_record(session, "sac", folders)
        process = tracking.process
        assert process is not None
        time.sleep(10)  # its imports
        for number in range(slices):
            lives = number % 2 == 0
            process.send_signal(signal.SIGCONT if lives else signal.SIGSTOP)
            # A row a slice is many times what such a run writes.
            journal.log(number + 1, {f"m/{k}": [float(k + number)] * len(folders) for k in range(METRICS)})
            journal.flush()
            end = time.monotonic() + SLICE
            while time.monotonic() < end:
                begin = time.perf_counter()
                work()
                seconds[lives].append(time.perf_counter() - begin)
        process.send_signal(signal.SIGCONT)
        record.finish("FINISHED")
        session.finish("FINISHED")
        late = tracking.finish(timeout=60)
    ratio = statistics.mean(seconds[True]) / statistics.mean(seconds[False])
    figure = f"{ratio:.4f}" + (f" ({late})" if late else "")
    return Row("wall time of SAC's updates, beside an uploader over alone", figure, "≤ 1.01", ratio <= 1.01)
