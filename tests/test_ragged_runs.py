"""Rounds of whole episodes that end when they like: a replica does not wait for others with its random numbers."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from credit.config import registry, schema
from credit.runs import job
from credit.trainer import Trainer

ROUNDS = ("trainer.steps_per_round=null", "trainer.windows_per_round=3", "trainer.log_every=3", "tracking=none")
LAKE = ("env=gymnasium", "env.id=FrozenLake-v1", "env.copies=3", "env.max_steps=30", "trainer.steps=360")
RUNS = {
    "random": (*LAKE, "feedback=episode_sum", "method=random"),
    "dqn": (*LAKE, "feedback=episode_sum", "method=delayed", "agent=dqn", "agent.batch=8", "agent.hidden=[8]"),
}


def lived(config: dict[str, Any], *seeds: int) -> Trainer:
    trainer: Trainer = schema.build(config, "trainer")
    trainer.start(seeds)
    trainer.run(lambda step, values: None)
    return trainer


@pytest.mark.parametrize("name", RUNS)
def test_a_replica_goes_alone_as_in_a_batch(name: str) -> None:
    config = job.checked(registry.compose([*RUNS[name], *ROUNDS]))
    batch, alone = lived(config, 3, 4, 5), lived(config, 4)
    ours, theirs = alone.store.windows, batch.store.windows
    lengths = theirs.count
    assert lengths is not None
    assert len(lengths.unique()) > 1  # or this tests nothing
    count = int(lengths[1])
    assert ours.actions.shape[1] == count
    for column in ("states", "actions", "next_states", "labels"):
        mine, other = getattr(ours, column)[0], getattr(theirs, column)[1]
        assert torch.equal(mine, other[: len(mine)]), column
