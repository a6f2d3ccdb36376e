"""Thirds of a feature hold about as many rows each, as far as ties allow, and are called by what is in them."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from credit.logged.binning import Bin, binned, name
from credit.logged.panel import Column


def column(values: np.ndarray) -> Column:
    quantiles = tuple(np.quantile(values, np.linspace(0, 1, 21)))
    return Column("x", least=float(values.min()), most=float(values.max()), quantiles=quantiles)


def bins(values: np.ndarray) -> dict[str, int]:
    own = column(values)
    return {name(own, number, one): int(one.sums[0]) for number, _, one in binned(pd.Series(values), own)}


def bits(share: float) -> np.ndarray:
    return (np.arange(200) < 200 * share).astype(float)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.5, 0.7, 0.98])
def test_a_feature_that_is_0_or_1_has_two_bins(share: float) -> None:
    assert bins(bits(share)) == {"0": round(200 * (1 - share)), "1": round(200 * share)}


@pytest.mark.parametrize("zeros", [0.0, 0.3, 0.6, 0.66, 0.9])
def test_where_a_value_is_frequent_the_others_share_the_rest(zeros: float) -> None:
    values = np.random.default_rng(0).gamma(2.0, size=3000)
    values[: int(3000 * zeros)] = 0
    counts = [*bins(values).values()]
    if zeros < 0.34:
        np.testing.assert_allclose(counts, 1000, atol=120)
    else:
        assert counts[0] == 3000 * zeros
        np.testing.assert_allclose(counts[1:], 1500 * (1 - zeros), atol=160)


def test_few_numbers_are_called_by_their_names() -> None:
    assert bins(np.repeat([1.0, 2, 3], 40)) == {"1": 40, "2": 40, "3": 40}
    assert bins(np.full(10, 4.0)) == {"4": 10}
    assert sum(bins(np.arange(7.0).repeat(30)).values()) == 210


def test_parts_of_a_table_are_added_up() -> None:
    values = np.arange(90.0)
    own, found = column(values), dict[int, Bin]()
    for part in (values[:50], values[50:]):
        for number, rows, one in binned(pd.Series(part), own):
            assert rows.sum() == one.sums[0]
            found[number] = found[number].add(one) if number in found else one
    assert {name(own, number, one): one.sums[0] for number, one in found.items()} == bins(values)
