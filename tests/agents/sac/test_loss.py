"""Losses and gradients against TorchRL's SACLoss and autograd, on the same weights, batch and noise."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import NormalParamExtractor
from torch import Tensor
from torchrl.data import Bounded
from torchrl.modules import ValueOperator
from torchrl.objectives import SACLoss, SoftUpdate, ValueEstimators

from credit.agents.sac.learner import Learner
from credit.agents.sac.loss import entropy_room, losses
from credit.agents.sac.networks import critic_module, extract_actor, squash, squash_backward
from credit.data.replay import Batch
from credit.networks.stack import Stack

R, B = 3, 10


def learner(**keys: Any) -> Learner:
    """Three seeds whose weights, targets and temperatures all differ."""
    sac = Learner(**({"width": 12, "target_clip": False, "policy_delay": 1} | keys))
    sac.make(4, 2, range(R))
    generator = torch.Generator().manual_seed(5)
    for flat in (sac.actor.flat, sac.critic.flat, sac.target.flat):
        flat.add_(0.1 * torch.randn(flat.shape, generator=generator))
    sac.log_alpha.copy_(torch.tensor([-1.0, 0.2, 0.5]))
    return sac


def batch(seed: int = 0) -> tuple[Batch, Tensor]:
    """Transitions, one in five of which ends at the goal, and noise."""
    g = torch.Generator().manual_seed(seed)
    states, ahead = torch.randn(2, R, B, 4, generator=g)
    actions = torch.rand(R, B, 2, generator=g) * 1.8 - 0.9
    discount = 0.97 * (torch.arange(B) % 5 > 0).expand(R, B)
    returns, noise = torch.randn(R, B, generator=g), torch.randn(2, R, B, 2, generator=g)
    bounds = torch.full((R, 1), -1.0), torch.full((R, 1), 1.0)
    return Batch(states, actions, None, returns, discount, ahead, *bounds), noise


def extract_critic(stack: Stack, member: int) -> ValueOperator:
    """One critic of a stack as TorchRL has it, a copy."""
    module = critic_module(stack.shape)
    module.module.load_state_dict(stack.state(member))
    return module


def stock(sac: Learner, r: int) -> SACLoss:
    """TorchRL's loss with the weights of one replica."""
    loss = SACLoss(
        extract_actor(sac.actor, r),
        extract_critic(sac.critic, 2 * r),
        num_qvalue_nets=2,
        loss_function="l2",
        alpha_init=float(sac.log_alpha[r].exp()),
        target_entropy=-2.0,
        delay_qvalue=True,
        action_spec=Bounded(-1, 1, (2,)),
    )
    loss.make_value_estimator(ValueEstimators.TD0, gamma=0.97)
    SoftUpdate(loss, tau=0.005)  # otherwise TorchRL warns
    for params, stack in ((loss.qvalue_network_params, sac.critic), (loss.target_qvalue_network_params, sac.target)):
        members = [extract_critic(stack, 2 * r + c).state_dict() for c in range(2)]
        for key, value in params.flatten_keys(".").items():
            value.data.copy_(torch.stack([member[key] for member in members]))
    return loss


def stacked(stack: Stack, r: int, gradients: Stack) -> dict[str, Tensor]:
    """Gradients of both critics of a replica, by TorchRL's names."""
    twins = [gradients.state(2 * r + c) for c in range(2)]
    return {f"module.{key}": torch.stack([twin[key] for twin in twins]) for key in twins[0]}


