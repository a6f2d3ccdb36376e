"""PPO and labels that come late: it learns from what it did in the newest round, its reward model from every label."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from credit.agents.torchrl.rows import newest
from credit.config import registry, schema
from credit.core.windows import Windows
from credit.runs import job
from credit.trainer import Trainer

WORDS = (
    *("env=gymnasium", "env.id=CartPole-v1", "env.max_steps=12", "env.evaluation_episodes=1", "agent=ppo"),
    *("feedback=block_sum", "feedback.window=3", "trainer.steps=60", "trainer.steps_per_round=20", "tracking=none"),
)


def config_of(*words: str) -> dict[str, Any]:
    return registry.compose([*WORDS, *words])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("method=delayed", "feedback.delay=4"),
            "Delayed needs the labels themselves; use a method",
        ),
        (
            ("method=reference", "feedback.delay=20"),
            "none of them has its label within 20; take a larger",
        ),
    ],
)
def test_labels_that_come_too_late_are_refused(words: tuple[str, ...], said: str) -> None:
    assert said in " ".join(job.check(config_of(*words)).problems)


@pytest.mark.parametrize(
    ("words", "most"),
    [
        (["feedback.delay=7"], 20 - 7),
        (["feedback=episode_sum"], 20),  # whole episodes, open across rounds
    ],
)
def test_it_learns_from_the_newest_round_and_its_reward_model_from_all(words: list[str], most: int) -> None:
    config = job.checked(config_of("method=reference", *words))
    trainer: Trainer = schema.build(config, "trainer")
    trainer.start((3,))
    seen, taken = list[Windows](), list[int]()
    learn = trainer.agent.improve

    def improve(store: Any, assigner: Any) -> None:
        rows = list(newest(store.new, assigner.rewards(store.new), trainer.problem))
        if store.new.fresh is not None:
            assert torch.equal(rows[0]["observation"], store.new.states[0][store.new.fresh[0]])
        seen.append(store.new)
        taken.append(len(rows[0]))
        learn(store, assigner)

    trainer.agent.improve = improve  # type: ignore[method-assign]
    trainer.run(lambda step, values: None)
    assert len(seen) == 3
    assert taken[0] == len(seen[0])  # the first round has nothing from before
    for windows, rows, before in zip(seen[1:], taken[1:], seen, strict=False):
        assert 0 < rows <= most
        assert rows < len(windows)
        assert len(before) > 0
    assert sum(map(len, seen)) == len(trainer.store.windows)
