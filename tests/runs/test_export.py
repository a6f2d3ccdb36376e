"""A policy as an ONNX file does what the policy does; what cannot be one is refused, and nothing is written."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import credit
from credit.core.errors import UserError
from credit.runs import export as exporting
from credit.runs.policies import POLICY, Kept, KeptPolicy, read
from tests.runs.test_policies import kept
from tests.runs.test_starting import AGENTS, made

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxscript")
from onnx.reference import ReferenceEvaluator  # noqa: E402

Composed = Callable[..., dict[str, Any]]


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory, composed: Composed) -> Callable[[str], Path]:
    """The folder of a seed of a finished run, by the name of its agent."""
    found: dict[str, Path] = {}

    def of(name: str) -> Path:
        if name not in found:
            config = composed(*AGENTS[name])
            found[name] = kept(made(config), config, tmp_path_factory.mktemp(name))[1]
            (found[name] / "config.yaml").touch()
        return found[name]

    return of


@pytest.mark.parametrize(
    "name",
    [
        "planner",
        "sac",
        *(pytest.param(name, marks=pytest.mark.thorough) for name in ("block", "q", "dqn", "td3", "ppo")),
    ],
)
def test_the_file_does_what_the_policy_does(name: str, places: Callable[[str], Path], tmp_path: Path) -> None:
    """Observations of the environment itself in, its own actions out."""
    place = places(name)
    policy = Kept(read(place), place / POLICY)
    file = credit.export(place, tmp_path / "policy.onnx")
    assert [entry.name for entry in tmp_path.iterdir()] == ["policy.onnx"]
    run = ReferenceEvaluator(onnx.load(file))
    acts, numbers = KeptPolicy(policy), np.random.default_rng(0)
    for step in range(5):
        if policy.problem.finite_states:
            seen: Any = int(numbers.integers(policy.problem.states))
            given = np.array([seen])
        else:
            seen = numbers.uniform(-0.3, 0.3, policy.problem.observations).astype(np.float32)
            given = seen[None]
        (action,) = run.run(None, {"observation": given, "step": np.array([step])})
        np.testing.assert_allclose(action[0], acts(seen, step), rtol=0, atol=1e-5)


def test_the_file_says_what_it_is(places: Callable[[str], Path], tmp_path: Path) -> None:
    place = places("planner")
    model = onnx.load(credit.export(place, tmp_path / "policy.onnx"))
    said = {entry.key: entry.value for entry in model.metadata_props}
    assert said["policy"] == "behaviour"
    assert said["seed"] == place.name.removeprefix("seed-")
    assert said["action_space"] == "Discrete(3)"
    assert [one.name for one in model.graph.input] == ["observation", "step"]
    assert [one.name for one in model.graph.output] == ["action"]


@pytest.mark.parametrize(
    ("file", "choice", "said"),
    [
        ("policy.pt", {}, "give a file that ends in .onnx"),
        ("none/policy.onnx", {}, "there is no folder"),
        ("policy.onnx", {"policy": "best"}, "policy=best: no such policy"),
    ],
)
def test_what_is_refused(
    file: str, choice: dict[str, str], said: str, places: Callable[[str], Path], tmp_path: Path
) -> None:
    with pytest.raises(UserError, match=re.escape(said)):
        credit.export(places("planner"), tmp_path / file, **choice)
    assert not [*tmp_path.iterdir()]


def test_a_policy_that_draws_at_random_is_refused(tmp_path: Path, composed: Composed) -> None:
    config = composed("method=random", "trainer.steps=70")
    place = kept(made(config), config, tmp_path)[0]
    (place / "config.yaml").touch()
    with pytest.raises(UserError, match="policy=behaviour draws its actions at random"):
        credit.export(place, tmp_path / "policy.onnx")
    assert not (tmp_path / "policy.onnx").exists()


def test_a_file_that_does_something_else_is_refused(
    places: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Here the exporter takes what is done for something else."""
    forward = exporting._Acting.forward
    monkeypatch.setattr(
        exporting._Acting,
        "forward",
        lambda self, seen, step: forward(self, seen, step) + int(torch.compiler.is_exporting()),
    )
    with pytest.raises(UserError, match="would not be followed by its file"):
        credit.export(places("planner"), tmp_path / "policy.onnx")
    assert not [*tmp_path.iterdir()]


def test_without_the_package_it_is_named(
    places: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(exporting.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(UserError, match=re.escape("pip install 'credit-rl[onnx]'")):
        credit.export(places("planner"), tmp_path / "policy.onnx")
