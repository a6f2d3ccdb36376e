"""Every finished run keeps its policy: small, one file a seed, and it acts as it did."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
import torch
from torch import Tensor

import credit
from credit.agents.q_learning import QLearning
from credit.config import classes, schema
from credit.core.errors import UserError
from credit.core.policy import Policy, TablePolicy
from credit.runs import checkpoint, policies
from credit.runs.policies import POLICY, Kept, KeptPolicy, read
from credit.trainer import Trainer
from tests.runs.test_starting import AGENTS, SEEDS, made

Composed = Callable[..., dict[str, Any]]


def kept(trainer: Trainer, config: dict[str, Any], folder: Path) -> dict[int, Path]:
    """The folders of all seeds, with what was kept."""
    places = {replica: folder / f"seed-{seed}" for replica, seed in enumerate(trainer.problem.seeds)}
    for place in places.values():
        place.mkdir(parents=True)
    assert policies.write(trainer, config, places) == ""
    return places


@pytest.mark.parametrize(
    "name",
    [
        "planner",
        "block",
        "dqn",
        *(pytest.param(name, marks=pytest.mark.thorough) for name in ("q", "sac", "td3", "ppo")),
    ],
)
def test_each_seed_acts_as_it_did_among_others(name: str, composed: Composed, tmp_path: Path) -> None:
    config = composed(*AGENTS[name])
    trainer = made(config)
    states = trainer.store.windows.states[:, :20]
    steps = torch.zeros(states.shape[:2], dtype=torch.int64)
    for replica, place in kept(trainer, config, tmp_path).items():
        content = torch.load(place / POLICY, weights_only=True)
        assert content["seed"] == SEEDS[replica]
        assert content["config"]["agent"] == config["agent"]
        again = Kept(read(place), place / POLICY)
        assert {*again.policies} <= {*trainer.agent.policies()}
        for policy, own in again.policies.items():
            was = trainer.agent.policies()[policy].act(states, steps)[replica : replica + 1]
            now = own.act(states[replica : replica + 1], steps[:1])
            torch.testing.assert_close(now, was, rtol=0, atol=1e-6)


def test_nothing_that_is_remembered_is_kept(composed: Composed, tmp_path: Path) -> None:
    config = composed(*AGENTS["dqn"])
    place = kept(made(config), config, tmp_path)[0]
    weights = 4 * sum(part.numel() for part in tensors(read(place)["state"]))
    assert {*read(place)["state"]} == {"_online"}
    assert weights < (place / POLICY).stat().st_size < weights + 12_000


def tensors(value: Any) -> list[Tensor]:
    if isinstance(value, Tensor):
        return [value]
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, (list, tuple)) else ()
    return [part for each in inner for part in tensors(each)]


class Own(QLearning):
    """A stranger's: a policy that is no table, and nothing said of what acts."""

    acts: ClassVar = None

    def policies(self) -> dict[str, Policy]:
        return {"behaviour": Follows(self)}


class Follows(Policy):
    def __init__(self, agent: QLearning) -> None:
        self._agent = agent

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        return TablePolicy(self._agent._q.argmax(-1), 3).act(states, step)


class Mixed(Own):
    """One whose state says nothing of replicas."""

    keeps: ClassVar = (*QLearning.keeps, "_sum")

    def start(self, problem: Any) -> None:
        super().start(problem)
        self._sum = torch.zeros(2 * problem.replicas + 1)


