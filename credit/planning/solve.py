"""Dynamic programming on batches of tabular MDPs: exact, warm-started."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from credit.core.compiled import usable
from credit.core.tensors import matvec
from credit.planning import loops

# The average reward for all that data can tell, and unlike γ = 1 it has one solution where a model falls apart into
# several recurrent classes (self-loops, zero rows).
NEARLY_ONE = 1 - 1e-6

# Two action values this close are tied, and the first action wins: rounding may then differ between batch sizes.
TIE = 1e-9

SWEEPS = 100  # most evaluations of policy iteration


class Plan(NamedTuple):
    """An optimal policy and its value; gain [R], bias [R, S] with bias(0) = 0, policy [R, S], values [R, S, A]."""

    gain: Tensor
    bias: Tensor
    policy: Tensor
    values: Tensor


def policy_iteration(
    transition: Tensor, reward: Tensor, discount: float = 1.0, policy: Tensor | None = None, sweeps: int = SWEEPS
) -> Plan:
    """Howard's policy iteration for the average reward (discount 1) or the discounted return.

    A policy is evaluated by h(s) + g·c(s) = r(s, π(s)) + γ Σ P(s'|s, π(s)) h(s'), h(0) = 0, where c = 1 for rows that
    sum to one. At γ = 1 that is the average-reward equation (42), which has one solution in a unichain model. At γ < 1
    it is the discounted one, v = h + g/(1−γ), written so that the large common part of v does not eat its digits.

    Args:
        transition: P [R, S, A, S]; rows sum to one (at γ < 1 they may sum to less: the process then ends).
        reward: r [R, S, A] per step.
        discount: γ in (0, 1].
        policy: where to start [R, S]; a good guess saves sweeps.
        sweeps: most evaluations; the last policy is returned if they do not suffice.

    Returns:
        A Plan. Ties within 1e-9 of the scale of h keep the current action, else go to the first.
    """
    replicas, states, actions = reward.shape
    first = torch.arange(0, replicas * states * actions, actions, device=reward.device).view(replicas, states)
    rows = transition.reshape(-1, states)
    eye = torch.eye(states, dtype=reward.dtype, device=reward.device)
    common = torch.ones_like(reward)
    if discount < 1:
        common = (1 - discount * transition.sum(-1)) / (1 - discount)
    if policy is None:
        policy = torch.zeros(replicas, states, dtype=torch.int64, device=reward.device)
    for _ in range(sweeps):
        chosen = first + policy
        matrix = torch.sub(eye, rows[chosen], alpha=discount)
        matrix[:, :, 0] = common.take(chosen)
        solution = torch.linalg.solve_ex(matrix, reward.take(chosen))[0]
        gain = solution[:, 0].clone()
        solution[:, 0] = 0
        ahead = matvec(rows.view(replicas, -1, states), solution).view_as(reward)
        values = torch.add(reward, ahead, alpha=discount) - gain[:, None, None] * common
        best, current = values.amax(-1), values.take(chosen)
        tolerance = TIE * (1 + solution.abs().amax(1, keepdim=True))
        better = best > current + tolerance
        if not better.any():
            break
        policy = torch.where(better, _first(values, best - tolerance), policy)
    return Plan(gain, solution, policy, values)


def best_policy(transition: Tensor, reward: Tensor, discount: float, policy: Tensor) -> Tensor:
    """The policy of `policy_iteration` at γ < 1, from a first one [R, S] on."""
    if not usable(reward):
        return policy_iteration(transition, reward, discount, policy).policy
    policy = policy.clone()
    loops.improve(transition, reward.contiguous(), policy, discount, TIE, SWEEPS)
    return policy


def first_best(values: Tensor, tolerance: float = TIE) -> Tensor:
    """The first action [R, S] whose value [R, S, A] is within the tolerance of the best."""
    return _first(values, values.amax(-1) - tolerance)


def _first(values: Tensor, margin: Tensor) -> Tensor:
    """The first action [R, S] whose value [R, S, A] is no less than a margin [R, S]."""
    return (values >= margin.unsqueeze(-1)).to(torch.uint8).argmax(-1)


def average_optimum(transition: Tensor, reward: Tensor) -> Plan:
    """g*, h*, π* and action values of one MDP, P [S, A, S] and r [S, A], without the replica dimension.

    The policy is found at γ just below 1, where every policy has one value, and evaluated at γ = 1. Where even the best
    policy has several recurrent classes, the value stays that of γ just below 1.
    """
    model = (transition.unsqueeze(0), reward.unsqueeze(0))
    near = policy_iteration(*model, NEARLY_ONE)
    exact = policy_iteration(*model, 1.0, near.policy)
    sound = torch.isfinite(exact.values).all() and exact.values.abs().max() < 1e3 * (1 + near.values.abs().max())
    return Plan(*(part[0] for part in (exact if sound else near)))


def stationary(transition: Tensor, policy: Tensor, initial: Tensor | None = None) -> Tensor:
    """The stationary distribution [S] of a policy [S] in P [S, A, S].

    Where there are several, the one that is reached from the initial distribution [S] (uniform where it is not given).
    """
    states = policy.shape[0]
    if initial is None:
        initial = torch.full((states,), 1 / states, dtype=transition.dtype)
    chain = transition[torch.arange(states), policy]
    eye = torch.eye(states, dtype=chain.dtype)
    system = eye - chain.T
    system[0] = 1
    exact, singular = torch.linalg.solve_ex(system, eye[0])
    if singular or not (exact > -TIE).all():
        restarting = torch.linalg.solve(eye - NEARLY_ONE * chain.T, initial)
        return restarting / restarting.sum()
    return exact.clamp(min=0)


def diameter(transition: Tensor, sweeps: int = 1000) -> float:
    """D = max over s ≠ s' of the least expected time from s to s' (C.1.1), in steps; inf if one is never reached.

    For each goal, policy iteration on the time to reach it, from the uniform policy, which gets there if any does.
    """
    states = transition.shape[0]
    rows = torch.arange(states)
    eye = torch.eye(states, dtype=transition.dtype)
    reached = (eye + transition.sum(1)).sign()
    for _ in range(states.bit_length()):
        reached = (reached @ reached).sign()
    if not reached.all():
        return float("inf")
    longest = 0.0
    for goal in range(states):
        steps = torch.ones(states, dtype=transition.dtype)
        steps[goal] = 0
        moves = transition * steps * steps.view(-1, 1, 1)  # the trip ends at the goal
        chain = moves.mean(1)
        for _ in range(sweeps):
            times = torch.linalg.solve(eye - chain, steps)
            policy = (moves @ times).argmin(-1)
            better = moves[rows, policy]
            if (better @ times >= chain @ times - TIE).all():
                break
            chain = better
        longest = max(longest, float(times.max()))
    return longest
