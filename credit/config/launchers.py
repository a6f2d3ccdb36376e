"""Hydra's launchers: which one runs the jobs of a command, and handing the jobs to it."""

from __future__ import annotations

import importlib.util
import os
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.plugins import Plugins
from hydra.core.utils import JobStatus
from hydra.types import HydraContext, RunMode

from credit.config import registry
from credit.config.files import CONFIG_NAME
from credit.config.quoting import quoted
from credit.core.errors import UserError

EXTRAS = {  # package of a plugin → the extra that brings it
    "hydra_submitit_launcher": "slurm",
    "hydra_ray_launcher": "ray",
}


def choose(overrides: Sequence[str], jobs: int, gpu: bool, config_dirs: Sequence[str] = ()) -> list[str]:
    """The overrides that configure the launcher of a command.

    Where none was chosen, several jobs share the cores of this machine, or its GPUs, and one job runs in this process.

    Args:
        overrides: of the command line. jobs: how many. gpu: whether they run on GPUs.
        config_dirs: further folders of YAML files.

    Raises:
        UserError: there is no such launcher, or it is not installed.
    """
    words = [text for text in overrides if text.lstrip("+").startswith("hydra")]
    workers = min(_devices() if gpu else _cores(), jobs)
    if not any(text.startswith("hydra/launcher=") for text in words):
        has_keys = any(text.lstrip("+").startswith("hydra.launcher.") for text in words)  # basic has none
        words.append(f"hydra/launcher={'local' if workers > 1 or has_keys else 'basic'}")
    node = registry.hydra_node(words, config_dirs)["launcher"]
    package = node["_target_"].split(".")[1]
    if package in EXTRAS and importlib.util.find_spec(f"hydra_plugins.{package}") is None:
        raise UserError(
            f"{next(text for text in words if text.startswith('hydra/launcher='))}: {package} is not installed; "
            f"pip install 'credit-rl[{EXTRAS[package]}]', or choose hydra/launcher=local"
        )
    if node.get("n_jobs", 0) is None:
        words.append(f"hydra.launcher.n_jobs={workers}")
    if "ray" in node and not node["ray"]["init"].get("address"):  # a private Ray is for this machine alone
        words.append("+hydra.launcher.ray.init._node_ip_address=127.0.0.1")
    return words


def launch(
    task: Callable[[Any], None],
    jobs: int,
    launcher: Sequence[str],
    place: Mapping[str, str],
    config_dirs: Sequence[str],
) -> dict[int, str]:
    """Hand jobs to Hydra's launcher and wait for them.

    Args:
        task: called once a job, in any process; `job_number` tells which job it is, and the task knows the rest.
        jobs: how many. launcher: what `choose` returned. place: key → value, where their session lies.
        config_dirs: folders of YAML files.

    Returns:
        Number of the job → what the task raised; it is meant to raise nothing.
    """
    words = [f"{key}={quoted(value)}" for key, value in place.items()]
    os.environ.setdefault("RAY_AUTH_MODE", "token")  # a Ray that anybody may join runs anybody's code
    with registry.composing(config_dirs=config_dirs):
        state = GlobalHydra.instance()
        config = state.hydra.compose_config(
            CONFIG_NAME, [*launcher, *words], run_mode=RunMode.MULTIRUN, with_log_configuration=False
        )
        context = HydraContext(config_loader=state.config_loader(), callbacks=_no_callbacks(config))
        starter = Plugins.instance().instantiate_launcher(hydra_context=context, task_function=task, config=config)
        with _deaf(config["hydra"]["launcher"]["_target_"]):
            ended = starter.launch([list(words) for _ in range(jobs)], initial_job_idx=0)
    failed = {index: job for index, job in enumerate(ended) if job.status is not JobStatus.COMPLETED}
    return {index: f"{type(job._return_value).__name__}: {job._return_value}" for index, job in failed.items()}


@contextmanager
def _deaf(launcher: str) -> Iterator[None]:
    """Workers of joblib's are born deaf to Ctrl-C, which is for the command, and would end their imports in tracebacks.

    They inherit what this thread does not hear; Python hears it all the same, by its other threads.
    """
    if "joblib" not in launcher:
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def job_number() -> int:
    """Inside a task: the number of this job in its launch."""
    number: int = HydraConfig.get().job.num
    return number


def _no_callbacks(config: Any) -> Any:
    from hydra._internal.callbacks import Callbacks

    return Callbacks(config)


def _cores() -> int:
    """Cores that this process may use: of the machine, its affinity and its control group."""
    import joblib

    count: int = joblib.cpu_count()
    return count


def _devices() -> int:
    import torch

    return torch.cuda.device_count()
