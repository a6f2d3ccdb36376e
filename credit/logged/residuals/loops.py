"""The recursions of `residuals`, compiled: over lengths, over windows, and over rows.

The table has a row for every length n that occurs. Of a, which is u before a window, and s, what its label has of u
(sum or last), it has φ = ρⁿ and b, where u_n = φ a + … and s = ρ b a + …; then, of what is added, the variance of
u_n, the covariance, and the variance of s. Here ε has variance 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from credit.core.compiled import Loop
from credit.logged.panel import Floats, Ints

Bits = NDArray[np.bool_]


@Loop
def table_of(lengths: Ints, rho: float, last: bool, table: Floats) -> None:
    """Fill the table [U, 5] of lengths [U], ascending, from 1."""
    power, total, uu, us, ss = 1.0, 0.0, 0.0, 0.0, 0.0
    n = 0
    for i in range(len(lengths)):
        while n < lengths[i]:
            total += power
            power *= rho
            uu = rho * rho * uu + 1.0
            ss += 2.0 * rho * us + uu
            us = rho * us + uu
            n += 1
        table[i, 0], table[i, 2] = power, uu
        if last:
            table[i, 1], table[i, 3], table[i, 4] = rho ** (n - 1), uu, uu
        else:
            table[i, 1], table[i, 3], table[i, 4] = total, us, ss


@Loop
def gains(kind: Ints, first: Bits, labelled: Bits, table: Floats, rho: float, gain: Floats, scale: Floats) -> float:
    """What a window's label says of u in its last row [W], and 1 / deviation of the label [W]; gives log |V|.

    The variance is kept as a sum of squares (Joseph's form), which does not fall below 0 where a label tells u exactly.
    """
    start = 1.0 / (1.0 - rho * rho)
    variance, logdet = start, 0.0
    for w in range(len(kind)):
        if first[w]:
            variance = start
        row = table[kind[w]]
        power, reach, uu, us, ss = row[0], rho * row[1], row[2], row[3], row[4]
        if not labelled[w]:
            gain[w] = scale[w] = 0.0
            variance = power * power * variance + uu
            continue
        seen = reach * reach * variance + ss
        g = (power * reach * variance + us) / seen
        variance = (power - g * reach) ** 2 * variance + max(uu - 2.0 * g * us + g * g * ss, 0.0)
        gain[w], scale[w] = g, 1.0 / np.sqrt(seen)
        logdet += np.log(seen)
    return logdet


@Loop
def innovations(
    values: Floats,
    kind: Ints,
    first: Bits,
    times: Floats,
    table: Floats,
    gain: Floats,
    scale: Floats,
    rho: float,
    out: Floats,
) -> None:
    """What is new in each window's values [W, k], in deviations: L⁻¹ of them."""
    columns = values.shape[1]
    state = np.zeros(columns)
    for w in range(len(kind)):
        if first[w]:
            state[:] = 0.0
        power, reach, g, inverse, t = table[kind[w], 0], rho * table[kind[w], 1], gain[w], scale[w], times[w]
        if inverse == 0.0:
            for j in range(columns):
                state[j] *= power
                out[w, j] = 0.0
        else:
            for j in range(columns):
                new = t * values[w, j] - reach * state[j]
                state[j] = power * state[j] + g * new
                out[w, j] = inverse * new


@Loop
def smoothed(
    whitened: Floats,
    kind: Ints,
    first: Bits,
    table: Floats,
    gain: Floats,
    scale: Floats,
    rho: float,
    before: Floats,
    pull: Floats,
    after: Floats,
) -> None:
    """L⁻ᵀ of what was whitened [W], from the end (Bryson and Frazier 1963), then u before each window, from the front.

    Where p is the expected ε of a window's first row, the adjoint of the filter's state is −ρ p.
    """
    p = 0.0
    for i in range(len(kind)):
        w = len(kind) - 1 - i
        if i == 0 or first[w + 1]:
            p = 0.0
        after[w] = p
        pull[w] = scale[w] * whitened[w] - gain[w] * rho * p
        p = table[kind[w], 1] * pull[w] + table[kind[w], 0] * p
        before[w] = p
    u = 0.0
    for w in range(len(kind)):
        if first[w]:
            u = rho * before[w] / (1.0 - rho * rho)  # u of the first row is p / (1 − ρ²)
        before[w] = u
        row = table[kind[w]]
        u = row[0] * u + row[3] * pull[w] + rho * row[2] * after[w]


@Loop
def unfolded(steps: Ints, before: Floats, pull: Floats, after: Floats, rho: float, last: bool, out: Floats) -> None:
    """u of every row [n]: within a window ε from the last row on, then u from the first."""
    begin = 0
    for w in range(len(steps)):
        end = begin + steps[w]
        p = rho * after[w]
        for t in range(end - 1, begin - 1, -1):
            if t == end - 1 or not last:
                p += pull[w]
            out[t] = p
            p *= rho
        u = before[w]
        for t in range(begin, end):
            u = rho * u + out[t]
            out[t] = u
        begin = end


@Loop
def products(rows: Floats, out: Floats) -> None:
    """Σ of rows' products, added to [k, k] out, in blocks, so that many of them round no more than few.

    A library's threads take 50 times as long for so narrow a matrix where others have the processor's cores.
    """
    columns = rows.shape[1]
    part = np.zeros((columns, columns))
    for w in range(len(rows)):
        for i in range(columns):
            x = rows[w, i]
            for j in range(columns):
                part[i, j] += x * rows[w, j]
        if w % 1024 == 1023 or w == len(rows) - 1:
            out += part
            part[:] = 0.0


@Loop
def squares(rows: Floats, by: Floats) -> float:
    """Σ (rowᵀ by)²."""
    total, part = 0.0, 0.0
    for w in range(len(rows)):
        value = 0.0
        for j in range(len(by)):
            value += rows[w, j] * by[j]
        part += value * value
        if w % 1024 == 1023 or w == len(rows) - 1:
            total += part
            part = 0.0
    return total
