"""What of a state acts: packed without the rest, one replica's part of it, and laid over a state made anew."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest
import torch
from torch import nn

from credit.core.acting import alone, laid_over
from credit.core.problem import Problem
from credit.core.state import LEFT, Stateful, same
from credit.core.streams import Stream

R = 3


class Holder(Stateful):
    """A network, what trains it, random numbers, a list of a part each, and a table."""

    def __init__(self, seeds: range) -> None:
        self.network = nn.Linear(2, 1)
        self.adam = torch.optim.Adam(self.network.parameters())
        self.stream = Stream(Problem.finite(2, 2, 2, tuple(seeds)), "x", "uniform", 1)
        self.generator = np.random.default_rng(0)
        self.each = [{"place": torch.full((2,), float(seed))} for seed in seeds]
        self.table = torch.arange(2.0 * len(seeds)).view(len(seeds), 2)
        self.pairs = torch.arange(2 * len(seeds))  # two for each
        self.count = 4


class Few(Holder):
    acts: ClassVar = ("table",)


def test_what_trains_and_what_is_drawn_is_left_out() -> None:
    kept = Holder(range(R)).acting()
    assert kept["adam"] == kept["generator"] == LEFT
    assert kept["stream"] == ["state", {}]
    assert {*kept} == {*Holder(range(R)).state_dict()}
    assert {*Few(range(R)).acting()} == {"table"}


def test_one_replicas_part() -> None:
    kept = Holder(range(R)).acting() | {"network": LEFT}
    one = alone(kept, 1, R, Holder(range(1)).acting() | {"network": LEFT})
    assert one["table"].tolist() == [[2, 3]]
    assert one["pairs"].tolist() == [2, 3]
    assert one["each"] == ["list", [["dict", [["place", one["each"][1][0][1][0][1]]]]]]
    assert one["each"][1][0][1][0][1].tolist() == [1, 1]
    assert one["count"] == 4
    assert same(alone(kept, 0, 1, None), kept)  # who is alone has no parts


@pytest.mark.parametrize(
    ("part", "like", "said"),
    [
        (torch.zeros(4, 2), torch.zeros(1, 2), r"the agent\.x has the shape \[4, 2\], and of one seed alone \[1, 2\]"),
        (["list", [1, 2]], ["list", [1]], r"the agent\.x\[1\] holds 2 parts, and of one seed alone 1"),
        (torch.zeros(7), torch.zeros(2), "replicas must be the leading dimension"),
    ],
)
def test_what_cannot_be_taken_apart_is_named(part: Any, like: Any, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        alone({"x": part}, 0, R, {"x": like})


def test_a_part_that_has_grown() -> None:
    found = alone({"x": torch.arange(6).view(R, 2)}, 2, R, {"x": torch.zeros(1, 0)})
    assert found["x"].tolist() == [[4, 5]]


def test_laid_over_what_was_made_anew() -> None:
    kept, second = Holder(range(R)), Holder(range(10, 10 + R))
    kept.table += 1
    before = second.stream.state_dict()
    second.load_state_dict(laid_over(second.state_dict(), kept.acting()))
    assert torch.equal(second.table, kept.table)
    assert torch.equal(second.network.weight, kept.network.weight)
    assert same(second.stream.state_dict(), before)
