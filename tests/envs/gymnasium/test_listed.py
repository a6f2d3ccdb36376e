"""What environments show of their P: ICU-Sepsis's tables, and its published values before anything is learned."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from credit.envs.gymnasium.environment import Gymnasium
from credit.envs.gymnasium.listed import Listed


def patient(**keys: object) -> SimpleNamespace:
    """Two states and two ends, one of which gives 1, in the form of ICU-Sepsis's tables."""
    transition, reward = np.zeros((4, 2, 4)), np.zeros((4, 2, 4))
    transition[0, 0, [1, 2]], transition[0, 1, [2, 3]] = 0.5, (0.8, 0.2)
    transition[1, :, 2], transition[2:, :, 3] = 1, 1
    reward[:, :, 2] = 1
    dynamics = {"tx_mat": transition, "r_mat": reward, "d_0": np.array([1.0, 0, 0, 0]), "admissible_actions": []}
    return SimpleNamespace(dynamics=dynamics, **keys)


def test_tables_are_read() -> None:
    listed = Listed.of(patient())
    assert listed is not None
    assert listed.reward.tolist() == [[0.5, 0.8], [1, 1], [0, 0], [0, 0]]
    assert listed.truth(1).best == pytest.approx(0.8)
    assert listed.truth(2).best == pytest.approx(1.0)
    assert listed.truth(9).random == pytest.approx((1.0 + 0.8) / 2)


def test_a_table_that_is_not_what_happens_is_left_alone() -> None:
    assert Listed.of(patient(_inadmissible_action_strategy="mean")) is not None
    assert Listed.of(patient(_inadmissible_action_strategy="terminate")) is None
    assert Listed.of(SimpleNamespace(dynamics={"tx_mat": None})) is None
    assert Listed.of(SimpleNamespace()) is None


@pytest.mark.slow
def test_icu_sepsis_has_its_published_values() -> None:
    """Random .78 and optimal .88 (Choudhary et al. 2024, table 1; here .7801 and .8751)."""
    pytest.importorskip("icu_sepsis")
    env = Gymnasium("Sepsis/ICU-Sepsis-v2")
    problem = env.problem(None, (0,))
    assert (problem.states, problem.actions, problem.window) == (716, 25, 500)
    env.start(problem)
    truth = env.truth("sum", problem.window)
    assert truth is not None
    assert truth.random == pytest.approx(0.78, abs=0.005)
    assert truth.best == pytest.approx(0.88, abs=0.005)
    expert = torch.from_numpy(env._one.unwrapped.expert_policy).expand(1, 500, -1, -1)  # type: ignore[attr-defined]
    assert float(truth.evaluate(expert)) == pytest.approx(0.78, abs=0.005)
    assert Gymnasium("Sepsis/ICU-Sepsis-v2", {"inadmissible_action_strategy": "terminate"})._one is not None
