"""Decays between candidates: a Newton step against least squares on the columns themselves, and where it leads."""

from __future__ import annotations

import numpy as np
import pandas as pd

import credit
from credit.logged.fits.folds import folds_of
from credit.logged.fits.linear import Fitting
from credit.logged.fits.refining import MOST, refined
from credit.logged.formulas.terms import Terms
from credit.logged.models import Model, windowed
from credit.logged.tables.opening import opened

WEEKS, DAYS = 120, 7


def table(decay: float, noise: float, worth: float = 2.0) -> pd.DataFrame:
    """Days whose x acts on those that follow."""
    random = np.random.default_rng(3)
    x = random.gamma(2.0, size=WEEKS * DAYS) * (random.uniform(size=WEEKS * DAYS) < 0.3)
    carried = x.copy()
    for t in range(1, len(x)):
        carried[t] += decay * carried[t - 1]
    label = (5 + worth * carried).reshape(WEEKS, DAYS).sum(1) + noise * random.normal(size=WEEKS)
    return pd.DataFrame(
        {"w": np.repeat(np.arange(WEEKS), DAYS), "t": np.arange(len(x)), "x": x, "y": np.repeat(label, DAYS)}
    )


WORDS = {"window": "w", "label": "y", "time": "t", "actions": ["x"], "states": []}


def test_the_step_is_that_of_least_squares() -> None:
    panel = opened(table(0.5, 0.3), WORDS)
    terms = Terms.of("1 + adstock(x)", panel.columns, panel.roles)
    (x,), y = windowed(panel, [Model("reference", terms)])[0], panel.windows.label
    fitting = Fitting(folds_of(panel.windows, 5, 0), None)
    pieces = fitting.moments(x, y, panel.windows.labelled)
    fit = fitting.fit(terms, pieces, 0.001)
    found = refined(terms, pieces.sum(0), fit)["adstock(x)"]
    (free,) = terms.choices
    own = int(fit.chosen[0, 0])
    assert free.decays[own] in (0.4, 0.6)
    beta = fit.theta[0, free.columns[own][0]]
    change = (x[:, free.columns[own + 1][0]] - x[:, free.columns[own - 1][0]]) / 0.4 * beta
    step = np.linalg.lstsq(np.stack([x[:, 0], x[:, free.columns[own][0]], change], 1), y, rcond=None)[0][2]
    there = free.decays[own] + step
    ends = sorted([free.decays[own], there])
    beyond = max(0.25 * abs(step), 0.01)
    np.testing.assert_allclose([found[0], found[-1]], [ends[0] - beyond, ends[1] + beyond], atol=2e-3)
    assert found[0] < 0.5 < found[-1]
    assert free.decays[own] in found


def test_a_decay_between_candidates_is_found_and_what_it_is_worth_lies_within_the_interval() -> None:
    found = credit.recover(table(0.5, 1.0), draws=40, reference="1 + adstock(x)", surrogates={}, **WORDS)
    text = found.chosen["reference"]["adstock(x)"]
    assert abs(float(text.rpartition(", ")[2].rstrip(")")) - 0.5) < 0.03
    line = found.effects.iloc[0]
    total = table(0.5, 0.0)["y"].sum() / DAYS - 5 * WEEKS * DAYS
    assert line["total_low"] < total < line["total_high"]
    assert len(np.unique(found.found.fits[0].chosen)) > 1  # draws choose their own


def test_what_does_nothing_is_looked_for_everywhere() -> None:
    found = credit.recover(table(0.5, 3.0, worth=0.0), draws=40, reference="1 + adstock(x)", surrogates={}, **WORDS)
    decays = found.found.models[0].terms.decays["adstock(x)"]
    assert decays[0] == 0
    assert decays[-1] >= 0.9
    assert decays[-1] <= MOST


def test_candidates_that_were_given_stay() -> None:
    words = {"reference": "1 + adstock(x, [.2, .8])", "surrogates": {}, **WORDS}
    found = credit.recover(table(0.5, 1.0), draws=20, **words)
    assert found.found.models[0].terms.decays == {}
    (free,) = found.found.models[0].terms.choices
    assert [one.rpartition(", ")[2] for one in free.candidates] == ["0.2)", "0.8)"]


def test_refined_terms_are_saved_and_read_again() -> None:
    panel = opened(table(0.5, 1.0), WORDS)
    terms = Terms.of("1 + x + x:adstock(x)", panel.columns, panel.roles).refined({"adstock(x)": (0.1, 0.15)})
    again = Terms.from_dict(terms.to_dict())
    assert again.names == terms.names
    assert [one.candidates for one in again.choices] == [("adstock(x, 0.1)", "adstock(x, 0.15)")]
    part = next(panel.parts())
    np.testing.assert_array_equal(again.design(part, {}), terms.design(part, {}))
