"""How often do intervals cover, on marketing data that nobody here made? Panels of `pysimmmulator` (pip install it).

    python examples/pysimmmulator_coverage.py coverage.csv 200        # about a quarter of an hour on two cores

Three years of days in one country, four channels whose impressions or clicks are carried over (geometrically) and sell
without diminishing returns, a trend that spending follows, a season, and errors that do not last. Labels are weeks of
revenue. The truth is the package's own: what it says that each channel earned.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parent))
CHANNELS = {  # decay, conversions an impression or click, its metric, its price
    "video": (0.7, 0.0006, "impressions", 6.0),
    "display": (0.5, 0.0004, "impressions", 3.0),
    "social": (0.3, 0.0005, "impressions", 4.0),
    "search": (0.1, 0.02, "clicks", 0.5),
}


def config() -> dict[str, Any]:
    """Of the simulator."""
    seen = [name for name, one in CHANNELS.items() if one[2] == "impressions"]
    clicked = [name for name in CHANNELS if name not in seen]
    shares = {name: {"min": 0.05, "max": 0.4} for name in (*clicked, *seen[:-1])}
    none = {"type": "hill", "params": {"alpha": 1.0, "gamma": 1.001}}  # half of the most at one impression: no limit
    return {
        "basic_params": {
            "years": 3,
            "channels_impressions": seen,
            "channels_clicks": clicked,
            "frequency_of_campaigns": 1,
            "start_date": "2021/1/1",
            "true_cvr": {name: CHANNELS[name][1] for name in (*clicked, *seen)},
            "revenue_per_conv": 10.0,
        },
        "baseline_params": {
            "base_p": 2000,
            "trend_p": 600,
            "temp_var": 8,
            "temp_coef_mean": 30,
            "temp_coef_sd": 5,
            "error_std": 150,
        },
        "ad_spend_params": {
            "campaign_spend_mean": 3000,
            "campaign_spend_std": 1200,
            "max_min_proportion_on_each_channel": shares,
        },
        "media_params": {
            "true_cpm": {**{name: CHANNELS[name][3] for name in seen}, **dict.fromkeys(clicked, 10.0)},
            "true_cpc": {name: CHANNELS[name][3] for name in clicked},
            "noisy_cpm_cpc": {name: {"loc": 0.0, "scale": 0.02} for name in (*clicked, *seen)},
        },
        "cvr_params": {"noisy_cvr": {name: {"loc": 0.0, "scale": 0.00005} for name in (*clicked, *seen)}},
        "adstock_params": {
            "adstock": {name: {"type": "geometric", "params": {"lambda": one[0]}} for name, one in CHANNELS.items()},
            "saturation": dict.fromkeys(CHANNELS, none),
        },
        "output_params": {"aggregation_level": "daily"},
    }


def panel(seed: int) -> tuple[pd.DataFrame, dict[str, float]]:
    """Days with their week, its revenue, trend and season; and what a unit of each channel earned."""
    import pysimmmulator

    result = pysimmmulator.Simulate(random_seed=seed).run_with_config(config())
    days = result.df.reset_index()
    days = days.iloc[: len(days) // 7 * 7]
    number = np.arange(len(days))
    rows = pd.DataFrame({"week": number // 7, "day": number, "trend": number / len(days)})
    rows["sine"], rows["cosine"] = np.sin(2 * np.pi * number / 365), np.cos(2 * np.pi * number / 365)
    truth = {}
    for name, (_, _, metric, _) in CHANNELS.items():
        rows[name] = days[f"{name}_{metric}"].to_numpy()
        earned = (result.channel_roi[name] + 1) * result.df[f"{name}_spend"].sum()
        truth[name] = earned / result.df[f"{name}_{metric}"].sum()
    revenue = days["total_revenue"].to_numpy()
    rows["revenue"] = np.repeat(revenue.reshape(-1, 7).sum(1), 7)
    return rows, truth


def one(seed: int, draws: int = 200) -> pd.DataFrame:
    """The effects of one data set, beside the truth."""
    import credit

    rows, truth = panel(seed)
    words: dict[str, Any] = {"window": "week", "label": "revenue", "time": "day", "actions": list(CHANNELS)}
    found = credit.recover(rows, states=["trend", "sine", "cosine"], draws=draws, **words)
    effects = found.effects[["action", "model", "per_unit", "per_unit_low", "per_unit_high"]].copy()
    effects.insert(0, "seed", seed)
    effects["truth"] = effects["action"].map(truth)
    effects["covered"] = effects["truth"].between(effects["per_unit_low"], effects["per_unit_high"])
    return effects.assign(rho=found.found.rho, units=len(found.found.units))


if __name__ == "__main__":
    from marketing_coverage import run

    run(one, Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 200)
