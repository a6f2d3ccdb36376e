"""How the numbers of a column are printed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pandas as pd

from credit.report.statistics import Interval

UNKNOWN = "–"
SUPERSCRIPTS = "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"


@dataclass(frozen=True)
class Scale:
    """Numbers are divided by 10^exponent and printed with so many decimals."""

    exponent: int
    decimals: int

    @classmethod
    def of(cls, means: pd.Series[float], errors: pd.Series[float]) -> Scale:
        """The scale of a column: a power of a thousand where all means are very large or very small.

        The smallest standard error shows two digits, or one where its first digit is 5 or more; without
        errors the smallest mean shows three.

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
            digits = 1 - math.floor(math.log10(2 * spreads.min() / 10**exponent))
        else:
            digits = 2 - math.floor(math.log10(sizes.min() / 10**exponent)) if len(sizes) else 0
        return cls(exponent, min(max(digits, 0), 3))

    @property
    def unit(self) -> str:
        """` (×10³)`, or nothing where the numbers are printed as they are."""
        power = str(self.exponent).translate(str.maketrans("-0123456789", SUPERSCRIPTS))
        return f" (×10{power})" if self.exponent else ""

    def number(self, value: float, signed: bool = False) -> str:
        """One number; an unknown one is a dash."""
        if pd.isna(value):
            return UNKNOWN
        text = f"{value / 10**self.exponent:{'+' if signed else ''}.{self.decimals}f}"
        return text.replace("-", "−")

    def with_error(self, mean: float, error: float) -> str:
        """`mean ± standard error`, or the mean alone where there is no error."""
        return self.number(mean) if pd.isna(error) else f"{self.number(mean)} ± {self.number(error)}"

    def ends(self, interval: Interval, signed: bool = False) -> str:
        """`[low, high]`, or nothing where there is no interval."""
        if pd.isna(interval.low):
            return ""
        return f"[{self.number(interval.low, signed)}, {self.number(interval.high, signed)}]"
