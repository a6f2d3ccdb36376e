"""Modules side by side against the perceptrons whose backward pass is written out."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor, nn

from credit.core.streams import generators
from credit.networks.beside import Modules
from credit.networks.modules import Network, Perceptron
from credit.networks.stack import Shape, Stack

CPU = torch.device("cpu")
SHAPE = Shape(4, 1, 7, 2)


class Looks(nn.Module):
    """Has a weight that no output depends on, and looks at a number, which vmap does not allow."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.used, self.unused = nn.Linear(inputs, outputs), nn.Linear(inputs, outputs)

    def forward(self, values: Tensor) -> Tensor:
        found: Tensor = self.used(values)
        return found if float(values.detach().sum()) > -1e30 else self.unused(values)


class Unused(Network):
    """Makes them."""

    def make(self, inputs: int, outputs: int, device: torch.device) -> nn.Module:
        return Looks(inputs, outputs).to(device)


def both() -> tuple[Stack, Modules]:
    """The same three networks, by hand and by autograd."""
    streams = generators((3, 4, 5), "weights")
    stack, modules = Stack.drawn(SHAPE, streams, CPU), Modules(Perceptron((7, 7), "relu"), 4, streams, CPU)
    states = [stack.state(m) for m in range(3)]
    for view, name in zip(modules.blocks, states[0], strict=True):
        view.copy_(torch.stack([state[name] for state in states]))
    return stack, modules


def test_passes_are_those_of_perceptrons() -> None:
    stack, modules = both()
    rows = torch.randn(3, 6, 4, generator=torch.Generator().manual_seed(0))
    delta = torch.randn(3, 6, 1, generator=torch.Generator().manual_seed(1))
    by_hand, by_graph = stack.passes(6), modules.passes(6)
    by_hand.input.copy_(rows)
    by_graph.input.copy_(rows)
    torch.testing.assert_close(by_graph.forward(), by_hand.forward())
    for m in range(3):
        torch.testing.assert_close(modules.alone(m, rows[m]), stack.alone(m, rows[m]))
    by_hand.backward(delta.clone())
    by_graph.backward(delta.clone())
    written = Stack(SHAPE, 3, by_hand.gradient)
    expected = torch.cat([torch.stack([written.state(m)[name] for m in range(3)]).flatten() for name in stack.state(0)])
    torch.testing.assert_close(by_graph.gradient, expected)


def test_weights_are_one_flat_tensor() -> None:
    _, modules = both()
    rows = torch.randn(5, 4, generator=torch.Generator().manual_seed(0))
    before = modules.alone(1, rows)
    state = modules.state_dict()
    modules.flat.zero_()
    assert torch.equal(modules.alone(1, rows), torch.zeros(5))
    modules.load_state_dict(state)
    assert torch.equal(modules.alone(1, rows), before)


def test_first_weights_follow_from_the_stream_of_each() -> None:
    rows = torch.randn(5, 4, generator=torch.Generator().manual_seed(0))
    torch.manual_seed(0)
    one = Modules(Perceptron(), 4, generators((3, 4), "weights"), CPU)
    torch.manual_seed(1)
    other = Modules(Perceptron(), 4, generators((4,), "weights"), CPU)
    assert torch.equal(one.alone(1, rows), other.alone(0, rows))
    assert not torch.equal(one.alone(0, rows), other.alone(0, rows))
    assert not torch.equal(one.another(generators((3, 4), "prior")).alone(0, rows), one.alone(0, rows))


@pytest.mark.parametrize("members", [1, 2])
def test_what_vmap_does_not_carry_and_weights_without_effect(members: int) -> None:
    modules = Modules(Unused(), 4, generators(range(members), "weights"), CPU)
    assert modules.loops
    passes = modules.passes(3)
    passes.input.normal_(generator=torch.Generator().manual_seed(0))
    passes.gradient.fill_(9)
    assert passes.forward().shape == (members, 3, 1)
    passes.backward(torch.ones(members, 3, 1))
    weight, bias, *unused = modules.views(passes.gradient)
    torch.testing.assert_close(weight[:, 0], passes.input.sum(1))
    torch.testing.assert_close(bias, torch.full((members, 1), 3.0))
    assert not any(part.any() for part in unused)
