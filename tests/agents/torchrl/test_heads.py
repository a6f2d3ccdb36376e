"""Actions and probabilities against TorchRL's own distributions."""

from __future__ import annotations

import torch
from tensordict import TensorDict
from torch import nn

from credit.agents.torchrl.heads import Bounded, Categories, Squashed


def test_an_action_is_what_torchrl_makes_of_the_same_noise() -> None:
    raw, noise = (torch.randn(50, n, generator=torch.Generator().manual_seed(0)) for n in (6, 3))
    head = Squashed(3)
    actor = head.actor(nn.Identity())
    distribution = actor.get_dist(TensorDict({"observation": raw}, [50]))
    base = distribution.base_dist.base_dist if hasattr(distribution.base_dist, "base_dist") else distribution.base_dist
    torch.testing.assert_close(head.explored(raw, noise), (base.loc + base.scale * noise).tanh())
    torch.testing.assert_close(head.best(raw), distribution.deterministic_sample)
    assert head.probabilities(raw) is None
    assert head.best_probabilities(raw) is None


def test_categories_are_drawn_by_their_probabilities() -> None:
    raw, head = torch.tensor([0.3, -1.0, 2.0, 0.0]), Categories(4)
    chances = head.probabilities(raw)
    torch.testing.assert_close(chances, torch.softmax(raw.double(), 0))
    noise = torch.rand(20_000, 1, generator=torch.Generator().manual_seed(0))
    shares = head.explored(raw.expand(len(noise), -1), noise).bincount(minlength=4) / len(noise)
    assert ((shares - chances).abs() < 5 * (chances * (1 - chances) / len(noise)).sqrt()).all()
    assert head.explored(raw.expand(2, -1), torch.tensor([[0.0], [1.0]])).tolist() == [0, 3]
    assert head.best_probabilities(raw).tolist() == [0, 0, 1, 0]


def test_a_deterministic_action_gets_noise_within_bounds() -> None:
    raw, head = torch.tensor([[0.0, 3.0]]), Bounded(2, 0.5)
    assert head.explored(raw, torch.tensor([[1.0, 1.0]])).tolist() == [[0.5, 1.0]]
    torch.testing.assert_close(
        head.actor(nn.Identity())(TensorDict({"observation": raw}, [1]))["action"], head.best(raw)
    )
