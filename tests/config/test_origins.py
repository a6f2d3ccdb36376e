"""`credit check --explain`: every key, its value, and where that comes from."""

from __future__ import annotations

from pathlib import Path

import pytest

from credit.config import registry, schema
from credit.config.origins import explained
from credit.runs import job


def origins(*words: str, dirs: tuple[str, ...] = ()) -> dict[str, tuple[object, str]]:
    config = job.checked(registry.compose(["tracking=none", *words], dirs))
    return {path: (value, origin) for path, value, origin in explained(config, ["tracking=none", *words], dirs)}


CHOSEN = "(chosen by method=disagreement)"


@pytest.mark.parametrize(
    ("key", "value", "origin"),
    [
        ("mixer.epsilon", 1e-12, "file mixer/relative_mse.yaml"),
        ("mixer.alpha", 1.0, "experiment=sepsis"),  # a default for an option
        ("trainer.steps", 15000, "experiment=sepsis"),  # a value
        ("trainer.random_windows", 0, "file config.yaml"),
        ("surrogates.linear.unit", 1.0, "constructor"),
        ("surrogates.linear.features.patient", "state", "file features/clinical.yaml"),
        ("title", "Disagreement-UCB", "method=disagreement"),
        ("bonus.count.scale", 0.5, "command line"),
        ("env.start_oxygen", [0.3, 0.7, 0.0], "command line"),
        ("mixer._target_", "credit.recovery.mixers.RelativeMSE", f"file mixer/relative_mse.yaml {CHOSEN}"),
        ("feedback._target_", "credit.envs.feedback.Terminal", "file feedback/terminal.yaml (chosen by command line)"),
        (
            "agent._target_",
            "credit.agents.finite_horizon.FiniteHorizon",
            f"file agent/finite_horizon.yaml {CHOSEN}",
        ),
    ],
)
def test_origins(key: str, value: object, origin: str) -> None:
    words = ("experiment=sepsis", "feedback=terminal", "bonus.count.scale=.5", "env.start_oxygen=[.3,.7,0]")
    assert origins(*words)[key] == (value, origin)


def test_a_method_and_a_variant() -> None:
    found = origins("experiment=sepsis", "method=credit_hypotheses")
    assert found["reference.looks_at"] == (["step", "next_state"], "method=credit_hypotheses")
    assert found["surrogates.linear_last.features.patient"] == ("next_state", "method=credit_hypotheses")
    assert found["surrogates.linear_last.credit"] == ("last_step", "file reward/clinical_last.yaml")
    assert found["surrogates.linear_last.regularization"] == (1.0, "file reward/clinical.yaml")


def test_a_users_own_file(tmp_path: Path) -> None:
    file = tmp_path / "mixer/mine.yaml"
    file.parent.mkdir()
    file.write_text("# Mine.\ndefaults: [relative_mse, _self_]\nalpha: 0.3\n")
    found = origins("experiment=sepsis", "mixer=mine", dirs=(str(tmp_path),))
    assert found["mixer.alpha"] == (0.3, f"your file {file}")
    assert found["mixer.epsilon"] == (1e-12, "file mixer/relative_mse.yaml")


def test_every_value_of_a_job_is_there() -> None:
    config = job.checked(registry.compose(["experiment=pointmaze", "tracking=none"]))
    found = {path: value for path, value, _ in explained(config, ["experiment=pointmaze", "tracking=none"])}
    for slot in ("env", "feedback", "agent", "reference"):
        for path, node in schema.members(config, slot).items():
            for key, value in node.items():
                assert isinstance(value, dict) or found[f"{path}.{key}"] == value
