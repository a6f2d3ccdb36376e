"""How the numbers of a column are printed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pandas as pd

from credit.report.statistics import Interval

UNKNOWN = "–"
SUPERSCRIPTS = "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"


DIGITS = 1e7  # a number has at most seven
LARGEST, SMALLEST = 1e6, 1e-3  # what a wide column prints without a power of ten


@dataclass(frozen=True)
class Scale:
    """Numbers are divided by 10^exponent and printed with so many decimals, or, in a wide column, each by itself."""

    exponent: int
    decimals: int
    wide: bool = False

    @classmethod
    def of(cls, means: pd.Series[float], errors: pd.Series[float]) -> Scale:
        """The scale of a column: a power of a thousand where all means are very large or very small.

        The smallest standard error shows two digits, or one where its first digit is 5 or more; without
        errors the smallest mean shows three. No such scale serves both 3e-11 and 3e-3: a column is wide in which a
        number would have more than seven digits, or an error, or a mean beyond its error, none but zeros.

        Args:
            means: one a row of the table, NaN = not known.
            errors: their standard errors, NaN = not known.
        """
        # what is zero, and the error of equal scores, may be left as rounding
        tiny = 1e-9 * means.abs().max()
        sizes, spreads = means.abs()[means.abs() > tiny], errors[errors > tiny]
        exponent = 0
        if len(sizes) and (sizes.min() >= 1e4 or sizes.max() < 0.05):
            exponent = 3 * math.floor(math.log10(sizes.min()) / 3)
        if len(spreads):
            digits = _digits(spreads.min() / 10**exponent)
        else:
            digits = 2 - math.floor(math.log10(sizes.min() / 10**exponent)) if len(sizes) else 0
        decimals = min(max(digits, 0), 3)
        last = cls(exponent, decimals)._last
        clear = pd.concat([spreads, sizes[~(errors >= means.abs())]])
        return cls(exponent, decimals, bool((sizes >= DIGITS * last).any() or (clear < 0.5 * last).any()))

    @property
    def unit(self) -> str:
        """` (×10³)`, or nothing where the numbers are printed as they are."""
        return f" (×10{_raised(self.exponent)})" if self.exponent and not self.wide else ""

    def number(self, value: float, signed: bool = False) -> str:
        """One number; an unknown one is a dash."""
        if pd.isna(value):
            return UNKNOWN
        if self.wide:
            return _alone(value, _digits(value), signed)
        return _fixed(value / 10**self.exponent, self.decimals, signed)

    def with_error(self, mean: float, error: float) -> str:
        """`mean ± standard error`, or the mean alone where there is no error; only what is zero is printed as zeros."""
        known = [value for value in (mean, error) if not pd.isna(value)]
        if not any(known):
            return " ± ".join("0" for _ in known) or UNKNOWN
        if not self.wide and any(abs(value) >= 0.5 * self._last for value in known):
            return " ± ".join(map(self.number, known))
        known = [value / (1 if self.wide else 10.0**self.exponent) for value in known]
        if len(known) == 1:
            return _alone(known[0], _digits(known[0]), False)
        power, decimals = _power(max(map(abs, known))), _digits(known[1] or known[0])
        numbers = " ± ".join(_fixed(value / 10**power, _kept(decimals, power)) for value in known)
        return f"({numbers})×10{_raised(power)}" if power else numbers

    @property
    def _last(self) -> float:
        """The unit of the last digit."""
        return 10.0 ** (self.exponent - self.decimals)

    def interval(self, interval: Interval, signed: bool = False) -> tuple[str, str]:
        """The value and `[low, high]`, empty where there is none; in a wide column its width sets the digits."""
        if pd.isna(interval.low):
            return self.number(interval.value, signed), ""
        half = (interval.high - interval.low) / 2
        if self.wide and half > 0:
            value, low, high = (_alone(number, max(_digits(half), 0), signed) for number in interval)
        else:
            value, low, high = (self.number(number, signed) for number in interval)
        return value, f"[{low}, {high}]"


def _fixed(value: float, decimals: int, signed: bool = False) -> str:
    return f"{value:{'+' if signed else ''}.{decimals}f}".replace("-", "−")


def _raised(power: int) -> str:
    return str(power).translate(str.maketrans("-0123456789", SUPERSCRIPTS))


def _power(size: float) -> int:
    """The power of ten that is printed beside a number of this size, if it calls for one."""
    return 0 if size == 0 or SMALLEST <= abs(size) < LARGEST else math.floor(math.log10(abs(size)))


def _digits(size: float) -> int:
    """Decimals that show two digits of a number, or one where its first digit is 5 or more."""
    return 1 - math.floor(math.log10(2 * abs(size))) if size else 0


def _kept(decimals: int, power: int) -> int:
    """Decimals that are left beside a power of ten; an error of rounding asks for no more than five."""
    return min(max(decimals + power, 0), 5)


def _alone(value: float, decimals: int, signed: bool) -> str:
    """One number of a wide column, to two digits."""
    power = _power(value)
    number = _fixed(value / 10**power, _kept(decimals, power), signed)
    return f"{number}×10{_raised(power)}" if power else number
