"""Runs on a maze: demonstrations first, rounds of whole trajectories, random actions, and what is left behind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

import credit
from credit.agents.random import Random
from credit.agents.sac.agent import SAC
from credit.core.belief import Estimate
from credit.core.errors import RunError, UserError
from credit.core.problem import Problem
from credit.core.seams import Agent, CreditAssigner, Places, RewardModel
from credit.core.steps import Steps
from credit.core.store import Store
from credit.envs.feedback import Success
from credit.envs.pointmaze.environment import PointMaze
from credit.recovery.bonuses import Disagreement
from credit.recovery.mixers import RelativeMSE
from credit.recovery.models.primitive import PrimitiveReward
from credit.recovery.recovery import Recovery
from credit.rivals.rules import Delayed
from credit.runs.artifacts import Recorder
from credit.trainer import Trainer

H = 40
Journal = list[tuple[int, dict[str, Tensor]]]


def maze(**keys: Any) -> PointMaze:
    """Two free cells in a row, which take about 15 steps, and three demonstrations of a seed."""
    small: dict[str, Any] = {"maze": ["1111", "1001", "1111"], "start": [1, 1], "goal": [1, 2]}
    few = {"successes": 2, "partials": 0, "failures": 1, "evaluation_episodes": 2}
    return PointMaze(**(small | few | keys))


def tiny() -> SAC:
    return SAC(width=8, updates=4, first_updates=6, batch=8, n_step=2)


def trainer_of(
    seeds: tuple[int, ...] = (0,),
    assigner: CreditAssigner | None = None,
    agent: Agent | None = None,
    env: PointMaze | None = None,
    **keys: Any,
) -> Trainer:
    plan = {"steps": 4 * H, "windows_per_round": 2, "log_every": 2} | keys
    trainer = Trainer(env or maze(), Success(H), assigner or Delayed(), agent or tiny(), **plan)
    trainer.start(seeds)
    return trainer


def run(trainer: Trainer) -> Journal:
    journal: Journal = []
    trainer.run(lambda step, values: journal.append((step, values)))
    return journal


def same(mine: dict[str, Tensor], theirs: dict[str, Tensor]) -> None:
    """To the last bit."""
    torch.testing.assert_close(mine, theirs, rtol=0, atol=0, equal_nan=True)


class Line(RewardModel):
    """slope·x, with variance 1."""

    def __init__(self, name: str, slope: float) -> None:
        self.name, self._slope = name, slope

    def start(self, problem: Problem, places: Places) -> None:
        self._look = places.look(lambda steps: steps.states)

    def observe(self, store: Store) -> None: ...

    def estimate(self, at: Tensor | None = None) -> Estimate:
        mean = self._slope * self._look.places(at)[..., 0]
        return Estimate(mean, torch.ones_like(mean))

    def believe(self, steps: Steps) -> Estimate:
        mean = (self._slope * steps.states[:, 0]).expand(2, -1)
        return Estimate(mean, torch.ones_like(mean))


def lines() -> Recovery:
    return Recovery(Line("steep", 2.0), {"flat": Line("flat", 0.5)}, RelativeMSE(), {"gap": Disagreement(1.0, None)})


class Watched(Random):
    """Random actions; notes what it does, and how much there was to learn from."""

    def __init__(self) -> None:
        self.did: list[str] = []

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        if not step.any():
            self.did.append("collect")
        return super().act(states, step)

    def improve(self, store: Store, assigner: CreditAssigner) -> None:
        self.did.append(f"learn from {store.new.labels.shape[1]} new of {len(store)}")


def test_demonstrations_are_learned_from_before_the_first_round() -> None:
    watched = Watched()
    trainer, told = trainer_of((0, 1), agent=watched), list[int]()
    journal: Journal = []
    trainer.run(lambda step, values: journal.append((step, values)), told.append)
    assert watched.did == [
        "learn from 3 new of 3",
        "collect",
        "learn from 2 new of 5",
        "collect",
        "learn from 2 new of 7",
    ]
    assert [step for step, _ in journal] == [0, 2 * H, 4 * H]
    assert told == [2 * H, 4 * H, 4 * H]
    assert (trainer.collected, len(trainer.store)) == (4, 7)
    start = {name: value.tolist() for name, value in journal[0][1].items() if value.isfinite().all()}
    assert start["collect/steps"] == [0, 0]
    assert "eval/success" in start
    assert "eval/auc" not in start  # not a round
    assert "return/label" not in start
    labels = trainer.store.windows.labels
    assert labels[:, :3].tolist() == [[1, 1, 0]] * 2
    assert torch.equal(journal[1][1]["return/label"], labels[:, 3:5].mean(1))  # demonstrations do not count
    assert torch.equal(journal[2][1]["return/label"], labels[:, 5:].mean(1))


def test_without_demonstrations_a_run_starts_with_a_round() -> None:
    watched = Watched()
    journal = run(trainer_of(agent=watched, env=maze(successes=0, failures=0)))
    assert watched.did[:2] == ["collect", "learn from 2 new of 2"]
    assert [step for step, _ in journal] == [2 * H, 4 * H]


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"steps": 4 * H + 7}, rf"trainer\.steps={4 * H + 7}: trajectories cannot be cut short; .* like {4 * H}$"),
        ({"steps": H - 1}, rf"trainer\.steps={H - 1}: shorter than one window \(feedback\.window={H}\)"),
        ({"windows_per_round": 5}, r"trainer\.windows_per_round=5: more than the 4 windows"),
        ({"env": maze(start=(0, 0))}, r"start=\(0, 0\) is a wall .* free cells are row 1: 1 2"),
        ({"env": maze(successes=0, one_sided="stop")}, r"env\.one_sided=stop: 1 demonstrations, 0 of them successful"),
    ],
)
def test_what_cannot_be_run_is_refused_before_it_starts(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=message):
        trainer_of(**keys)


@pytest.mark.parametrize("make", [Delayed, lines], ids=["delayed", "recovery"])
def test_a_run_is_the_same_again_and_a_replica_goes_alone_as_in_a_batch(make: Callable[[], CreditAssigner]) -> None:
    seeds = (5, 6)
    batch, again = (trainer_of(seeds, make()) for _ in range(2))
    journal = run(batch)
    whole = batch.store.windows
    for (_, mine), (_, theirs) in zip(journal, run(again), strict=True):
        same(mine, theirs)
    for r, seed in enumerate(seeds):
        alone = trainer_of((seed,), make())
        for (_, single), (_, together) in zip(run(alone), journal, strict=True):
            for name in single:
                torch.testing.assert_close(single[name][0], together[name][r], rtol=1e-4, atol=1e-6, equal_nan=True)
        mine = alone.store.windows
        for name in ("states", "actions", "next_states"):
            count = len(mine)
            torch.testing.assert_close(getattr(mine, name)[0], getattr(whole, name)[r, :count], rtol=1e-4, atol=1e-5)
        assert torch.equal(mine.labels[0], whole.labels[r])
        assert torch.equal(mine.ends[0], whole.ends[r])
    assert not torch.equal(*(whole.states[r, whole.ends[r, 2] + 1 :][:9] for r in range(2)))


def test_only_who_declares_it_is_shown_primitive_rewards() -> None:
    trainer = trainer_of((0, 1), Recovery(PrimitiveReward("oracle"), {}, RelativeMSE(), {}))
    run(trainer)
    windows = trainer.store.windows
    assert windows.primitive is not None
    assert torch.equal(windows.sums(windows.primitive), windows.labels)  # demonstrations and all
    assert torch.equal(trainer.assigner.rewards(windows), windows.primitive.float())
    for assigner in (Delayed(), lines()):
        trainer = trainer_of((0, 1), assigner)
        run(trainer)
        assert trainer.store.windows.primitive is None


def test_a_network_that_is_no_number_stops_the_run_and_says_when() -> None:
    trainer = trainer_of((7, 8))

    def spoil(step: int, values: dict[str, Tensor]) -> None:
        if step == 2 * H:
            trainer.agent.actor.blocks[0][1].fill_(torch.nan)  # type: ignore[attr-defined]

    trainer.agent.act = lambda states, step: torch.zeros(*states.shape[:2], 2)  # type: ignore[method-assign]
    trainer.judge.measure = lambda policies, belief: {}  # type: ignore[method-assign]
    with pytest.raises(RunError, match="round 2: SAC: a weight of the actor of seed 8 is not finite"):
        trainer.run(spoil)


def test_random_windows_come_first() -> None:
    watched = Watched()
    run(trainer_of(agent=watched, random_windows=2))
    assert watched.did.count("collect") == 1  # the other round was another's


def test_random_actions_are_uniform_and_of_each_replica(make_continuous: Callable[..., Problem]) -> None:
    def actions(seeds: tuple[int, ...], copies: int, rounds: int = 3, which: str = "act") -> Tensor:
        random = Random()
        random.start(make_continuous(seeds, 100))
        one = random if which == "act" else random.policies()["behaviour"]
        states, ticks = torch.zeros(len(seeds), copies, 4), torch.ones(len(seeds), copies, dtype=torch.int64)
        found = [torch.stack([one.act(states, step * ticks) for step in range(100)]) for _ in range(rounds)]
        return torch.stack(found)  # [rounds, steps, R, copies, A]

    batch = actions((4, 5, 6), 8)
    assert batch.shape == (3, 100, 3, 8, 2)
    assert batch.dtype == torch.float32
    flat = batch.flatten()  # 14,400 numbers: the standard error of a share is at most .0042
    assert flat.abs().max() <= 1
    shares = torch.histc(flat, 4, -1, 1) / len(flat)
    assert (shares - 0.25).abs().max() < 0.02
    assert len(flat.unique()) > 0.99 * len(flat)
    for r, seed in enumerate((4, 5, 6)):
        assert torch.equal(actions((seed,), 8)[:, :, 0], batch[:, :, r])
    assert not torch.equal(batch, actions((4, 5, 6), 8, which="evaluation"))


def test_random_actions_of_a_round_do_not_depend_on_how_long_the_last_one_took(
    make_continuous: Callable[..., Problem],
) -> None:
    def second(steps: int) -> Tensor:
        random = Random()
        random.start(replace(make_continuous((4, 5)), even=False))  # as where trajectories end early
        states, ticks = torch.zeros(2, 2, 4), torch.ones(2, 2, dtype=torch.int64)
        for step in range(steps):
            random.act(states, step * ticks)
        return random.act(states, 0 * ticks)

    assert torch.equal(second(1), second(9))


def test_evaluating_random_actions_does_not_change_what_is_collected() -> None:
    often, seldom = (trainer_of((3,), agent=Random(), log_every=every) for every in (2, 4))
    run(often)
    run(seldom)
    assert torch.equal(often.store.windows.states, seldom.store.windows.states)


def test_arrays_of_a_run() -> None:
    trainer = trainer_of((0, 1), lines())
    recorder = Recorder(trainer)
    trainer.run(lambda step, values: recorder.note(step))
    windows, grid = trainer.store.windows, trainer.env.grid()
    for replica in range(2):
        files = recorder.files(replica)
        assert files.keys() == {"recovery.npz", "trajectories.npz"}
        found, x = files["recovery.npz"], grid.states[:, 0].numpy()
        assert found["models"].tolist() == ["steep", "flat"]
        assert found["rounds"].tolist() == [0, 2, 4]
        assert found["grid/states"].shape == (32, 4)
        for name in (
            "reward/mixed",
            "reward/plan",
            "best",
            "mse/flat",
            "weight/steep",
            "disagreement/flat",
            "bonus/gap",
        ):
            assert found[name].shape == (3, 32), name
        assert "disagreement/steep" not in found
        assert found["reward/steep"] == pytest.approx(np.tile(2 * x, (3, 1)))
        assert found["disagreement/flat"] == pytest.approx(np.tile((1.5 * x) ** 2, (3, 1)))
        assert found["reward/plan"] == pytest.approx(found["reward/mixed"] + found["bonus/gap"])
        where = files["trajectories.npz"]
        assert where["online/labels"].tolist() == windows.labels[replica, 3:].tolist()
        assert where["online/lengths"].tolist() == windows.lengths[replica, 3:].tolist()
        mine = slice(int(windows.ends[replica, 2]) + 1, int(windows.ends[replica, -1]) + 1)
        assert np.array_equal(where["online/states"], windows.states[replica, mine].numpy())
        assert {"maze/walls", "demonstrations/states", "evaluation/states"} <= where.keys()


def test_methods_that_recover_nothing_leave_trajectories_alone() -> None:
    trainer = trainer_of()
    recorder = Recorder(trainer)
    trainer.run(lambda step, values: recorder.note(step))
    assert recorder.files(0).keys() == {"trajectories.npz"}


def test_a_run_leaves_a_folder_that_can_be_loaded(tmp_path: Path) -> None:
    short = ["trainer.steps=600", "trainer.windows_per_round=1", "trainer.log_every=1", "env.evaluation_episodes=2"]
    tiny = ["agent.first_updates=5", "agent.updates=5", "reference.first_steps=5", "reference.steps=5"]
    words = ["experiment=pointmaze", "method=disagreement", "replicas=2", "tracking=none", f"output={tmp_path}"]
    result = credit.run([*words, *short, *tiny])
    assert result.status == "FINISHED", result.error
    first, second = (credit.load(folder) for folder in result.folders)
    assert first.metrics.index.tolist() == [0, 300, 600]
    assert first.metrics["eval/auc"].isna().tolist() == [True, False, False]
    assert first.recovery is not None
    assert first.recovery["rounds"].tolist() == [0, 1, 2]
    assert first.recovery["reward/plan"].shape == (3, len(first.recovery["grid/states"]))
    assert first.trajectories is not None
    assert first.trajectories["online/lengths"].shape == (2,)
    digests = [run.summary["data"]["demonstrations"] for run in (first, second)]
    assert all(len(digest) == 64 for digest in digests)
    assert digests[0] != digests[1]
