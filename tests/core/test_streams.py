"""Random numbers depend on (seed, purpose) alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch

from credit.core.problem import Problem
from credit.core.streams import Stream, generators


def rows(problem: Problem, purpose: str, kind: Any, width: int, count: int) -> torch.Tensor:
    stream = Stream(problem, purpose, kind, width)
    return torch.stack([stream.next() for _ in range(count)])


@pytest.mark.parametrize("kind", ["uniform", "normal", "poisson"])
def test_a_replica_draws_the_same_in_any_batch(make_problem: Callable[..., Problem], kind: str) -> None:
    count = Stream.CHUNK + 3  # over the end of a buffer
    batch = rows(make_problem((3, 4, 5)), "test", kind, 2, count)
    assert batch.shape == (count, 3, 2)
    assert batch.dtype == torch.float64
    assert torch.equal(rows(make_problem((4,)), "test", kind, 2, count)[:, 0], batch[:, 1])
    assert torch.equal(rows(make_problem((5, 3)), "test", kind, 2, count), batch[:, [2, 0]])


def test_streams_differ_by_seed_and_purpose(make_problem: Callable[..., Problem]) -> None:
    first = rows(make_problem((0, 1)), "environment", "uniform", 5, 3)
    assert not torch.equal(first[:, 0], first[:, 1])
    assert not torch.equal(first, rows(make_problem((0, 1)), "feedback", "uniform", 5, 3))
    assert torch.equal(first, rows(make_problem((0, 1)), "environment", "uniform", 5, 3))


def test_seeds_next_to_each_other_are_not_correlated(make_problem: Callable[..., Problem]) -> None:
    # 200 seeds, 500 numbers each: the largest of 19,900 correlations of sd 1/√500 is about 4.1 sd; 6 is allowed
    drawn = rows(make_problem(range(200)), "environment", "normal", 1, 500)[..., 0].T
    correlation = torch.corrcoef(drawn) - torch.eye(200)
    assert correlation.abs().max() < 6 / 500**0.5


@pytest.mark.parametrize(("kind", "mean", "variance"), [("uniform", 0.5, 1 / 12), ("normal", 0, 1), ("poisson", 1, 1)])
def test_moments(make_problem: Callable[..., Problem], kind: str, mean: float, variance: float) -> None:
    drawn = rows(make_problem((0, 1)), "moments", kind, 10, 2000).flatten()  # 40,000 numbers
    assert abs(float(drawn.mean()) - mean) < 5 * (variance / 40_000) ** 0.5
    assert abs(float(drawn.var()) / variance - 1) < 0.05
    if kind == "uniform":
        assert drawn.min() >= 0
        assert drawn.max() < 1


def test_generators_are_one_a_seed() -> None:
    first, second = (generators((7, 8), "x") for _ in range(2))
    assert [g.random() for g in first] == [g.random() for g in second]
    assert generators((7,), "y")[0].random() != generators((7,), "x")[0].random()
