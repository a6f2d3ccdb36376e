"""Credit that adds up: by hand, by a search that sorts, and where it cannot."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from credit.core.errors import UserError
from credit.logged.panel import LabelIs
from credit.logged.residuals.balance import balanced

from .peers import sums


def test_a_residual_is_shared_alike_by_hand() -> None:
    credit, steps = np.array([1.0, 2, 3, 4, 5]), np.array([2, 2, 1])
    label = np.array([5.0, np.nan, 1])
    np.testing.assert_allclose(balanced(credit, label, steps), [2, 3, 3, 4, 1])
    np.testing.assert_allclose(balanced(credit, label, steps, "mean"), [4.5, 5.5, 3, 4, 1])
    np.testing.assert_allclose(balanced(credit, label, steps, "last"), [1, 5, 3, 4, 1])
    np.testing.assert_array_equal(credit, [1, 2, 3, 4, 5])  # what was given is left alone


@pytest.mark.parametrize("label_is", ["sum", "mean", "last"])
def test_it_adds_up_whatever_the_size_of_credit(label_is: LabelIs) -> None:
    random = np.random.default_rng(0)
    steps = random.integers(1, 50, 200)
    credit = random.normal(size=int(steps.sum())) * 10.0 ** random.integers(-6, 7, int(steps.sum()))
    label = random.normal(size=200) * 10.0 ** random.integers(0, 7, 200)
    found = balanced(credit, label, steps, label_is, errors=random.normal(size=len(credit)))
    c = sums(steps, label_is)
    assert (np.abs(c @ found - label) <= 1e-12 * (np.abs(label) + c @ np.abs(found))).all()


def sorted_projection(values: np.ndarray, total: float) -> np.ndarray:
    """Held, Wolfe and Crowder (1974): the threshold from the sorted rows."""
    ordered = np.sort(values)[::-1]
    over = (np.cumsum(ordered) - total) / np.arange(1, len(values) + 1)
    last = np.flatnonzero(ordered > over)
    return np.maximum(values - over[last[-1]], 0) if len(last) else np.zeros(len(values))


@given(
    st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=12),
    st.one_of(st.just(0.0), st.floats(1e-3, 1e3)),
)
def test_no_row_below_zero_is_the_projection_by_sorting(values: list[float], total: float) -> None:
    credit = np.array([*values, -1.0, 4.0])  # another window behind
    steps = np.array([len(values), 2])
    found = balanced(credit, np.array([total, 3.0]), steps, nonnegative=True)
    np.testing.assert_allclose(found[:-2], sorted_projection(np.array(values), total), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found[-2:], [0, 3])
    assert found.min() >= 0
    assert found[:-2].sum() == pytest.approx(total, rel=1e-9)


def test_no_row_below_zero_of_means_last_rows_and_windows_without_a_label() -> None:
    credit, steps = np.array([-5.0, 1, -2, 3]), np.array([2, 2])
    np.testing.assert_allclose(balanced(credit, np.array([1.0, np.nan]), steps, "mean", nonnegative=True), [0, 2, 0, 3])
    np.testing.assert_allclose(balanced(credit, np.array([2.0, 0]), steps, "last", nonnegative=True), [0, 2, 0, 0])


def test_a_label_below_zero_is_named() -> None:
    label = np.array([1.0, -2, -3, -4, -0.5, np.nan])
    with pytest.raises(
        UserError, match=r"4 of 6 windows .* below 0.*: b \(-2\), c \(-3\), d \(-4\) and 1 more\..*false"
    ):
        balanced(np.ones(6), label, np.ones(6, dtype=int), nonnegative=True, ids=list("abcdef"))
    with pytest.raises(UserError, match=r": 1 \(-2\)"):
        balanced(np.ones(6), label, np.ones(6, dtype=int), nonnegative=True)


def test_bits_do_not_add_up() -> None:
    with pytest.raises(UserError, match=r"data\.label_is=binary"):
        balanced(np.ones(2), np.ones(1), np.array([2]), "binary")
