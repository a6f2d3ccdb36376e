"""An environment of one's own runs with whatever can take its spaces, and others say why they cannot."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
import pytest
import torch
from torch import Tensor

from credit.agents.finite_horizon import FiniteHorizon
from credit.agents.q_learning import QLearning
from credit.agents.random import Random
from credit.agents.sac.agent import SAC
from credit.core.errors import UserError
from credit.core.seams import Agent, Feedback
from credit.envs.feedback import BlockSum, Success
from credit.planning.counts import Counts
from credit.recovery.bonuses import Count
from credit.recovery.features.tabular import Identity
from credit.recovery.mixers import RelativeMSE
from credit.recovery.models.linear import LinearModel
from credit.recovery.recovery import Recovery
from credit.recovery.uncertainty.bootstrap import Bootstrap
from credit.rivals.rules import Delayed
from credit.runs.artifacts import Recorder
from credit.trainer import Trainer

from .outside import Corridor, Shelves

Journal = list[tuple[int, dict[str, torch.Tensor]]]
ROUNDS = {"steps": 96, "windows_per_round": 2, "log_every": 2}


def sac() -> SAC:
    return SAC(width=8, batch=8, updates=4, first_updates=4, success_share=0)


class Rounded(BlockSum):
    """Some of its labels look like bits."""

    def __call__(self, rewards: Tensor) -> Tensor:
        return super().__call__(rewards).sign()


class Judged(BlockSum):
    """A verdict on a sum."""

    kind: ClassVar = "bits"

    def __call__(self, rewards: Tensor) -> Tensor:
        return (super().__call__(rewards) > 1).double()


def started(env: Shelves, agent: Agent, feedback: Feedback) -> Trainer:
    trainer = Trainer(env, feedback, Delayed(), agent, **ROUNDS)
    trainer.start((3, 4))
    return trainer


def trained(env: Shelves, agent: Agent, feedback: Feedback | None = None) -> tuple[Trainer, Journal]:
    journal: Journal = []
    trainer = started(env, agent, feedback or BlockSum(12, 0.1))
    trainer.run(lambda step, values: journal.append((step, values)))
    return trainer, journal


@pytest.mark.parametrize(("view", "agent"), [("auto", Random), ("vector", Random), ("auto", sac), ("vector", sac)])
def test_agents_that_can_take_its_spaces_run(view: str, agent: Callable[[], Agent]) -> None:
    trainer, journal = trained(Shelves(view), agent())  # type: ignore[arg-type]
    assert [step for step, _ in journal] == [24, 48, 72, 96]
    windows = trainer.store.windows
    assert windows.labels.shape == (2, 8)
    assert windows.states.shape[2:] == (() if view == "auto" else (7,))
    assert windows.actions.shape[2:] == (1,)
    assert len(windows.actions[0].unique()) > 5
    assert windows.actions.dtype == torch.float32
    for _, values in journal:
        assert {"eval/return", "eval/length", "eval/auc", "eval/final", "collect/steps"} <= values.keys()
        assert "eval/success" not in values
        assert all(value.shape == (2,) for value in values.values())
    assert torch.equal(journal[-1][1]["collect/steps"].long(), windows.lengths.sum(1))


def test_a_finite_environment_whose_truth_nobody_knows_runs_and_leaves_its_arrays() -> None:
    bootstrap = Bootstrap(4)
    model = LinearModel("linear", Identity(), bootstrap)
    recovery = Recovery(model, {}, RelativeMSE(), {"count": Count()})
    trainer = Trainer(Corridor(), BlockSum(12, 0.1), recovery, FiniteHorizon(Counts()), **ROUNDS)
    trainer.start((3, 4))
    recorder = Recorder(trainer)
    trainer.run(lambda step, values: None)
    arrays = recorder.files(1)["recovery.npz"]
    windows = trainer.store.windows
    lengths = windows.lengths[1].tolist()
    assert len(set(lengths)) > 1
    assert np.isnan(arrays["reward/true"]).all()
    for name in ("states", "actions", "next_states"):
        found, rows = arrays[f"windows/{name}"], getattr(windows, name)[1]
        assert found[found >= 0].tolist() == rows[: sum(lengths)].tolist()
        assert (found >= 0).sum(1).tolist() == lengths


def test_random_numbers_are_judged_by_rollouts() -> None:
    journal: Journal = []
    trainer = Trainer(Corridor(), BlockSum(12, 0.1), Delayed(), Random(), **ROUNDS)
    trainer.start((3, 4))
    trainer.run(lambda step, values: journal.append((step, values)))
    assert (journal[-1][1]["eval/return"] <= 1).all()
    assert journal[-1][1]["eval/length"].min() >= 3


def test_success_is_judged_where_it_is_the_label() -> None:
    _, journal = trained(Shelves("vector"), Random(), Success(12))
    assert {"eval/success", "eval/learned", "eval/lost"} <= journal[-1][1].keys()


def test_successes_are_preferred_where_labels_are_declared_to_be_bits_alone() -> None:
    keys: dict[str, Any] = {"width": 8, "batch": 8, "updates": 1, "first_updates": 1}
    for feedback in (BlockSum(12), Rounded(12)):
        with pytest.raises(UserError, match=r"agent\.prefer=success.*real numbers.*agent\.prefer=top"):
            started(Shelves("vector"), SAC(**keys), feedback)
    for feedback, prefer in ((Success(12), "success"), (Judged(12), "success"), (BlockSum(12), "top")):
        started(Shelves("vector"), SAC(prefer=prefer, **keys), feedback)  # type: ignore[arg-type]
    started(Shelves("vector"), SAC(success_share=0, **keys), BlockSum(12))  # nothing is preferred


def test_agents_that_cannot_say_why() -> None:
    with pytest.raises(UserError, match=r"QLearning needs .*actions that are numbers.*here they are vectors"):
        trained(Shelves(), QLearning())