@pytest.mark.parametrize(
    ("agent", "reason"),
    [(Own, ""), (Mixed, r"Mixed has a state from which no seed's own part .* the agent\._sum has the shape \[5\]")],
)
def test_agents_of_strangers(agent: type, reason: str, composed: Composed, tmp_path: Path) -> None:
    config = composed(*AGENTS["q"])
    config = {**config, "agent": {**config["agent"], "_target_": f"{__name__}.{agent.__name__}"}}
    schema_of = classes.resolve
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            schema, "resolve", lambda path, node: agent if path.endswith(agent.__name__) else schema_of(path, node)
        )
        trainer: Trainer = schema.build(config, "trainer")
        trainer.start(SEEDS)
        trainer.run(lambda step, values: None)
        places = {replica: tmp_path / f"seed-{seed}" for replica, seed in enumerate(SEEDS)}
        for place in places.values():
            place.mkdir()
        why = policies.write(trainer, config, places)
        if reason:
            assert re.search(reason, why)
            assert not [*tmp_path.glob(f"*/{POLICY}")]
            return
        assert why == ""
        for replica, place in places.items():
            found = KeptPolicy(Kept(read(place), place / POLICY))
            assert [found(state) for state in range(10)] == trainer.agent._q[replica].argmax(-1).tolist()


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two seeds of the advertiser, finished."""
    output = tmp_path_factory.mktemp("runs")
    return credit.run(
        ["method=reference", "trainer.steps=140", "replicas=2", "tracking=none", f"output='{output}'"]
    ).folders


def test_a_runs_policy_in_the_environments_own_spaces(runs: list[Path]) -> None:
    run = credit.load(runs[1])
    assert run.recovery is not None
    assert [run.policy(state) for state in range(10)] == run.recovery["policy"].tolist()
    assert run.policy(np.int64(3)) in (0, 1, 2)
    assert repr(run.policy) == "KeptPolicy(seed-1, behaviour: 10 states → 3 actions)"
    assert repr(run).startswith("Run(advertiser/reference/trainer.steps=140/seed-1: 140 steps, regret/cumulative=")
    assert len(repr(run)) < 120
    for wrong in (10, -1, 0.5, [1, 2]):
        with pytest.raises(UserError, match=r"here it must be of Discrete\(10\)"):
            run.policy(wrong)
    for nothing in ("x", None, [[1], [1, 2]], {"a": 1}, (1, 2), object(), 1j):
        with pytest.raises(UserError, match=r"observation.*must be of Discrete\(10\)"):
            run.policy(nothing)


@pytest.mark.thorough
def test_vectors_in_and_out(composed: Composed, tmp_path: Path) -> None:
    config = composed(*AGENTS["sac"])
    place = kept(made(config), config, tmp_path)[0]
    policy = KeptPolicy(Kept(read(place), place / POLICY), "averaged")
    action = policy(np.array([1.0, 0.0, 0.0], dtype=np.float32), step=3)
    assert action.shape == (1,)
    assert action.dtype == np.float32
    assert abs(action[0]) <= 2  # Pendulum's own bound
    with pytest.raises(UserError, match=r"observation has the shape \[2\]"):
        policy([1.0, 0.0])


def test_who_has_none_is_told_why(runs: list[Path], tmp_path: Path) -> None:
    def said(folder: Path) -> str:
        with pytest.raises(UserError) as error:
            read(folder)
        return str(error.value)

    assert "there is no such folder" in said(tmp_path / "none")
    assert "no run lies here" in said(tmp_path)
    place = tmp_path / "seed-0"
    place.mkdir()
    (place / "config.yaml").touch()
    assert "the run is not finished" in said(place)
    (place / "DONE").touch()
    (place / "summary.json").write_text("{}", encoding="utf-8")
    assert "of an older version of credit" in said(place)
    (place / "summary.json").write_text('{"policy": "Mine has no …"}', encoding="utf-8")
    assert "no policy was kept: Mine has no …" in said(place)
    checkpoint.save(place / POLICY, {"seed": 0})
    assert "no policy of this version" in said(place)
    whole = (runs[0] / POLICY).read_bytes()
    (place / POLICY).write_bytes(whole[:900] + b"x" + whole[901:])
    assert "damaged" in said(place)


def test_another_environments_spaces(runs: list[Path]) -> None:
    content = read(runs[0])
    other = {**content["config"], "env": {**content["config"]["env"], "states": 6}}
    with pytest.raises(UserError, match=r"with observations Discrete\(10\), and the environment has Discrete\(6\)"):
        Kept(content, runs[0] / POLICY, other)
    with pytest.raises(UserError, match=r"policy=best: no such policy .* it has behaviour"):
        Kept(content, runs[0] / POLICY).named("best")
