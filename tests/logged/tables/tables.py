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


def decisions(windows: int = 120, seed: int = 0) -> pd.DataFrame:
    """Windows of three steps of an agent: a state and an action that are words, a label in each window's last row."""
    rng = np.random.default_rng(seed)
    rows = 3 * windows
    frame = pd.DataFrame({"window": np.repeat(np.arange(windows), 3), "t": np.tile(np.arange(3), windows)})
    frame["state"], frame["action"] = rng.choice(["s0", "s1", "s2"], rows), rng.choice(["a0", "a1"], rows)
    reward = (frame.state == "s1") + 2.0 * (frame.action == "a1") + 0.1 * rng.normal(size=rows)
    frame["label"] = reward.groupby(frame.window).transform("sum").where(frame.t == 2)
    return frame
