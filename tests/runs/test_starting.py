"""Runs that start from what was logged, from another run's steps, and from another run's agent."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
import yaml

import credit
from credit.config import schema
from credit.config.identity import identity
from credit.core.errors import UserError
from credit.core.state import same
from credit.runs import job, starting
from credit.runs.kept import AGENT, STEPS, begin_with, write_agent, write_steps
from credit.runs.policies import read
from credit.trainer import Trainer

SHORT = ("method=reference", "trainer.steps=140", "tracking=none")
ROLLING = ("trainer.steps=400", "trainer.steps_per_round=200", "replicas=2")
SMALL = ("reference.steps=5", "reference.first_steps=5", "agent.update_ratio=.01", "env.evaluation_episodes=1")
WORLDS = {  # what a run of each kind is composed of
    "advertiser": ("method=reference", "trainer.steps=70"),
    "sepsis": ("experiment=sepsis", "method=reference", "trainer.steps=100"),
    "FrozenLake": ("env=gymnasium", "env.id=FrozenLake-v1", "method=reference", *ROLLING),
    "CartPole": ("env=gymnasium", "env.id=CartPole-v1", "method=reference", *ROLLING, "feedback=block_sum", *SMALL),
    "Pendulum": ("env=gymnasium", "env.id=Pendulum-v1", "method=reference", *ROLLING, "trainer.random_steps=0", *SMALL),
}
SEEDS = (0, 1)
Composed = Callable[..., dict[str, Any]]


def made(config: Mapping[str, Any], seeds: tuple[int, ...] = SEEDS, between: Any = lambda: None) -> Trainer:
    """A trainer that has run."""
    trainer: Trainer = schema.build(config, "trainer")
    trainer.start(seeds)
    starting.given(config, trainer)
    starting.inherited(config, trainer)
    trainer.run(lambda step, values: None, between=between)
    return trainer


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """60 steps of the advertiser, with rewards."""
    numbers = np.random.default_rng(0)
    states = numbers.integers(0, 10, 61)
    columns = {"observation": states[:-1], "action": numbers.integers(0, 3, 60), "next_observation": states[1:]}
    file = tmp_path_factory.mktemp("log") / "log.csv"
    pd.DataFrame({**columns, "reward": numbers.normal(size=60)}).to_csv(file, index=False)
    return file


def rows(folder: Path) -> pd.DataFrame:
    return pd.read_csv(folder / "metrics.csv").drop(columns="time/seconds")


def test_neutral_keys_are_no_part_of_a_run(composed: Composed) -> None:
    config = composed("method=reference")
    bare = {key: value for key, value in config.items() if key not in ("demonstrations_from", "policy_from", "keep")}
    assert identity(bare) == identity(config) == identity({**config, "keep": ["steps"]})
    others = {identity({**config, key: "x"}) for key in ("demonstrations_from", "policy_from")}
    assert len(others | {identity(config)}) == 3


@pytest.mark.thorough
def test_what_was_logged_is_learned_from_first_and_not_judged(log: Path, tmp_path: Path) -> None:
    given = [*SHORT, "replicas=2", f"demonstrations_from={log}"]
    result = credit.run([*given, f"output={tmp_path}"])
    assert result.folders[0].parent.name.startswith("demonstrations_from=")
    first = rows(result.folders[0]).iloc[0]
    assert (first["step"], first["regret/cumulative"], first["return/label"]) == (0, 0, 0)
    assert first["reward/mse"] > 0
    arrays = credit.load(result.folders[1]).recovery
    assert arrays is not None
    assert arrays["windows/states"].shape == (8 + 20, 7)
    data = json.loads((result.folders[0] / "summary.json").read_text(encoding="utf-8"))["data"]
    assert len(data["logged"]) == 64
    plain = credit.run([*SHORT, "replicas=2", f"output={tmp_path}"])
    assert rows(plain.folders[0])["step"].min() > 0


def test_what_was_given_is_part_of_the_state(composed: Composed, log: Path) -> None:
    config = composed("method=disagreement", "trainer.steps=70")
    states = list[dict[str, Any]]()
    first: Trainer = schema.build(config, "trainer")
    first.start(SEEDS)
    starting.given({**config, "demonstrations_from": str(log)}, first)
    told: list[list[Any]] = [[], []]
    first.run(lambda step, values: told[0].append((step, values)), between=lambda: states.append(first.state_dict()))
    second: Trainer = schema.build(config, "trainer")
    second.start(SEEDS)  # and nothing is given
    second.load_state_dict(states[0])
    assert (second.collected, second.given, len(second.store)) == (0, 8, 8)
    second.run(lambda step, values: told[1].append((step, values)))
    assert same(told[0][1:], told[1])
    assert told[0][0][0] == 0
    assert told[0][0][1]["regret/cumulative"].tolist() == [0, 0]
    assert torch.equal(first.store.windows.labels, second.store.windows.labels)


@pytest.mark.thorough
def test_a_run_goes_on_to_the_bit(log: Path, tmp_path: Path, interrupt: Callable[..., None]) -> None:
    words = ["method=disagreement", "trainer.steps=140", "trainer.log_every=5", "replicas=2", "keep=[steps,agent]"]
    words += [f"demonstrations_from={log}"]
    whole = credit.run([*words, "tracking=none", f"output={tmp_path / 'whole'}"])
    interrupt(70, *words, f"output={tmp_path / 'half'}")
    gone_on = credit.run([*words, "tracking=none", f"output={tmp_path / 'half'}"])
    assert gone_on.resumed == [0, 1]
    for one, two in zip(whole.folders, gone_on.folders, strict=True):
        pd.testing.assert_frame_equal(rows(one), rows(two))
        pd.testing.assert_frame_equal(pd.read_parquet(one / STEPS), pd.read_parquet(two / STEPS))
        assert len(pd.read_parquet(one / STEPS)) == 140  # its own, without those that it was given
        assert same(read(one)["tables"], read(two)["tables"])
        with np.load(one / "recovery.npz") as first, np.load(two / "recovery.npz") as second:
            assert same(dict(first), dict(second))
    assert [(folder / AGENT).exists() for folder in gone_on.folders] == [True, False]


@pytest.mark.parametrize(
    "world",
    ["advertiser", *(pytest.param(name, marks=pytest.mark.thorough) for name in WORLDS if name != "advertiser")],
)
def test_steps_of_a_run_start_another_and_stay_what_they_are(world: str, composed: Composed, tmp_path: Path) -> None:
    config = composed(*WORLDS[world])
    first = made(config)
    write_steps(first, tmp_path, 1)
    second: Trainer = schema.build(config, "trainer")
    second.start((5, 6, 7))
    starting.given({**config, "demonstrations_from": str(tmp_path)}, second)
    told = list[dict[str, torch.Tensor]]()

    def stop() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        second.run(lambda step, values: told.append(values), between=stop)
    assert second.collected == 0
    assert len(told) == 1
    old, new = first.store.windows, second.store.windows
    count = int(old.ends[1, -1]) + 1
    lengths = old.lengths[1][old.lengths[1] > 0]
    for replica in range(3):
        for name in ("states", "next_states", "step", "terminated"):
            column = getattr(old, name)
            assert column is None or torch.equal(column[1, :count], getattr(new, name)[replica]), name
        if old.ended is not None and new.ended is not None:  # of the last episode nothing follows in the file
            assert new.ended[replica].tolist() == [*old.ended[1, : count - 1].tolist(), True]
        assert torch.equal(new.lengths[replica], lengths)
        assert torch.equal(new.labels[replica], old.labels[1, : len(lengths)])
        torch.testing.assert_close(new.actions[replica], old.actions[1, :count], rtol=0, atol=1e-6)
        assert new.labelled is None
    write_steps(second, tmp_path / "nothing", 0)  # it has taken none of its own
    assert not (tmp_path / "nothing").exists()


def test_windows_of_a_finite_run_will_do_without_its_steps(composed: Composed, tmp_path: Path) -> None:
    config = composed("method=reference", "trainer.steps=70")
    run = credit.run(["method=reference", "trainer.steps=70", "tracking=none", "replicas=1", f"output={tmp_path}"])
    trainer = made({**config, "demonstrations_from": str(run.folders[0])})
    arrays = credit.load(run.folders[0]).recovery
    assert arrays is not None
    assert (
        trainer.store.windows.grid(trainer.store.windows.states)[1, :10].tolist() == arrays["windows/states"].tolist()
    )
    assert trainer.store.windows.labels[0, :10].tolist() == arrays["windows/labels"].tolist()
    shutil.copytree(run.folders[0], tmp_path / "rolled")
    config = yaml.safe_load((tmp_path / "rolled" / "config.yaml").read_text(encoding="utf-8"))
    config["trainer"]["steps_per_round"] = 70  # windows may have been parts of anything
    (tmp_path / "rolled" / "config.yaml").write_text(yaml.safe_dump(config), encoding="utf-8")
    with pytest.raises(UserError, match="no steps were kept"):
        starting.given({**config, "demonstrations_from": str(tmp_path / "rolled")}, trainer)


def test_the_oracle_needs_rewards(composed: Composed, log: Path, tmp_path: Path) -> None:
    config = composed("method=oracle", "trainer.steps=70")
    trainer = made({**config, "demonstrations_from": str(log)})
    assert trainer.store.windows.primitive is not None
    learner = made({**composed("method=reference", "trainer.steps=70"), "demonstrations_from": str(log)})
    assert learner.store.windows.primitive is None
    write_steps(trainer, tmp_path, 0)
    assert "reward" not in pd.read_parquet(tmp_path / STEPS).columns
    with pytest.raises(UserError, match="demonstrations_from: a part of this method is shown the primitive reward"):
        starting.given({**config, "demonstrations_from": str(tmp_path)}, trainer)


AGENTS = {
    "planner": WORLDS["advertiser"],
    "q": ("method=delayed", "trainer.steps=70"),
    "block": ("method=block", "trainer.steps=70"),
    "sac": WORLDS["Pendulum"],
    "dqn": WORLDS["CartPole"],
    "td3": (
        "env=gymnasium",
        "env.id=Pendulum-v1",
        "agent=td3",
        "method=delayed",
        "agent.updates_per_step=.05",
        *ROLLING,
        "trainer.random_steps=0",
    ),
    "ppo": (
        "env=gymnasium",
        "env.id=CartPole-v1",
        "agent=ppo",
        "method=delayed",
        "agent.epochs=1",
        *ROLLING,
        "feedback=block_sum",
    ),
}


@pytest.mark.parametrize(
    "name",
    [
        "planner",
        "block",
        *(pytest.param(name, marks=pytest.mark.thorough) for name in ("q", "sac", "dqn", "td3", "ppo")),
    ],
)
def test_an_agent_goes_on_from_another_runs_with_random_numbers_of_its_own(
    name: str, composed: Composed, tmp_path: Path
) -> None:
    config = composed(*AGENTS[name])
    first = made(config)
    write_agent(first, tmp_path)
    fresh, second = (schema.build(config, "trainer") for _ in range(2))
    for trainer in (fresh, second):
        trainer.start((5, 6))
    begin_with(str(tmp_path), second.agent, second.problem)
    states = first.store.windows.states[:, :20]
    step = torch.zeros(states.shape[:2], dtype=torch.int64)

    def done(trainer: Trainer) -> torch.Tensor:
        return trainer.agent.policies()["behaviour"].act(states, step)

    assert torch.equal(done(second), done(first))
    for key in ("_stream", "_noise"):  # of random numbers
        if hasattr(second.agent, key):
            assert same(getattr(second.agent, key).state_dict(), getattr(fresh.agent, key).state_dict())
    second.run(lambda step, values: None)


@pytest.mark.parametrize(
    ("words", "seeds", "said"),
    [
        (("method=reference",), (0,), "seeds side by side 2, and this run has 1; set replicas"),
        (("method=delayed",), SEEDS, "an agent value_iteration, and this run has q_learning"),
        (("method=reference", "env.states=6"), SEEDS, r"observations Discrete\(10\), and this run has Discrete\(6\)"),
    ],
)
def test_another_agent_is_refused(
    words: tuple[str, ...], seeds: tuple[int, ...], said: str, composed: Composed, tmp_path: Path
) -> None:
    first = made(composed("method=reference", "trainer.steps=70"))
    (tmp_path / "seed-0").mkdir()
    write_agent(first, tmp_path / "seed-0")
    config = composed(*words, "trainer.steps=70")
    for place in (tmp_path, tmp_path / "seed-0", tmp_path / "seed-1"):  # one file serves all seeds
        with pytest.raises(UserError, match=said):
            made({**config, "policy_from": str(place)}, seeds)
    with pytest.raises(UserError, match=r"no agent.pt lies there; compute that run with keep=\[agent\]"):
        made({**config, "policy_from": str(tmp_path / "none")}, seeds)


@pytest.mark.thorough
def test_networks_of_other_sizes_are_refused(composed: Composed, tmp_path: Path) -> None:
    write_agent(made(composed(*WORLDS["Pendulum"])), tmp_path)
    other = schema.build(composed(*WORLDS["Pendulum"], "agent.width=32"), "trainer")
    other.start(SEEDS)
    with pytest.raises(UserError, match=r"agent\.actor.* has the shape .* give agent.… the same sizes"):
        begin_with(str(tmp_path), other.agent, other.problem)


def test_the_check_says_what_does_not_fit(composed: Composed, log: Path, tmp_path: Path) -> None:
    config = composed("method=reference", "trainer.steps=70", "env.states=6")
    assert job.check(config).problems == []
    (wrong,) = job.check({**config, "demonstrations_from": str(log)}).problems
    assert wrong.startswith(f"demonstrations_from: {log}: observation of row")
    (wrong,) = job.check({**config, "policy_from": str(tmp_path)}).problems
    assert "no agent.pt lies there" in wrong
