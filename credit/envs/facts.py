"""What an environment says of a step beside what is seen: one reward, and whether it is a success under some key."""

from __future__ import annotations

from typing import Any

import numpy as np

SUCCESS = ("success", "is_success")  # keys under which environments report one
REWARD = "reward"  # says that a positive reward is one


def looked_for(success: str) -> tuple[str, ...]:
    """The keys under which a success may be told: those of all, or the one that is named; none where it is the reward.

    Example:
        >>> looked_for("auto")
        ('success', 'is_success')
    """
    return SUCCESS if success == "auto" else () if success == REWARD else (success,)


def number(value: Any) -> float:
    """One number, of whatever holds one: a float, an array or a tensor.

    Raises:
        ValueError: it holds another number of them, or none.

    Example:
        >>> number(np.array([1.0]))
        1.0
    """
    if isinstance(value, (float, int, np.number, np.bool_)):  # first, since this is asked in every step
        return float(value)
    array = np.asarray(value)
    if array.size != 1 or array.dtype.kind not in "biuf":
        raise ValueError(f"{value!r} is not one number")
    return float(array.reshape(()))
