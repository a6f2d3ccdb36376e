"""What a policy is worth: rounds by hand, episodes of its own with noise of their own."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor

from credit.agents.random import Random
from credit.core.policy import Policy
from credit.core.problem import Problem
from credit.core.seams import Evaluated, Evaluation
from credit.core.windows import Episode, Windows
from credit.judges.rollouts import Rollouts, of_rounds


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


Outcome = tuple[list[list[int]], list[list[int]]]  # of episodes [R, K]: success, or reward of the last step; length


class Written(Evaluation):
    """Evaluations that were written down before: what each policy gets, round by round.

    Args:
        found: policy → outcomes, one a call. said: whether the environment says what a success is.
    """

    def __init__(self, found: dict[str, list[Outcome]], said: bool = True) -> None:
        self._found, self._said = found, said
        self.asked: list[str] = []

    def __call__(self, policy: Policy) -> Evaluated:
        assert isinstance(policy, Named)
        self.asked.append(policy.name)
        ends, lengths = self._found[policy.name].pop(0)
        windows = windows_of(lengths, torch.tensor(ends).double())
        assert windows.ended is not None
        primitive = windows.to_steps(windows.labels) * windows.ended
        return Evaluated(windows, primitive, {"success": torch.tensor(ends) > 0} if self._said else {})


class Named(Policy):
    """Is told apart by its name, and never asked."""

    def __init__(self, name: str) -> None:
        self.name = name

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        raise AssertionError("the judge does not act")


def windows_of(lengths: list[list[int]], labels: Tensor) -> Windows:
    """Episodes of zeros."""

    def episode(steps: int) -> Episode:
        return Episode(torch.zeros(steps, 4), torch.zeros(steps, 2), torch.zeros(steps, 4))

    return Windows.of_episodes([[episode(n) for n in own] for own in lengths], labels)


PROBLEM = Problem.vectors(4, 2, 50, (0, 1))
POLICIES: dict[str, Policy] = {name: Named(name) for name in ("behaviour", "averaged")}


def update(judge: Rollouts, lengths: list[list[int]], labels: list[list[int]]) -> None:
    windows = windows_of(lengths, tensor(labels))
    judge.update(windows, torch.zeros(2, len(windows)), Random())


def test_metrics_by_hand() -> None:
    written = Written(
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
    judge = Rollouts(PROBLEM, written)
    start = judge.measure(POLICIES, None)  # of what was learned from demonstrations: no round yet
    assert {name for name, value in start.items() if value.isfinite().all()} == {
        "collect/steps",
        *(f"eval/{what}{which}" for what in ("success", "length", "return") for which in ("", "_averaged")),
    }
    assert start["eval/success"].tolist() == start["eval/return"].tolist() == [0, 0.5]
    assert start["eval/length"].tolist() == [50, 35]
    update(judge, [[30, 40], [40, 20]], [[1, 0], [0, 0]])
    update(judge, [[30], [10]], [[1], [1]])
    first = judge.measure(POLICIES, None)
    assert first["collect/steps"].tolist() == [100, 70]
    assert first["return/label"].tolist() == pytest.approx([2 / 3, 1 / 3])
    assert first["eval/success"].tolist() == first["eval/auc"].tolist() == [1, 0.5]
    update(judge, [[1], [1]], [[0], [1]])
    second = judge.measure(POLICIES, None)
    assert first["collect/steps"].tolist() == [100, 70]  # what was logged stays
    assert second["collect/steps"].tolist() == [101, 71]
    assert second["return/label"].tolist() == [0, 1]  # since the last call
    assert second["eval/success"].tolist() == [0, 1]
    assert second["eval/auc"].tolist() == second["eval/final"].tolist() == [0.5, 0.75]
    assert second["eval/learned"].tolist() == second["eval/lost"].tolist() == [1, 0]
    assert second["eval/auc_averaged"].tolist() == [0.75, 1]
    assert second["eval/lost_averaged"].tolist() == [0, 0]
    assert written.asked == ["behaviour", "averaged"] * 3
    assert all(value.shape == (2,) for value in second.values())


def test_where_nothing_is_a_success_rounds_are_summed_up_by_return() -> None:
    found: list[Outcome] = [([[3, 1], [0, -2]], [[5, 5], [5, 7]]), ([[1, 1], [4, 4]], [[2, 2], [2, 2]])]
    judge = Rollouts(PROBLEM, Written({"behaviour": found}, said=False))
    update(judge, [[5], [5]], [[1], [1]])
    first = judge.measure({"behaviour": Named("behaviour")}, None)
    assert set(first) == {"collect/steps", "return/label", *(f"eval/{n}" for n in ("return", "length", "auc", "final"))}
    assert first["eval/return"].tolist() == first["eval/auc"].tolist() == [2, -1]
    update(judge, [[5], [5]], [[1], [1]])
    second = judge.measure({"behaviour": Named("behaviour")}, None)
    assert second["eval/return"].tolist() == [1, 4]
    assert second["eval/auc"].tolist() == [1.5, 1.5]


def test_a_positive_reward_is_a_success_where_the_label_is() -> None:
    found: list[Outcome] = [([[3, -1], [0, 0]], [[5, 5], [5, 5]])]
    judge = Rollouts(PROBLEM, Written({"behaviour": found}, said=False), success=True)
    values = judge.measure({"behaviour": Named("behaviour")}, None)
    assert values["eval/success"].tolist() == [0.5, 0]
    assert values["eval/return"].tolist() == [1, 0]
    picture = judge.picture(0)
    assert picture["evaluation/labels"].tolist() == [1, 0]
    assert picture["evaluation/lengths"].tolist() == [5, 5]
    assert picture["evaluation/states"].shape == (10, 4)
