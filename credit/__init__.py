"""credit: reinforcement learning when rewards come late.

Example:
    >>> import credit
    >>> result = credit.run(["experiment=advertiser", "method=disagreement", "replicas=5"])
    >>> result.metrics["regret/cumulative"].mean()
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from credit.core.version import __version__
from credit.envs.registration import register_soon
from credit.renamed import answer_old_imports

if TYPE_CHECKING:
    from credit.api import check, compare, list, recover, sweep, tune
    from credit.core.errors import UserError
    from credit.logged.estimator import CreditRegressor
    from credit.logged.saving import load_model
    from credit.runs.composing import compose
    from credit.runs.evaluate import evaluate
    from credit.runs.export import export
    from credit.runs.load import Run, load
    from credit.runs.play import play
    from credit.runs.resume import resume
    from credit.runs.runner import Result, run

os.environ.setdefault("RL_LOGGING_LEVEL", "WARNING")  # TorchRL reads it once, and tells of every buffer otherwise
answer_old_imports()
register_soon()  # our environments, with Gymnasium, once it is imported

__all__ = [
    "CreditRegressor",
    "Result",
    "Run",
    "UserError",
    "__version__",
    "check",
    "compare",
    "compose",
    "evaluate",
    "export",
    "list",
    "load",
    "load_model",
    "play",
    "recover",
    "resume",
    "run",
    "sweep",
    "tune",
]
_HOMES = {
    **dict.fromkeys(("check", "compare", "list", "recover", "sweep", "tune"), "api"),
    **dict.fromkeys(("Result", "run"), "runs.runner"),
    **dict.fromkeys(("Run", "load"), "runs.load"),
    "CreditRegressor": "logged.estimator",
    "UserError": "core.errors",
    "compose": "runs.composing",
    "evaluate": "runs.evaluate",
    "export": "runs.export",
    "load_model": "logged.saving",
    "play": "runs.play",
    "resume": "runs.resume",
}


def __getattr__(name: str) -> Any:
    """Import on first use, so that `credit --help` and the uploader do not wait for torch."""
    if name not in _HOMES:
        raise AttributeError(f"module 'credit' has no attribute {name!r}")
    import importlib

    return getattr(importlib.import_module(f"credit.{_HOMES[name]}"), name)


def __dir__() -> Any:  # a list, whose name is taken here
    """What users call, also before it is imported."""
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
