"""The tanh-Gaussian actor and the twin critics: TorchRL's modules, and the same functions on networks side by side."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
import torch.nn.functional as F
from tensordict.nn import NormalParamExtractor, TensorDictModule
from torch import Tensor, nn
from torchrl.modules import MLP, ProbabilisticActor, TanhNormal, ValueOperator

from credit.networks.stack import Shape, Stack

CRITICS = 2
SCALE_FLOOR = 0.01
SCALE_BIAS = math.log(math.expm1(1 - SCALE_FLOOR))  # σ = 1 where the network says 0, as in NormalParamExtractor


class Squashed(NamedTuple):
    """A sampled action a = tanh(u) [..., A], its log-probability [...], and the deviation σ [..., A] of u."""

    action: Tensor
    log_prob: Tensor
    scale: Tensor


def encoded(states: Tensor, size: int) -> Tensor:
    """What networks see of states: vectors [..., O] as they are, numbers [...] one-hot [..., size]."""
    return states if states.is_floating_point() else F.one_hot(states, size).float()


def deviation(raw: Tensor) -> Tensor:
    """σ = floor + softplus(raw + bias)."""
    return F.softplus(raw + SCALE_BIAS).add_(SCALE_FLOOR)


def squash(output: Tensor, noise: Tensor) -> Squashed:
    """a = tanh(μ + σ·ε) from an actor's output [..., 2A] and standard normal ε [..., A].

    log π(a) = Σ [−ε²/2 − log σ − ½ log 2π − log(1 − tanh² u)], the last term in the form that does not overflow.
    """
    loc, raw = output.chunk(2, -1)
    scale = deviation(raw)
    u = torch.addcmul(loc, scale, noise)
    terms = (u - F.logsigmoid(2 * u)).mul_(2).sub_(scale.log()).sub_(noise.square(), alpha=0.5)
    constant = noise.shape[-1] * (0.5 * math.log(2 * math.pi) + 2 * math.log(2))
    return Squashed(u.tanh_(), terms.sum(-1).sub_(constant), scale)


def squash_backward(squashed: Squashed, noise: Tensor, by_action: Tensor, by_log_prob: Tensor | float) -> Tensor:
    """Gradient by an actor's output [..., 2A], from those by the action [..., A] and the log-probability.

    d log π/du = 2·tanh u, da/du = 1 − a², and dσ/draw = 1 − exp(floor − σ).
    """
    action, _, scale = squashed
    by_u = torch.addcmul(by_action, action.square(), by_action, value=-1).add_(2 * by_log_prob * action)
    by_scale = torch.addcmul(-by_log_prob / scale, by_u, noise)
    by_raw = by_scale.mul_(torch.expm1(SCALE_FLOOR - scale)).neg_()
    return torch.cat([by_u, by_raw], -1)


def actor_module(shape: Shape) -> ProbabilisticActor:
    """TorchRL's actor of a shape: `observation` → `action`, with fresh weights."""
    network = nn.Sequential(_mlp(shape), NormalParamExtractor())
    return ProbabilisticActor(
        TensorDictModule(network, in_keys=["observation"], out_keys=["loc", "scale"]),
        in_keys=["loc", "scale"],
        distribution_class=TanhNormal,
        return_log_prob=True,
    )


def critic_module(shape: Shape) -> ValueOperator:
    """TorchRL's critic of a shape: `observation`, `action` → `state_action_value`, with fresh weights."""
    return ValueOperator(_mlp(shape), in_keys=["observation", "action"])


def extract_actor(stack: Stack, member: int) -> ProbabilisticActor:
    """One actor of a stack as TorchRL has it, a copy."""
    module = actor_module(stack.shape)
    module[0].module[0].load_state_dict(stack.state(member))
    return module


def _mlp(shape: Shape) -> MLP:
    return MLP(
        in_features=shape.inputs,
        out_features=shape.outputs,
        depth=shape.depth,
        num_cells=shape.width,
        activation_class=nn.ReLU,
        norm_class=nn.LayerNorm if shape.norm else None,
        norm_kwargs={"normalized_shape": shape.width} if shape.norm else None,
    )
