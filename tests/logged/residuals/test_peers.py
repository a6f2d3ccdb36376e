"""The dense peers against the packages that people use, where those compute the same thing, and ours against both.

What differs was looked at, too (tempdisagg 0.2.13, aggdisagg 1.11.0), so that nobody compares with it by mistake.

tempdisagg: one indicator and no intercept; windows of other lengths are filled up with made rows, missing labels are
interpolated; `chow-lin-opt` takes σ² to be 1, so that its ρ depends on the unit of labels; `litterman` is an AR(1) that
begins at 0, `denton` is Fernández, ρ above .99 is .99.

aggdisagg: indicators are of windows, not of steps; the last month has 30 days; 1e-8 is added to the diagonal of V; a
missing label is 0; `chow-lin-opt` has the least r'r, not weighted by V⁻¹, which is that of ordinary least squares;
`litterman` has another covariance than Litterman's; `denton` returns stored numbers for three inputs.
"""

from __future__ import annotations

import datetime

import numpy as np
import pytest

from credit.logged.panel import LabelIs
from credit.logged.residuals.autocorrelation import estimated_rho
from credit.logged.residuals.balance import balanced
from credit.logged.residuals.whitening import Layout, errors

from .peers import chow_lin, denton, fernandez, litterman, sums, uniform

RHOS = [0.0, 0.5, 0.95]
CONVERSIONS: dict[LabelIs, str] = {"sum": "sum", "mean": "average", "last": "last"}


def ours(y: np.ndarray, x: np.ndarray, steps: np.ndarray, rho: float, label_is: LabelIs) -> np.ndarray:
    """Balanced credit at a given ρ, by what the package has."""
    layout = Layout.of(steps, np.zeros(len(steps), dtype=np.int64), np.isfinite(y), label_is)
    design = sums(steps, label_is) @ x
    found = estimated_rho(design, y, layout, low=rho, high=rho)
    left = errors(y - design @ found.theta, layout, rho)
    return balanced(x @ found.theta, y, steps, label_is, errors=left.rows())


def monthly() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """An indicator, steps of windows, and a step's value of what is to be found."""
    random = np.random.default_rng(0)
    x = random.uniform(10, 30, 48)
    return x, np.full(12, 4), 2 * x + np.cumsum(random.normal(size=48))


@pytest.mark.parametrize("label_is", [*CONVERSIONS])
@pytest.mark.parametrize("rho", RHOS)
def test_tempdisagg_has_the_same_steps_at_the_same_rho(rho: float, label_is: LabelIs) -> None:
    handler = pytest.importorskip("tempdisagg.model.models_handler").ModelsHandler()
    x, steps, truth = monthly()
    c = sums(steps, label_is)
    y = c @ truth
    theirs = handler.chow_lin_estimation(y, x, c, rho=rho)["y_hat"][:, 0]
    np.testing.assert_allclose(chow_lin(y, x[:, None], steps, rho, label_is), theirs, rtol=1e-10)
    np.testing.assert_allclose(ours(y, x[:, None], steps, rho, label_is), theirs, rtol=1e-8)
    theirs = handler.fernandez_estimation(y, x, c)["y_hat"][:, 0]
    np.testing.assert_allclose(fernandez(y, x[:, None], steps, label_is), theirs, rtol=1e-10)


@pytest.mark.parametrize("label_is", [*CONVERSIONS])
def test_tempdisagg_has_the_same_steps_by_its_front_door(label_is: LabelIs) -> None:
    tempdisagg, pd = pytest.importorskip("tempdisagg"), pytest.importorskip("pandas")
    x, steps, truth = monthly()
    y = sums(steps, label_is) @ truth
    frame = pd.DataFrame({"Index": np.repeat(np.arange(12), 4), "Grain": np.tile(np.arange(4), 12), "X": x})
    frame["y"] = np.repeat(y, 4)
    for method, rho in (("chow-lin", 0.5), ("chow-lin-ecotrim", 0.75), ("chow-lin-quilis", 0.15)):
        model = tempdisagg.TempDisaggModel(method=method, conversion=CONVERSIONS[label_is]).fit(frame)
        np.testing.assert_allclose(ours(y, x[:, None], steps, rho, label_is), model.predict()[:, 0], rtol=1e-8)


@pytest.mark.parametrize("label_is", [*CONVERSIONS])
@pytest.mark.parametrize("rho", RHOS)
def test_aggdisagg_has_the_same_steps_on_a_trend(rho: float, label_is: LabelIs) -> None:
    """Months of uneven lengths from labels; its only indicators within a window are an intercept and a trend."""
    aggdisagg, pl = pytest.importorskip("aggdisagg"), pytest.importorskip("polars")
    dates = [datetime.date(2024 + month // 12, 1 + month % 12, 1) for month in range(11)]
    y = 3000 + np.cumsum(np.random.default_rng(1).normal(size=11) * 20)
    steps = np.array([31, 29, 31, 30, 31, 30, 31, 31, 30, 31, 30])
    x = np.column_stack([np.ones(steps.sum()), np.arange(steps.sum()) / steps.sum()])
    aligner = aggdisagg.TemporalAligner("chow-lin", target_freq="1d", agg=label_is, rho=rho)
    theirs = aligner.fit_transform(pl.DataFrame({"date": dates, "y": y}))["y_disaggregated"].to_numpy()
    np.testing.assert_allclose(chow_lin(y, x, steps, rho, label_is), theirs, rtol=1e-7)
    np.testing.assert_allclose(ours(y, x, steps, rho, label_is), theirs, rtol=1e-7)
    np.testing.assert_allclose(ours(y, x, steps, rho, label_is), chow_lin(y, x, steps, rho, label_is), rtol=1e-8)


def test_the_estimated_rho_is_that_of_the_dense_likelihood() -> None:
    x, steps, truth = monthly()
    steps = np.array([4, 4, 3, 5, 4, 4, 2, 6, 4, 4, 4, 4])
    y, columns = sums(steps) @ truth, np.column_stack([np.ones(48), x])
    layout = Layout.of(steps, np.zeros(12, dtype=np.int64), np.ones(12, dtype=bool))
    rho = estimated_rho(sums(steps) @ columns, y, layout).rho
    assert 0 < rho < 0.999
    dense = chow_lin(y, columns, steps)
    np.testing.assert_allclose(ours(y, columns, steps, rho, "sum"), dense, rtol=1e-3)


@pytest.mark.parametrize("label_is", [*CONVERSIONS])
def test_all_peers_add_up(label_is: LabelIs) -> None:
    x, steps, truth = monthly()
    c = sums(steps, label_is)
    y, columns = c @ truth, np.column_stack([np.ones(48), x])
    found = [
        chow_lin(y, columns, steps, None, label_is),
        litterman(y, columns, steps, None, label_is),
        litterman(y, columns, steps, 0.4, label_is),
        fernandez(y, columns, steps, label_is),
        denton(y, x, steps, label_is),
        denton(y, x, steps, label_is, proportional=True),
        uniform(y, steps, label_is),
    ]
    for each in found:
        np.testing.assert_allclose(c @ each, y, rtol=1e-7)


def test_denton_keeps_what_is_already_smooth() -> None:
    """A constant share more adds nothing to the differences, and a constant factor nothing to those of the ratio."""
    x, steps, _ = monthly()
    c = sums(steps)
    np.testing.assert_allclose(denton(c @ (x + 3), x, steps), x + 3, rtol=1e-8)
    np.testing.assert_allclose(denton(c @ (x * 3), x, steps, proportional=True), x * 3, rtol=1e-8)
