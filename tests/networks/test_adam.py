"""Adam on flat tensors, against PyTorch's."""

from __future__ import annotations

import torch

from credit.networks.adam import Adam, step


def test_adam_is_that_of_pytorch() -> None:
    start, gradients = torch.randn(33), torch.randn(5, 33)
    ours, gradient = start.clone(), torch.empty(33)
    theirs = torch.nn.Parameter(start.clone())
    mine, stock = Adam(ours, gradient, 0.01), torch.optim.Adam([theirs], 0.01)
    for g in gradients:
        gradient.copy_(g)
        mine.step()
        theirs.grad = g.clone()
        stock.step()
        torch.testing.assert_close(ours, theirs.data, rtol=1e-6, atol=1e-7)


def test_two_at_once_are_two_one_after_the_other() -> None:
    weights, gradients = torch.randn(2, 2, 20), torch.randn(2, 20)
    alone, together = ([Adam(w, g, 0.01) for w, g in zip(half, gradients, strict=True)] for half in weights)
    weights[1] = weights[0]
    for each in alone:
        each.step()
    step(*together)
    assert torch.equal(weights[0], weights[1])
