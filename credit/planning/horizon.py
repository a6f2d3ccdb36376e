"""Backward induction over a finite horizon: the best policy, and what a policy is worth."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from credit.core.errors import UserError
from credit.planning.solve import first_best

Ahead = Callable[[Tensor], Tensor]  # values [..., S] of the next step → values of actions [..., S, A]


def backward(ahead: Ahead, last: Tensor, horizon: int) -> tuple[Tensor, Tensor]:
    """The best values [T+1, S] and a policy [T, S] that attains them, of ties the first action.

    Args:
        ahead: one step back. last: the values behind the horizon [S]. horizon: T.

    Raises:
        UserError: no step to plan.
    """
    values, policy = [last], list[Tensor]()
    for _ in range(steps(horizon)):
        found = ahead(values[0])
        values.insert(0, found.amax(-1))
        policy.insert(0, first_best(found))
    return torch.stack(values), torch.stack(policy)


def worth(ahead: Ahead, last: Tensor, initial: Tensor, policy: Tensor) -> Tensor:
    """The value [R] of policies under the initial distribution [S].

    Args:
        ahead, last: as in `backward`.
        policy: actions [R, T, S] int64, or probabilities of actions [R, T, S, A]; T is the horizon.

    Raises:
        UserError: no step to evaluate.
    """
    value = last.unsqueeze(0)
    for t in reversed(range(steps(policy.shape[1]))):
        found, chosen = ahead(value), policy[:, t].cpu()
        if policy.dim() == 4:
            value = (found * chosen).sum(-1)
        else:
            value = found.expand(len(chosen), -1, -1).gather(-1, chosen.unsqueeze(-1)).squeeze(-1)
    return (value * initial).sum(-1)


def steps(horizon: int) -> int:
    """A horizon that is one.

    Raises:
        UserError: it has no step.
    """
    if horizon < 1:
        raise UserError(f"horizon={horizon}: an episode has at least 1 step")
    return horizon
