"""What is carried from row to row of a group: values of rows before, and what is left of them.

A loop stands for each, which Numba compiles at its first call. It takes a column of a part and what the part before it
left, so that windows and parts are no borders, and groups are.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from credit.core.kept import kept
from credit.logged.panel import Floats, Ints

NOTHING = np.empty(0)


def lag(x: Floats, k: int, group: Ints, before: Floats, stock: bool = False) -> tuple[Floats, Floats]:
    """The value k rows before in the same group.

    Args:
        x: [n]. k: rows, at least 0. group: of each row [n].
        before: what the part before left of the first row's group [≤ k]; `NOTHING` where it begins.
        stock: where a group has no row so early, a level is taken to have been its first value, and a flow 0.

    Returns:
        [n], and what this part leaves [≤ k].
    """
    if k == 0 or not len(x):
        return x.copy(), before
    values = np.empty(len(x))
    begin = _compiled(_lag)(x, k, group, before, stock, values)
    last = x[max(begin, len(x) - k) :]
    return values, np.concatenate([before, last])[-k:] if begin == 0 else last.copy()


def adstock(x: Floats, decay: float, group: Ints, before: Floats) -> tuple[Floats, Floats]:
    """y_t = x_t + decay · y_{t−1}: what was done in a row, and what is left of all before it in the group.

    Args:
        x: [n]. decay: in [0, 1). group: of each row [n].
        before: y of the row before [1]; `NOTHING` where there is none.

    Returns:
        y [n], and what this part leaves [1].
    """
    if not len(x):
        return x.copy(), before
    values = np.empty(len(x))
    _compiled(_adstock)(x, decay, group, float(before[0]) if len(before) else 0.0, values)
    return values, values[-1:].copy()


def piecewise(x: Floats, breaks: Floats, coefficients: Floats, values: Floats) -> None:
    """Polynomials between breaks, the first and the last of which go on beyond.

    Args:
        x: [n]. breaks: ascending [m + 1].
        coefficients: of 1, t, t², … with t = −1 … 1 from break to break, [m, k, degree + 1].
        values: to be filled [n, k].
    """
    _compiled(_piecewise)(x, breaks, coefficients, values)


def _lag(x: Floats, k: int, group: Ints, before: Floats, stock: bool, values: Floats) -> int:
    begin, have = 0, len(before)
    for i in range(len(x)):
        if i > 0 and group[i] != group[i - 1]:
            begin, have = i, 0
        back = i - k
        if back >= begin:
            values[i] = x[back]
        elif have > 0 and have + back >= 0:  # rows of the part before; begin is 0
            values[i] = before[have + back]
        elif stock:
            values[i] = before[0] if have > 0 else x[begin]
        else:
            values[i] = 0.0
    return begin


def _adstock(x: Floats, decay: float, group: Ints, before: float, values: Floats) -> None:
    left = before
    for i in range(len(x)):
        if i > 0 and group[i] != group[i - 1]:
            left = 0.0
        left = x[i] + decay * left
        values[i] = left


def _piecewise(x: Floats, breaks: Floats, coefficients: Floats, values: Floats) -> None:
    pieces, columns, powers = coefficients.shape
    for i in range(len(x)):
        piece, above = 0, pieces  # the piece whose first break is the last that is not above x
        while above - piece > 1:
            middle = (piece + above) // 2
            if x[i] >= breaks[middle]:
                piece = middle
            else:
                above = middle
        t = 2.0 * (x[i] - breaks[piece]) / (breaks[piece + 1] - breaks[piece]) - 1.0
        for j in range(columns):
            value = 0.0
            for p in range(powers - 1, -1, -1):
                value = value * t + coefficients[piece, j, p]
            values[i, j] = value


@cache
def _compiled(loop: Callable[..., Any]) -> Callable[..., Any]:
    compiled: Callable[..., Any] = kept(loop, nogil=True)
    return compiled
