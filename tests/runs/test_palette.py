"""Colours of curves."""

from __future__ import annotations

from itertools import combinations

from credit.runs.palette import nth


def test_forty_curves_have_forty_colours() -> None:
    colours = [[int(nth(number)[place : place + 2], 16) for place in (1, 3, 5)] for number in range(40)]
    nearest = min(sum(abs(a - b) for a, b in zip(one, other, strict=True)) for one, other in combinations(colours, 2))
    assert nearest > 15, "no two are the same to the eye"
