"""Small tables for the tests of this room."""

from __future__ import annotations

import numpy as np
import pandas as pd


def marketing(regions: int = 3, days: int = 28, seed: int = 0) -> pd.DataFrame:
    """Days of regions, with weekly sales in all rows."""
    rng = np.random.default_rng(seed)
    parts = []
    for i in range(regions):
        frame = pd.DataFrame(
            {
                "day": pd.date_range("2024-01-01", periods=days),
                "region": f"r{i}",
                "week": np.arange(days) // 7,
                "tv": rng.exponential(1, days) * (rng.random(days) < 0.5),
                "radio": rng.random(days) * (rng.random(days) < 0.5),
                "temperature": rng.normal(15, 5, days),
                "sky": rng.choice(["clear", "cloudy", "rain"], days),
            }
        )
        reward = 2 * frame.tv + frame.radio
        frame["sales"] = reward.groupby(frame.week).transform("sum")
        parts.append(frame)
    return pd.concat(parts, ignore_index=True)
