"""Episodes of a kept policy, as steps, and as pictures where there are some."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import credit
from credit.runs.play import play
from tests.runs.test_evaluate import CART, ran


@pytest.fixture(scope="module")
def cart(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ran(tmp_path_factory.mktemp("cart"), *CART, "env.evaluation_episodes=1", "agent.updates=1")


def test_steps_of_episodes(cart: Path) -> None:
    found = play(cart, 2)
    steps = found.steps
    assert found.source == cart / "seed-0"
    assert (found.frames, found.arrays) == ([], {})
    assert steps["episode"].unique().tolist() == [0, 1]
    first = steps[steps["episode"] == 0]
    assert first["step"].tolist() == [*range(len(first))]
    assert (first["reward"] == 1).all()
    policy = credit.load(cart / "seed-0").policy
    assert [policy(row["state"], row["step"]) for row in first.to_dict("records")] == first["action"].tolist()


def test_pictures(cart: Path) -> None:
    pytest.importorskip("pygame")
    found = play(cart, frames=True)
    assert len(found.frames) == len(found.steps) + 1
    assert found.frames[0].dtype == np.uint8
    assert found.frames[0].shape[-1] == 3
    assert not np.array_equal(found.frames[0], found.frames[-1])
    assert found.steps["state"].iloc[-1].tolist() == play(cart).steps["state"].iloc[-1].tolist()  # the same episode
