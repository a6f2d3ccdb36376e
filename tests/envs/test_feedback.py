"""Equations (1) and (24), section 6.2: what a label is."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import pytest
import torch

from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.seams import Feedback
from credit.envs.feedback import BlockSum, Labels, Mean, Success, Terminal


def labels(problem: Problem, feedback: Feedback, rewards: torch.Tensor) -> torch.Tensor:
    feedback.start(problem)
    return feedback(rewards)


def test_without_noise_a_label_is_the_sum(make_problem: Callable[..., Problem]) -> None:
    rewards = torch.tensor([[[1.0, 2.0, 3.0], [0.5, -0.5, 0.25]]], dtype=torch.float64)
    assert labels(make_problem(), BlockSum(3, noise=0.0), rewards).tolist() == [[6.0, 0.25]]


def test_noise_has_its_standard_deviation(make_problem: Callable[..., Problem]) -> None:
    # 20,000 labels: the relative standard error of a standard deviation is 1/√40000 = .5%
    rewards = torch.full((2, 10_000, 7), 0.1, dtype=torch.float64)
    error = labels(make_problem((0, 1)), BlockSum(7, noise=0.2), rewards) - 0.7
    assert abs(float(error.std()) / 0.2 - 1) < 0.025
    assert abs(float(error.mean())) < 5 * 0.2 / 20_000**0.5
    assert abs(float(torch.corrcoef(error)[0, 1])) < 0.05


def test_noise_depends_on_seed_and_number_of_the_window_alone(make_problem: Callable[..., Problem]) -> None:
    rewards = torch.rand(3, 6, 7, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    batch = labels(make_problem((4, 5, 6)), BlockSum(), rewards)
    alone = BlockSum()
    alone.start(make_problem((5,)))
    pieces = [alone(rewards[1:2, :1]), alone(rewards[1:2, 1:4]), alone(rewards[1:2, 4:])]
    assert torch.equal(torch.cat(pieces, dim=1)[0], batch[1])


def test_a_terminal_label_is_the_last_reward(make_problem: Callable[..., Problem]) -> None:
    rewards = torch.tensor([[[1.0, 2.0, 3.0], [0.5, -0.5, 0.25]], [[0, 0, -1.0], [9.0, 9.0, 0]]], dtype=torch.float64)
    found = labels(make_problem((0, 1)), Terminal(3), rewards)
    assert found.tolist() == [[3.0, 0.25], [-1.0, 0.0]]
    assert (BlockSum.objective, Terminal.objective, Success.objective) == ("sum", "last", "success")


def test_a_terminal_label_has_no_noise_and_no_memory(make_problem: Callable[..., Problem]) -> None:
    rewards = torch.rand(1, 4, 5, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    feedback = Terminal()
    assert feedback.window == 5
    first, again = labels(make_problem(), feedback, rewards), feedback(rewards)
    assert torch.equal(first, rewards[..., 4])
    assert torch.equal(first, again)
    earlier = rewards.clone()
    earlier[..., :4] = torch.nan
    assert torch.equal(feedback(earlier), first)


class Median(Labels):
    """As the page of `Labels` has it."""

    objective: ClassVar = "median"

    def rule(self, rewards: torch.Tensor) -> torch.Tensor:
        return rewards.median(-1).values


@pytest.mark.parametrize("kind", [Median, Mean, Terminal, BlockSum, Success])
def test_a_label_is_of_its_window_alone(make_problem: Callable[..., Problem], kind: type[Labels]) -> None:
    """However far others reach that lie beside it: what is behind a window's end is shown to no rule."""
    feedback = kind(window=15)
    feedback.noise = 0.0
    feedback.start(make_problem((0, 1)))
    lengths = torch.tensor([[15, 5, 0], [1, 5, 4]])
    rewards = 1 + torch.rand(2, 3, 15, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    rewards *= torch.arange(15) < lengths.unsqueeze(-1)
    found = feedback.label(rewards, lengths)
    for place in ((0, 0), (0, 1), (1, 0), (1, 1), (1, 2)):
        alone = feedback(rewards[place][: lengths[place]].view(1, 1, -1))
        assert float(found[place]) == pytest.approx(float(alone), rel=1e-14)
        assert float(alone) >= 1
    assert found[0, 2] == 0


def test_a_rule_with_another_shape_is_told_so(make_problem: Callable[..., Problem]) -> None:
    class Kept(Median):
        def rule(self, rewards: torch.Tensor) -> torch.Tensor:
            return rewards.amax(-1, keepdim=True)

    with pytest.raises(
        UserError, match=r"Kept\.rule gave labels \[4, 1\] for rewards \[4, 7\].* one label each, \[4\]"
    ):
        labels(make_problem((0, 1)), Kept(7), torch.ones(2, 2, 7))


def test_success_is_one_bit(make_problem: Callable[..., Problem]) -> None:
    rewards = torch.tensor([[[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]], [[0.0, 1.0, 0.0], [1.0, 1.0, 0.0]]]).double()
    found = labels(make_problem((0, 1)), Success(3), rewards)
    assert found.tolist() == [[1, 0], [1, 1]]
    assert found.dtype == torch.float64


@pytest.mark.parametrize(("missing", "said"), [(0.0, ""), (0.5, ""), (0.99, "of 100 windows one gets a label")])
def test_labels_that_hardly_ever_come_are_told(missing: float, said: str) -> None:
    assert (said in BlockSum(7, missing=missing).remark()) if said else not BlockSum(7, missing=missing).remark()