@pytest.mark.parametrize(("norm", "depth"), [(False, 2), (True, 2), (True, 1), (False, 3)])
def test_losses_and_gradients_are_those_of_torchrl(norm: bool, depth: int, monkeypatch: pytest.MonkeyPatch) -> None:
    sac = learner(layer_norm=norm, depth=depth)
    data, noise = batch()
    terms = sac._gradients(data, noise, sac.log_alpha)
    ours = losses(terms, sac.log_alpha, -2.0)
    for r in range(R):
        drawn = iter([noise[1, r], noise[0, r]])  # TorchRL samples at s' first
        monkeypatch.setattr("torch.distributions.normal._standard_normal", lambda *_, drawn=drawn, **__: next(drawn))
        end = (data.discount[r] == 0).unsqueeze(-1)
        following = {
            "observation": data.ahead[r],
            "reward": data.returns[r].unsqueeze(-1),
            "done": end,
            "terminated": end,
        }
        rows = TensorDict({"observation": data.observation[r], "action": data.action[r], "next": following}, [B])
        loss = stock(sac, r)
        theirs = loss(rows)
        for mine, name in (("critic", "loss_qvalue"), ("actor", "loss_actor"), ("alpha", "loss_alpha")):
            torch.testing.assert_close(ours[mine][r], theirs[name].detach(), rtol=1e-5, atol=1e-5)
        sum(theirs[key] for key in ("loss_qvalue", "loss_actor", "loss_alpha")).backward()
        by_actor = {f"module.0.module.0.{k}": v for k, v in sac._gradients.by_actor.state(r).items()}
        by_critic = stacked(sac.critic, r, sac._gradients.by_critic)
        for params, mine in ((loss.actor_network_params, by_actor), (loss.qvalue_network_params, by_critic)):
            found = {key: value.grad for key, value in params.flatten_keys(".").items()}
            assert {key.removeprefix("module.") for key in found} == {key.removeprefix("module.") for key in mine}
            for key, value in mine.items():
                name = key if key in found else f"module.{key}"
                torch.testing.assert_close(value, found[name], rtol=1e-4, atol=1e-6)
        torch.testing.assert_close(sac._gradients.by_log_alpha[r], loss.log_alpha.grad.squeeze(), rtol=1e-5, atol=1e-6)


def test_targets_stay_within_what_rewards_and_entropy_allow() -> None:
    """Each replica by its own temperature: [−1 − α·2·γ/(1−γ), 1 + α·2 log 2·γ/(1−γ)], for H̄ = −2."""
    free, clipped = learner(discount=0.2), learner(discount=0.2, target_clip=True)
    data, noise = batch()
    data = data._replace(returns=4 * data.returns)
    y = free._gradients(data, noise, free.log_alpha).target
    found = clipped._gradients(data, noise, clipped.log_alpha).target
    for r, alpha in enumerate(free.log_alpha.exp().tolist()):
        low, high = -1 - alpha * 2 * 0.25, 1 + alpha * 2 * math.log(2) * 0.25
        torch.testing.assert_close(found[r], y[r].clamp(low, high))
        assert y[r].min() < low
        assert y[r].max() > high


def test_room_for_entropy_by_hand() -> None:
    assert entropy_room(0.5, 3, -3.0) == pytest.approx((-3.0, 3 * math.log(2)))  # γ/(1 − γ) = 1
    assert entropy_room(0.0, 2, -2.0) == (0.0, 0.0)  # nothing comes later
    assert entropy_room(0.9, 1, 0.5) == pytest.approx((0.0, 9 * math.log(2)))
    uniform = torch.distributions.Uniform(-torch.ones(3), torch.ones(3)).entropy().sum()
    assert entropy_room(0.5, 3, 0.0)[1] == pytest.approx(float(uniform))


def test_the_actor_is_left_alone_where_it_is_not_due() -> None:
    both, critics = learner(), learner()
    data, noise = batch()
    critics._gradients.by_actor.flat.fill_(7.0)
    with_actor = both._gradients(data, noise, both.log_alpha)
    without = critics._gradients(data, noise, critics.log_alpha, actor_due=False)
    assert torch.equal(with_actor.residual, without.residual)
    assert torch.equal(both._gradients.by_critic.flat, critics._gradients.by_critic.flat)
    assert without.log_prob is None
    assert set(losses(without, critics.log_alpha, -2.0)) == {"critic"}
    assert (critics._gradients.by_actor.flat == 7.0).all()


def test_the_head_against_autograd() -> None:
    """Also where the deviation is as small as it gets."""
    g = torch.Generator().manual_seed(1)
    output = torch.randn(50, 4, generator=g).mul(3)
    output[:3, 2:] = -20.0
    output.requires_grad_()
    noise, weight = torch.randn(50, 2, generator=g), torch.randn(50, 2, generator=g)
    loc, scale = NormalParamExtractor()(output)
    u = loc + scale * noise
    log_prob = torch.distributions.Normal(loc, scale).log_prob(u) - 2 * (
        torch.log(torch.tensor(2.0)) - u - torch.nn.functional.softplus(-2 * u)
    )
    (u.tanh() * weight).sum().add(0.3 * log_prob.sum()).backward()
    ours = squash(output.detach(), noise)
    torch.testing.assert_close(ours.action, u.tanh().detach(), rtol=1e-5, atol=1e-6)
    torch.testing.assert_close(ours.log_prob, log_prob.sum(-1).detach(), rtol=1e-5, atol=1e-4)
    gradient = squash_backward(ours, noise, weight, 0.3)
    assert output.grad is not None
    torch.testing.assert_close(gradient, output.grad, rtol=1e-4, atol=1e-4)
