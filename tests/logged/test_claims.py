"""Checks that a reader is owed, against numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from credit.logged.claims import durbin_watson, placebo, robustness_value
from tests.logged.fits.test_units import windows
from tests.logged.test_recovering import found, table


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


def test_the_next_windows_action_has_the_error_of_fits_without_each_unit(monkeypatch: pytest.MonkeyPatch) -> None:
    frame = table(windows=41)
    reference = {"formula": "1 + x + z", "regularization": 0}
    one = found(frame, reference=reference, surrogates={}, rho=0.0)
    sums = frame.groupby("w").agg({"x": "sum", "z": "sum", "y": "first"})
    lead = sums["x"].to_numpy()[1:]
    design = np.column_stack([np.full(40, 5.0), sums[["x", "z"]].to_numpy()[:-1], lead])
    label = sums["y"].to_numpy()[:-1]
    assert one.found.units.length == 1
    fits = [np.linalg.lstsq(design[np.arange(40) != at], label[np.arange(40) != at])[0][-1] for at in range(-1, 40)]
    error = np.sqrt(((np.array(fits[1:]) - fits[0]) ** 2).sum() * 40 / 41)  # the last window has no next one
    line = one.placebo.iloc[0]
    assert line["estimate"] == pytest.approx(fits[0])
    assert line["high"] - line["estimate"] == pytest.approx(error * one.found.units.quantile(0.9))
    monkeypatch.setattr("credit.logged.claims.MOST", 20)  # neighbours are left out together
    few = placebo(one.found).iloc[0]
    assert few["estimate"] == line["estimate"]
    assert 0.5 < (few["high"] - few["low"]) / (line["high"] - line["low"]) < 2


def test_one_window_a_series_has_no_next_one() -> None:
    frame = table(windows=1, groups=30).assign(t=np.tile(np.arange(5), 30))
    assert not found(frame, surrogates={}).placebo["explains"].any()
