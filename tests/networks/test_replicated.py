"""Modules side by side against the same modules one by one."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor, nn

from credit.networks.replicated import Replicated


class Uncarried(nn.Linear):
    """Looks at a number, which vmap does not allow."""

    def forward(self, values: Tensor) -> Tensor:
        return super().forward(values) * (1.0 if float(values.detach().sum()) > -1e30 else 2.0)


def made(kind: str) -> list[nn.Module]:
    kinds = {
        "deep": lambda: nn.Sequential(nn.Linear(4, 6), nn.LayerNorm(6), nn.Tanh(), nn.Dropout(0.5), nn.Linear(6, 3)),
        "buffers": lambda: nn.Sequential(nn.BatchNorm1d(4), nn.Linear(4, 3)),
        "uncarried": lambda: Uncarried(4, 3),
    }
    with torch.random.fork_rng():
        torch.manual_seed(0)
        return [kinds[kind]() for _ in range(3)]


@pytest.mark.parametrize(("kind", "loops"), [("deep", False), ("buffers", False), ("uncarried", True)])
def test_each_is_what_it_is_alone(kind: str, loops: bool) -> None:
    modules = made(kind)
    network = Replicated(modules, 4)
    assert network.loops is loops
    inputs = torch.randn(3, 5, 4, generator=torch.Generator().manual_seed(0))
    found = network(inputs)
    found.square().sum().backward()
    for replica, (module, own) in enumerate(zip(modules, inputs, strict=True)):
        expected = module.eval()(own)
        torch.testing.assert_close(found[replica], expected)
        torch.testing.assert_close(network.alone(replica, own), expected)
        module.zero_grad()
        expected.square().sum().backward()
        for mine, its in zip(network.parameters(), module.parameters(), strict=True):
            assert mine.grad is not None
            assert its.grad is not None
            torch.testing.assert_close(mine.grad[replica], its.grad)
    assert network.best(inputs[0]).shape == (3, 5)
