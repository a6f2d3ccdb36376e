"""What is told between two labels: before the first fit, and behind a stop, as if nothing had happened."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import credit
from credit.config import registry, schema
from credit.runs import checkpoint
from credit.trainer import Trainer

LATE = {  # labels come long after the first row is written, and the last one long before the last row
    "planner": ("env.id=FrozenLake-v1", "method=disagreement", "feedback.delay=70"),
    "stacked": ("env.id=FrozenLake-v1", "method=adaptive_mse", "mixer=stacking", "feedback.delay=70"),
    "network": ("env.id=CartPole-v1", "method=reference", "feedback.delay=70", "reference.first_steps=4"),
    "some": ("env.id=CartPole-v1", "method=reference", "feedback.delay=70", "assigner.relabel=.5"),
}
FEW = ("feedback=episode_sum", "tracking=none", "seed=3", "replicas=2", "trainer.steps=160", "trainer.log_every=1")


def words(name: str) -> list[str]:
    return [
        "env=gymnasium",
        *FEW,
        "trainer.steps_per_round=5",
        "env.max_steps=40",
        "env.evaluation_episodes=1",
        *LATE[name],
    ]


@pytest.mark.parametrize("name", LATE)
def test_a_row_before_the_first_label_has_the_columns_of_all(name: str, tmp_path: Path) -> None:
    result = credit.run([*words(name), f"output={tmp_path}"])
    assert result.status == "FINISHED", result.error
    (file,) = tmp_path.rglob("seed-3/metrics.csv")
    rows = [line.split(",") for line in file.read_text().splitlines()]
    assert {len(row) for row in rows} == {len(rows[0])}
    weight = next(place for place, column in enumerate(rows[0]) if column.startswith("weight/"))
    assert rows[-1][weight]


@pytest.mark.parametrize("name", LATE)
def test_a_stop_between_two_labels_changes_no_row(name: str, tmp_path: Path) -> None:
    def made() -> Trainer:
        trainer: Trainer = schema.build(registry.compose(words(name)), "trainer")
        trainer.start((3, 4))
        return trainer

    first, second, path = made(), made(), tmp_path / checkpoint.NAME
    whole, rest, learned = list[Any](), list[Any](), list[int]()

    def between() -> None:
        learned.append(first.rounds)
        if len(learned) > 2 and learned[-1] == learned[-2] > 0 and not path.exists():
            checkpoint.save(path, {"trainer": first.state_dict()})

    first.run(lambda step, values: whole.append((step, values)), between=between)
    assert path.exists(), "every round brought a label"
    second.load_state_dict(checkpoint.load(path)["trainer"])
    second.run(lambda step, values: rest.append((step, values)))
    assert any(key.startswith("weight/") for key in rest[0][1])
    for (_, expected), (_, found) in zip(whole[-len(rest) :], rest, strict=True):
        assert list(found) == list(expected)
        for key, value in expected.items():
            np.testing.assert_array_equal(value.numpy(), found[key].numpy(), err_msg=key)


def test_a_run_to_which_no_label_came_ends_well(tmp_path: Path) -> None:
    late = [word.replace("delay=70", "delay=150").replace("steps=160", "steps=60") for word in words("network")]
    result = credit.run([*late, f"output={tmp_path}"])
    assert result.status == "FINISHED", result.error
