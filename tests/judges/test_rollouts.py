"""What a policy is worth: rounds by hand, episodes of its own with noise of their own."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from credit.core.continuous import StepBelief
from credit.core.interfaces import Act
from credit.core.trajectories import ContinuousProblem
from credit.envs.pointmaze.oracle import MazeOracle, of_rounds
from credit.envs.pointmaze.rounds import Round
from torch import Tensor

from credit.agents.random import Random
from credit.envs.feedback import Success
from credit.envs.pointmaze.environment import PointMaze


def tensor(values: Any) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


def test_rounds_by_hand() -> None:
    # five rounds of three seeds: one learns and loses it twice, one never gets there, one has it from the start
    success = tensor([[0.0, 0.2, 0.9], [0.9, 0.85, 1.0], [0.55, 0.3, 0.6], [0.6, 0.5, 0.65], [0.1, 0.89, 1.0]])
    found = of_rounds(success)
    assert found["auc"].tolist() == pytest.approx([2.15 / 5, 2.74 / 5, 4.15 / 5])
    assert found["final"].tolist() == pytest.approx([2.15 / 4, 2.54 / 4, 3.25 / 4])
    assert found["learned"].tolist() == [3, 0, 4]  # rounds after the first with .9, which is not one of them
    assert found["lost"].tolist() == [2, 0, 0]  # .55 and .1; .6 is not below .6
    assert all(value.dtype == torch.float64 for value in found.values())


def test_few_rounds_by_hand() -> None:
    found = of_rounds(tensor([[1.0, 0.5]]))
    assert {name: value.tolist() for name, value in found.items()} == {
        "auc": [1, 0.5],
        "final": [1, 0.5],
        "learned": [0, 0],
        "lost": [0, 0],
    }
    eighteen = tensor([[18 / 20], [0.1]])  # 18 of 20 is .9, however it is rounded
    assert of_rounds(eighteen)["learned"].tolist() == of_rounds(eighteen.float())["learned"].tolist() == [1]


class Judge:
    """Evaluations that were written down before: success and length of each policy, round by round [R, K]."""

    def __init__(self, found: dict[str, list[tuple[list[list[int]], list[list[int]]]]]) -> None:
        self._found = found
        self.asked: list[str] = []

    def __call__(self, name: str, act: Act) -> Round:
        self.asked.append(name)
        success, lengths = self._found[name].pop(0)
        none = torch.zeros(0)
        return Round(None, none, none, torch.tensor(lengths), torch.tensor(success).bool(), none)  # type: ignore[arg-type]


def no_act(states: Tensor, step: int) -> Tensor:
    raise AssertionError("the judge does not act")


def test_metrics_by_hand() -> None:
    problem = ContinuousProblem(4, 2, 50, (0, 1), torch.device("cpu"))
    judge = Judge(
        {
            "behaviour": [
                ([[0, 0], [0, 1]], [[50, 50], [50, 20]]),
                ([[1, 1], [0, 1]], [[30, 32], [50, 20]]),
                ([[0, 0], [1, 1]], [[50, 50], [10, 20]]),
            ],
            "averaged": [
                ([[0, 0], [1, 1]], [[50, 50], [9, 9]]),
                ([[1, 0], [1, 1]], [[40, 50], [9, 9]]),
                ([[1, 1], [1, 1]], [[40, 40], [9, 9]]),
            ],
        }
    )
    taken = tensor([0.0, 0.0])
    oracle, policies = MazeOracle(problem, judge, lambda: taken), {"behaviour": no_act, "averaged": no_act}
    start = oracle.metrics(policies, None)  # of what was learned from demonstrations: no round yet
    assert {name for name, value in start.items() if value.isfinite().all()} == {
        "collect/steps",
        *(f"eval/{what}{which}" for what in ("success", "length") for which in ("", "_averaged")),
    }
    assert start["eval/success"].tolist() == [0, 0.5]
    assert start["eval/length"].tolist() == [50, 35]
    taken += tensor([100.0, 70.0])
    oracle.update(torch.zeros(3), tensor([[1, 0, 1], [0, 0, 1]]), Random())
    oracle.update(torch.zeros(1), tensor([[0], [1]]), Random())
    first = oracle.metrics(policies, None)
    assert first["collect/steps"].tolist() == [100, 70]
    assert first["return/label"].tolist() == [0.5, 0.5]
    assert first["eval/success"].tolist() == first["eval/auc"].tolist() == [1, 0.5]
    oracle.update(torch.zeros(1), tensor([[0], [1]]), Random())
    taken += 1
    second = oracle.metrics(policies, None)
    assert first["collect/steps"].tolist() == [100, 70]  # what was logged stays
    assert second["return/label"].tolist() == [0, 1]  # since the last call
    assert second["eval/success"].tolist() == [0, 1]
    assert second["eval/auc"].tolist() == second["eval/final"].tolist() == [0.5, 0.75]
    assert second["eval/learned"].tolist() == second["eval/lost"].tolist() == [1, 0]
    assert second["eval/auc_averaged"].tolist() == [0.75, 1]
    assert second["eval/lost_averaged"].tolist() == [0, 0]
    assert judge.asked == ["behaviour", "averaged"] * 3
    assert all(value.shape == (2,) for value in second.values())


def test_trust_in_models_is_that_of_each_replica() -> None:
    problem = ContinuousProblem(4, 2, 50, (0, 1), torch.device("cpu"))
    weights = tensor([[[0.2, 0.4, 0.9], [0.8, 0.6, 0.1]]])
    empty = torch.zeros_like(weights[:, 0])
    belief = StepBelief(
        ("dnn", "cells"),
        weights,
        (),
        weights,
        weights[:, :1],
        weights,
        torch.tensor([[1, 1, 0]]),
        empty,
        {"gap": empty},
        empty,
        torch.tensor([0, 1, 1]),
    )
    found = MazeOracle(problem, Judge({}), problem.zeros).metrics({}, belief)
    expected = {"weight/dnn": [0.2, 0.65], "weight/cells": [0.8, 0.35], "best/dnn": [0, 0.5], "best/cells": [1, 0.5]}
    assert {name: found[name].tolist() for name in expected} == {k: pytest.approx(v) for k, v in expected.items()}


def test_evaluation_has_its_own_noise_and_keeps_nothing() -> None:
    def collected(evaluations: int) -> list[Tensor]:
        env, feedback = PointMaze(["11111", "10001", "11111"], (1, 1), (1, 3), evaluation_episodes=3), Success(40)
        problem = env.problem(40, (4, 5), "cpu")
        for part in (env, feedback):
            part.start(problem)
        oracle, starts = env.oracle(problem, feedback), []
        for _ in range(2):
            found, _ = env.collect(still, feedback, 3, 40)
            starts.append(found.states[found.lengths.flatten().cumsum(0).long() - 40])
            for _ in range(evaluations):
                oracle.metrics({"behaviour": still, "other": still}, None)
                evaluated.append(env.picture(0)["evaluation/states"][::40])
            assert env.taken.tolist() == [120 * len(starts)] * 2  # evaluation takes no steps of the run
        return starts

    def still(states: Tensor, step: int) -> Tensor:
        return torch.zeros_like(states[:, :2])

    evaluated: list[Any] = []
    for never, often in zip(collected(0), collected(2), strict=True):
        assert torch.equal(never, often)
    places = {tuple(start) for episodes in evaluated for start in episodes.tolist()}
    assert len(places) == 12  # every evaluation is of other episodes
    assert not places & {tuple(start) for round_ in collected(0) for start in round_.tolist()}
