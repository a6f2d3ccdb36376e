"""Other people's environments × labels × methods through two short rounds, and a stop between them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from credit.config import files, registry, schema
from credit.runs import checkpoint, job
from credit.trainer import Trainer

IDS = {  # id → further words
    "FrozenLake-v1": (),
    "Taxi-v4": (),
    "CliffWalking-v1": (),
    "Sepsis/ICU-Sepsis-v2": (),
    "CartPole-v1": (),
    "Acrobot-v1": (),
    "LunarLander-v3": (),
    "MiniGrid-Empty-5x5-v0": ("env.wrappers=[minigrid.wrappers:ImgObsWrapper]",),
    "Pendulum-v1": (),
    "InvertedDoublePendulum-v5": (),
    "HalfCheetah-v5": (),
    "Hopper-v5": (),
    "AdroitHandDoor-v1": (),
}
FEEDBACKS = {
    "episode_sum": (),
    "block_sum": ("feedback.window=4",),
    "terminal": (),
    "mean": ("feedback.window=[2,5]", "feedback.missing=.3"),
    "success": ("env.success=reward",),
    "late": ("feedback=block_sum", "feedback.window=3", "feedback.delay=4", "feedback.cut=drop"),
}
SHORT = (
    *("env.max_steps=12", "env.evaluation_episodes=1", "trainer.steps=72", "trainer.steps_per_round=24"),
    *("trainer.log_every=1", "replicas=2", "tracking=none"),
)
FEW = {
    "first_steps": 5,
    "steps": 5,
    "update_ratio": 0.1,
    "updates_per_step": 0.1,
    "batch": 8,
    "width": 8,
    "hidden": (8,),
}
# every id, every feedback and every generic kind of agent once
DEFAULT = [
    *(("FrozenLake-v1", feedback, "reference") for feedback in ("episode_sum", "block_sum", "mean", "late")),
    *(("CartPole-v1", feedback, "delayed") for feedback in ("episode_sum", "success", "terminal")),
    *(("Pendulum-v1", feedback, "disagreement") for feedback in ("mean", "late")),
    *((name, "episode_sum", "oracle") for name in IDS if not name.startswith("Sepsis")),
    *(("Pendulum-v1", "late", method) for method in ("random", "adaptive_mse")),
]
EVERY = [
    (name, feedback, method)
    for name in IDS
    for feedback in FEEDBACKS
    for method in files.options("method")
    if (name, feedback, method) not in DEFAULT
]
AGENTS = {  # what is stopped: id, agent, method
    "planner": ("FrozenLake-v1", (), "reference"),
    "dqn": ("CartPole-v1", (), "delayed"),
    "sac": ("Pendulum-v1", (), "reference"),
    "ppo": ("CartPole-v1", ("agent=ppo",), "reference"),
    "td3": ("Pendulum-v1", ("agent=td3",), "delayed"),
    "discrete_sac": ("CartPole-v1", ("agent=discrete_sac",), "reference"),
}


def config_of(name: str, feedback: str, method: str, *words: str) -> dict[str, Any] | list[str]:
    """A checked configuration, or why there is none."""
    named = [] if FEEDBACKS[feedback] and FEEDBACKS[feedback][0].startswith("feedback=") else [f"feedback={feedback}"]
    typed = ["env=gymnasium", f"env.id={name}", *named, *FEEDBACKS[feedback], f"method={method}", *SHORT, *IDS[name]]
    config = registry.compose([*typed, *words])
    problems = job.check(config).problems
    return problems or job.checked(config)


def made(config: dict[str, Any]) -> Trainer:
    """Its trainer, started, with small parts."""
    trainer: Trainer = schema.build(config, "trainer")
    for part in (trainer.agent, *getattr(trainer.assigner, "models", ())):
        vars(part).update({key: value for key, value in FEW.items() if key in vars(part)})
    trainer.start((3, 4))
    return trainer


def went_well(config: dict[str, Any]) -> None:
    trainer, rows = made(config), list[tuple[int, dict[str, torch.Tensor]]]()
    trainer.run(lambda step, values: rows.append((step, values)))
    assert rows[-1][0] == 72
    for step, values in rows:  # a journal has one header
        assert list(values) == list(rows[0][1]), step
    for name, value in rows[-1][1].items():
        assert value.shape == (2,), name
    metric = trainer.judge.metric
    assert rows[-1][1][metric].isfinite().all(), metric
    assert len(trainer.store) > 0


@pytest.mark.parametrize(("name", "feedback", "method"), DEFAULT)
def test_two_rounds_go_well(name: str, feedback: str, method: str) -> None:
    config = config_of(name, feedback, method)
    assert isinstance(config, dict), config
    went_well(config)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "feedback", "method"), EVERY)
def test_every_combination_goes_well_or_says_why_not(name: str, feedback: str, method: str) -> None:
    config = config_of(name, feedback, method)
    if isinstance(config, dict):
        went_well(config)
    else:
        said = (" needs ", "written for", "is made for", "equal", "looks at")
        assert all(any(words in problem for words in said) for problem in config), config


@pytest.mark.parametrize("agent", AGENTS)
def test_a_run_goes_on_in_mid_episode_with_labels_under_way(agent: str, tmp_path: Path) -> None:
    name, words, method = AGENTS[agent]
    config = config_of(name, "late", method, *words, "feedback.missing=.2")
    assert isinstance(config, dict), config
    first, second = made(config), made(config)
    path = tmp_path / checkpoint.NAME

    def save() -> None:
        if first.collected == 24:
            checkpoint.save(path, {"trainer": first.state_dict()})

    whole, rest = list[Any](), list[Any]()
    first.run(lambda step, values: whole.append((step, values)), between=save)
    second.load_state_dict(checkpoint.load(path)["trainer"])
    second.run(lambda step, values: rest.append((step, values)))
    assert [step for step, _ in rest] == [48, 72]
    for (_, expected), (_, found) in zip(whole[1:], rest, strict=True):
        for key, value in expected.items():
            np.testing.assert_array_equal(value.numpy(), found[key].numpy(), err_msg=key)
    for column in ("states", "actions", "labels"):
        assert torch.equal(getattr(first.store.windows, column), getattr(second.store.windows, column))
