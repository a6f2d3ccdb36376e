"""States: plain data that make an object what it was, whatever it is made of."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
import torch

from credit.core.component import Component
from credit.core.problem import Problem
from credit.core.state import Stateful, pack, unpack
from credit.runs import checkpoint


class Box(Stateful):
    """Holds whatever it is given."""

    def __init__(self, **parts: Any) -> None:
        vars(self).update(parts)


class Counter(Stateful):
    keeps: ClassVar = ("count",)

    def __init__(self) -> None:
        self.count = torch.zeros(2)
        self.cache = object()


@pytest.fixture
def through(tmp_path: Path) -> Callable[[Stateful, Stateful], None]:
    """Gives one object the state of another, by way of a file."""

    def give(source: Stateful, target: Stateful) -> None:
        checkpoint.save(tmp_path / "state.pt", {"state": source.state_dict()})
        target.load_state_dict(checkpoint.load(tmp_path / "state.pt")["state"])

    return give


@pytest.mark.parametrize(
    "value",
    [
        *(None, True, 3, 2**100, 0.1, float("inf"), "δ", [], (), {}, [1, (2, [None, "x"])]),
        {"a": [1, 2], 3: ("b", {})},
        {(1, 2): "a tuple as a key"},
        ["dict", [["looks", "like a packed one"]]],
    ],
)
def test_plain_values_come_back(through, value):
    box = Box(value=None)
    through(Box(value=value), box)
    assert box.value == value
    assert type(box.value) is type(value)


def test_nested_values_come_back_at_every_depth(through):
    parts = {"rows": [torch.arange(3), (np.ones((2, 2)), {"x": torch.zeros(0, 4)})], "n": {"m": Counter()}}
    source, target = Box(**parts), Box(rows=None, n={"m": Counter()})
    source.n["m"].count += 5
    inner = target.n["m"]
    through(source, target)
    assert torch.equal(target.rows[0], torch.arange(3))
    assert isinstance(target.rows[1], tuple)
    assert target.rows[1][0].tolist() == [[1, 1], [1, 1]]
    assert target.rows[1][1]["x"].shape == (0, 4)
    assert target.n["m"] is inner
    assert inner.count.tolist() == [5, 5]


@pytest.mark.parametrize("dtype", [torch.bool, torch.int64, torch.float32, torch.float64])
def test_tensors_are_written_where_others_look(through, dtype):
    block = torch.zeros(2, 3, dtype=dtype)
    target = Box(block=block, row=block[1])
    through(Box(block=torch.ones(2, 3, dtype=dtype), row=torch.ones(3, dtype=dtype)), target)
    assert target.block is block
    assert target.row.data_ptr() == block[1].data_ptr()
    assert block.all()


def test_a_view_is_saved_without_what_it_is_a_view_of(tmp_path):
    checkpoint.save(tmp_path / "x.pt", {"x": pack(torch.zeros(10**6)[:3], "x")})
    assert (tmp_path / "x.pt").stat().st_size < 5000


class Growing(Counter):
    keeps: ClassVar = ("block", "used")

    def __init__(self, room: int, used: int) -> None:
        self.block, self.used = torch.arange(2.0 * room).view(2, room), used

    def filled(self) -> dict[str, int]:
        return {"block": self.used}


def test_room_for_more_is_not_saved(through):
    target = Growing(5, 0)
    assert Growing(4, 3).state_dict()["block"].tolist() == [[0, 1, 2], [4, 5, 6]]
    through(Growing(4, 3), target)
    assert (target.block.tolist(), target.used) == ([[0, 1, 2], [4, 5, 6]], 3)


def test_a_state_does_not_change_when_the_run_goes_on():
    box = Box(tensor=torch.zeros(2), array=np.zeros(2), generator=np.random.default_rng(0))
    state = box.state_dict()
    first = box.generator.random()
    box.tensor += 1
    box.array += 1
    box.load_state_dict(state)
    assert box.tensor.tolist() == box.array.tolist() == [0, 0]
    assert box.generator.random() == first


def test_an_expanded_tensor_is_replaced(through):
    one = torch.zeros(1)
    target = Box(x=one.expand(3))
    through(Box(x=torch.tensor([1.0, 2.0, 3.0])), target)
    assert target.x.tolist() == [1, 2, 3]
    assert one.tolist() == [0]


@pytest.mark.parametrize("now", [torch.zeros(3), torch.zeros(2, dtype=torch.float64), None, "text"])
def test_a_tensor_that_does_not_fit_is_replaced(through, now):
    target = Box(x=now)
    through(Box(x=torch.tensor([1.0, 2.0])), target)
    assert target.x.tolist() == [1, 2]
    assert target.x.dtype == torch.float32


def test_parameters_are_written_in_place_and_still_learn(through):
    weights = torch.nn.Parameter(torch.zeros(2))
    target = Box(w=weights)
    through(Box(w=torch.nn.Parameter(torch.ones(2))), target)
    assert target.w is weights
    assert weights.requires_grad
    assert weights.tolist() == [1, 1]


@pytest.mark.parametrize("kind", [np.random.PCG64, np.random.Philox, np.random.SFC64, np.random.MT19937])
def test_generators_draw_what_they_would_have_drawn(through, kind):
    source, generator = Box(g=np.random.Generator(kind(1))), np.random.Generator(kind(2))
    source.g.normal(size=7)
    through(source, target := Box(g=generator))
    assert target.g is generator
    assert generator.normal(size=5).tolist() == source.g.normal(size=5).tolist()


@pytest.mark.parametrize("make", [torch.optim.Adam, lambda p: torch.optim.SGD(p, lr=0.1, momentum=0.9)])
def test_modules_and_optimizers_learn_on(through, make):
    def learner(seed: int) -> Box:
        torch.manual_seed(seed)
        net = torch.nn.Sequential(torch.nn.Linear(3, 2), torch.nn.BatchNorm1d(2))
        return Box(net=net, optimizer=make(net.parameters()))

    def learn(box: Box, steps: int) -> torch.Tensor:
        for step in range(steps):
            box.optimizer.zero_grad()
            loss = box.net(torch.linspace(-1, step + 1, 12).view(4, 3)).square().sum()
            loss.backward()
            box.optimizer.step()
        return loss.detach()

    source, target = learner(0), learner(1)
    learn(source, 3)
    learn(target, 1)
    through(source, target)
    assert torch.equal(learn(target, 4), learn(source, 4))
    assert all(torch.equal(a, b) for a, b in zip(source.net.parameters(), target.net.parameters(), strict=True))


class Theirs(Component):
    """As somebody else would write one, who has never heard of states."""

    def __init__(self, scale: float, counter: Counter, several: dict[str, Counter]) -> None:
        self.scale = scale
        self.counter = counter
        self.several = several

    def start(self, problem: Problem) -> None:
        self.problem = problem
        self._device = problem.device
        self.sums = problem.zeros(3)
        self.seen = 0


def test_without_keeps_the_state_is_what_start_made_and_parts_that_have_one(through, make_problem):
    def made() -> Theirs:
        part = Theirs(2.0, Counter(), {"a": Counter()})
        part.start(make_problem((0, 1)))
        return part

    source, target = made(), made()
    assert set(source.state_dict()) == {"counter", "several", "sums", "seen"}
    source.sums += 1
    source.seen = 4
    source.counter.count += 2
    source.several["a"].count += 3
    source.scale = 9.0
    through(source, target)
    assert target.sums.tolist() == [[1, 1, 1], [1, 1, 1]]
    assert (target.seen, target.scale) == (4, 2.0)
    assert target.counter.count.tolist() == [2, 2]
    assert target.several["a"].count.tolist() == [3, 3]


@pytest.mark.parametrize(
    ("value", "where"),
    [
        (lambda: None, "Box.part"),
        ([0, {"deep": {1, 2}}], r"Box.part\[1\]\['deep'\]"),
        ({"net": [torch.device("cpu"), object()]}, r"Box.part\['net'\]\[0\]"),
    ],
)
def test_what_cannot_be_packed_is_named(value, where):
    with pytest.raises(TypeError, match=rf"{where} is a \w+, which no checkpoint can hold: .*`keeps`.*state_dict"):
        Box(part=value).state_dict()


def test_the_state_of_something_else_is_refused():
    with pytest.raises(ValueError, match=r"Counter has the state \['count'\], not \['sums'\]"):
        Counter().load_state_dict({"sums": torch.zeros(2)})
    for packed, now in (
        (pack(np.random.default_rng(0), "x"), torch.zeros(1)),
        (pack(Counter(), "x"), None),
        (pack(torch.optim.SGD([torch.zeros(1)], lr=1.0), "x"), Counter()),
    ):
        with pytest.raises(
            ValueError, match=rf"Box.x: the checkpoint has a \w+ where the run has {type(now).__name__}"
        ):
            Box(x=now).load_state_dict({"x": packed})
    assert unpack(pack((1, 2), "x"), [1, 2, 3], "x") == (1, 2)


@pytest.mark.parametrize("value", [np.float64(0.1), np.int64(3), np.bool_(True), np.str_("x")])
def test_numbers_of_numpy_become_plain_ones(through, value):
    through(Box(x=value), target := Box(x=None))
    assert target.x == value
    assert type(target.x) in (float, int, bool, str)
