"""A marketing panel whose truth is known: days and what was spent, weeks and what was sold.

    python examples/marketing.py                 # writes marketing.csv, ten regions over three years
    credit recover examples/marketing.csv        # what was each channel worth?

Daily spending on five channels acts on the days that follow (adstock), warm days and holidays sell more, and regions
differ. Sales are known by the week alone, with errors that last (an autoregression of .6) and a shock that all regions
share.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd

CHANNELS = {  # sales a unit of spending, share that is carried over to the next day, share of days with a campaign
    "tv": (0.9, 0.8, 0.30),
    "radio": (0.6, 0.6, 0.35),
    "search": (1.2, 0.2, 0.80),
    "social": (0.5, 0.4, 0.60),
    "print": (0.0, 0.4, 0.25),  # worth nothing
}
WARMTH, HOLIDAY = 0.8, 15.0  # sales a degree, and on a holiday
PERSISTENCE, NOISE, SHOCK = 0.6, 12.0, 8.0  # of weekly errors; deviation of a region's own, and of the common one


def panel(seed: int = 0, regions: int = 10, weeks: int = 156) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Days of all regions, and the truth.

    Args:
        seed: of everything. regions, weeks: how many.

    Returns:
        Rows with region, week, day, temperature, holiday, the channels, and sales, which stand in the last row of a
        week. And of the same rows the expected sales (credit), and of each channel its part of them.
    """
    random = np.random.default_rng(seed)
    days = 7 * weeks
    date = pd.date_range("2021-01-04", periods=days)
    season = -np.cos(2 * np.pi * (np.arange(days) - 15) / 365.25)
    holiday = np.isin(np.arange(days) % 365, [0, 95, 120, 180, 275, 355, 356]).astype(float)
    shock = _lasting(random, weeks, SHOCK)
    frames, truths = [], []
    for region in range(regions):
        temperature = 10 + 9 * season + _lasting(random, days, 3.0)
        spent = {name: _campaigns(random, days, share) for name, (_, _, share) in CHANNELS.items()}
        parts = {name: CHANNELS[name][0] * _adstock(x, CHANNELS[name][1]) for name, x in spent.items()}
        base = 60 + 10 * random.normal() + WARMTH * temperature + HOLIDAY * holiday
        expected = base + sum(parts.values())
        weekly = expected.reshape(weeks, 7).sum(1) + _lasting(random, weeks, NOISE) + shock
        sales = np.full(days, np.nan)
        sales[6::7] = weekly.round(2)
        frames.append(
            pd.DataFrame(
                {
                    "region": f"r{region:02d}",
                    "week": np.repeat(np.arange(weeks), 7),
                    "day": date.strftime("%Y-%m-%d"),
                    "temperature": temperature,
                    "holiday": holiday.astype(int),
                    **{name: x.round(2) for name, x in spent.items()},
                    "sales": sales,
                }
            )
        )
        truths.append(pd.DataFrame({"credit": expected, **parts}))
    return pd.concat(frames, ignore_index=True), pd.concat(truths, ignore_index=True)


def _lasting(random: np.random.Generator, count: int, deviation: float) -> np.ndarray:
    """An autoregression whose values have this deviation."""
    noise = deviation * np.sqrt(1 - PERSISTENCE**2) * random.normal(size=count)
    noise[0] = deviation * random.normal()
    for t in range(1, count):
        noise[t] += PERSISTENCE * noise[t - 1]
    return noise


def _campaigns(random: np.random.Generator, days: int, share: float) -> np.ndarray:
    """Spending on some days: campaigns of about a week, with amounts that differ from day to day."""
    running = np.repeat(random.uniform(size=days // 5 + 1) < share, 5)[:days]
    return np.round(running * random.gamma(3.0, 2.0, size=days), 2)


def _adstock(x: np.ndarray, carried: float) -> np.ndarray:
    """y_t = x_t + c y_{t−1}."""
    y = x.copy()
    for t in range(1, len(y)):
        y[t] += carried * y[t - 1]
    return y


if __name__ == "__main__":
    file = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_name("marketing.csv"))
    rows, _ = panel()
    rows.assign(temperature=rows["temperature"].round(1)).to_csv(file, index=False)
    print(f"{file}: {len(rows)} rows")
