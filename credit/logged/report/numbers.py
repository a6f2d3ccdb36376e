"""Numbers as a reader wants them: as many digits as they are sure."""

from __future__ import annotations

import math

NONE = "—"


def number(value: float, digits: int = 3) -> str:
    """A number with so many digits that count, and all before the point; — for none."""
    if not math.isfinite(value):
        return NONE
    if value == 0:
        return "0"
    return _fixed(value, digits - 1 - math.floor(math.log10(abs(value))))


def interval(value: float, low: float, high: float) -> tuple[str, str]:
    """A number and its interval, "4.44" and "4.40 to 4.48": with two digits of half the interval's width, and five at
    most; the second is empty where there is none."""
    half = (high - low) / 2
    if not (math.isfinite(value) and math.isfinite(half)) or half <= 0:
        return number(value, 4), ""
    places = min(1 - math.floor(math.log10(half)), 4 - math.floor(math.log10(max(abs(low), abs(high)))))
    return _fixed(value, places), f"{_fixed(low, places)} to {_fixed(high, places)}"


def percent(share: float) -> str:
    """A share as percent, with a digit behind the point where it is next to nothing, or to all, and not quite."""
    if not math.isfinite(share):
        return NONE
    if 0.99 < abs(share) < 1:
        return _fixed(math.copysign(min(abs(100 * share), 99.9), share), 1) + "%"
    return _fixed(100 * share, 0 if abs(share) >= 0.00995 or share == 0 else 1) + "%"


def short(words: object, most: int = 40) -> str:
    """Words in one line, and cut where they are longer."""
    line = " ".join(str(words).split()) or "(empty)"
    return line if len(line) <= most else line[: most - 1].rstrip() + "…"


def _fixed(value: float, places: int) -> str:
    rounded = round(value, places)
    if rounded and (abs(rounded) >= 1e15 or abs(rounded) < 1e-6):
        return f"{rounded:.3g}".replace("-", "−")
    return f"{rounded + 0.0:,.{max(places, 0)}f}".replace("-", "−")
