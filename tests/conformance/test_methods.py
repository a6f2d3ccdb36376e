"""Every method runs on the experiments that it goes with, and every choice goes with one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest
import torch

from credit.config import files, kinds, registry, schema
from credit.runs import job
from credit.testing.short import SEEDS, WINDOWS, composed
from credit.trainer import Trainer

from .short import EVERY, EXPERIMENTS, options, problems_of


@pytest.mark.parametrize("method", options("method"))
def test_methods_run(method: str) -> None:
    """On the first experiment that takes them; every row of the journal is whole."""
    found = (e for e in EXPERIMENTS if not problems_of(f"experiment={e}", f"method={method}"))
    experiment = next(found, None)
    assert experiment is not None, f"no experiment takes {method}"
    rows = run(f"experiment={experiment}", f"method={method}")
    assert rows
    for values in rows:
        assert all(value.shape == (2,) for value in values.values())
        known = {
            name: value for name, value in values.items() if not name.startswith(("policy/", "eval/", "optimizer/"))
        }
        assert all(torch.isfinite(value).all() for value in known.values() if name_is_of_run(known)), values


def name_is_of_run(values: Mapping[str, Any]) -> bool:
    return "regret/cumulative" in values  # rollouts know nothing before the first round


def run(*words: str) -> list[dict[str, torch.Tensor]]:
    config = composed(*words)
    trainer: Trainer = schema.build(job.checked(config), "trainer")
    trainer.start(SEEDS)
    rows: list[dict[str, torch.Tensor]] = []
    trainer.run(lambda step, values: rows.append(values))
    assert trainer.collected == WINDOWS
    return rows


@pytest.mark.parametrize("feedback", ["block_sum", "terminal"])
@pytest.mark.parametrize(
    "method",
    [
        "random",
        "disagreement",
        *(pytest.param(m, marks=pytest.mark.thorough) for m in ("reference", "adaptive_mse", "oracle")),
    ],
)
def test_methods_run_in_episodes(method: str, feedback: str) -> None:
    rows = run("experiment=sepsis", f"method={method}", f"feedback={feedback}")
    for values in rows:
        assert all(value.shape == (2,) and torch.isfinite(value).all() for value in values.values()), values


@pytest.mark.thorough
@pytest.mark.parametrize("name", EVERY)
def test_an_experiment_takes_every_method_or_says_why_not(name: str) -> None:
    taken = []
    for method in files.options("method"):
        config = registry.compose(["tracking=none", f"experiment={name}", f"method={method}"])
        assert (config["experiment"], config["method"]) == (name, method)
        found = job.check(config).problems
        said = (" needs ", "written for", "is made for")
        assert all(any(words in problem for words in said) for problem in found), found
        taken += [] if found else [method]
    assert {"reference", "adaptive_mse", "disagreement", "random", "oracle"} <= set(taken)


@pytest.mark.parametrize("kind", sorted({*kinds.CHOICES} - {"sweep"}))
def test_choices_compose(kind: str) -> None:
    """Every choice goes with one experiment at least."""
    for name in files.options(kind):
        if name.startswith("generic"):
            continue
        experiments = [name] if kind == "experiment" else EXPERIMENTS
        choice = () if kind == "experiment" else (f"{kind}={name}",)
        assert any(not problems_of(f"experiment={experiment}", *choice) for experiment in experiments), name
