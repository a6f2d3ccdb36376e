"""Checks that a reader is owed, against numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from credit.logged.claims import durbin_watson, robustness_value
from tests.logged.fits.test_units import windows


def test_durbin_watson_counts_pairs_of_a_group() -> None:
    residuals = np.array([1.0, -1, 2, np.nan, 3, 1])
    wanted = (4 + 9 + 4) / (1 + 1 + 4 + 9 + 1)
    assert durbin_watson(residuals, windows(2, 3)) == pytest.approx(wanted)
    assert np.isnan(durbin_watson(np.zeros(6), windows(2, 3)))


def test_the_robustness_value_is_that_of_its_paper() -> None:
    """Cinelli and Hazlett (2020), table 1: t = 4.18 with 783 degrees of freedom, 13.9%."""
    assert robustness_value(4.18, 783) == pytest.approx(0.139, abs=5e-4)
    assert robustness_value(0, 100) == 0
    assert robustness_value(-4.18, 783) == robustness_value(4.18, 783)
