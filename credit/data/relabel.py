"""Which rows of a replay get new rewards where not all do: a share of the oldest, or those that are sampled."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence


def oldest(ages: Tensor, first: Sequence[int], before: Sequence[int], after: Sequence[int], share: float) -> Tensor:
    """The new rows of each replica, and a share of the others: those first whose rewards are the oldest.

    Args:
        ages: when each row was labelled last [R, n]. first: the oldest row that is remembered. before, after: how many
            rows there were, and are. share: of those between first and before.

    Returns:
        Whether each row is one of them [R, after].
    """
    chosen = torch.zeros(len(ages), max(after), dtype=torch.bool, device=ages.device)
    for own, age, begin, old, new in zip(chosen, ages, first, before, after, strict=True):
        count = math.ceil(share * max(0, old - begin))
        own[begin + age[begin:old].argsort(stable=True)[:count]] = True
        own[old:new] = True
    return chosen


def needed(rows: Tensor, last: Tensor, replica: Tensor | int, shape: torch.Size) -> Tensor:
    """The rows from `rows` [...] to `last` [...] of a replica, as a mask of this shape [R, n]."""
    steps = torch.zeros(shape[0], shape[1] + 1, dtype=torch.int32, device=rows.device)
    replicas = torch.as_tensor(replica, device=rows.device).expand_as(rows)
    one = torch.ones_like(rows, dtype=torch.int32)
    steps.index_put_((replicas, rows), one, accumulate=True)
    steps.index_put_((replicas, last + 1), -one, accumulate=True)
    return steps.cumsum(1)[:, :-1] > 0


def numbers(mask: Tensor) -> Tensor:
    """The places [R, m] at which a mask [R, n] is true, in order; n behind the last of a replica."""
    places = mask.nonzero()[:, 1].split(mask.sum(1).tolist())
    return pad_sequence(list(places), batch_first=True, padding_value=mask.shape[1])
