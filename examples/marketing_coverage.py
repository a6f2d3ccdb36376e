"""How often do intervals cover what channels were worth? On panels whose truth is known, as `marketing.py` makes them.

    python examples/marketing_coverage.py coverage.csv 200        # about forty minutes on two cores

Each data set has forty regions over three years. A row a data set, channel and model: the true effect of a unit (with
what is carried over), the estimate and its 90% interval.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pandas as pd

sys.path.insert(0, str(Path(__file__).parent))
FIRST = 7000  # seed of the first data set; none of them was used to choose anything


def one(seed: int, regions: int = 40, weeks: int = 156, draws: int = 200) -> pd.DataFrame:
    """The effects of one data set, beside the truth."""
    import marketing

    import credit

    rows, truth = marketing.panel(seed, regions, weeks)
    found = credit.recover(rows, draws=draws)
    effects = found.effects[["action", "model", "per_unit", "per_unit_low", "per_unit_high"]].copy()
    worth = {name: truth[name].sum() / rows[name].sum() for name in marketing.CHANNELS}
    effects.insert(0, "seed", seed)
    effects["truth"] = effects["action"].map(worth)
    effects["covered"] = effects["truth"].between(effects["per_unit_low"], effects["per_unit_high"])
    return effects.assign(rho=found.found.rho, units=len(found.found.units))


def shown(effects: pd.DataFrame) -> pd.DataFrame:
    """Share of intervals that cover the truth, by model and channel, with its standard error."""
    table = effects.groupby(["model", "action"])["covered"].agg(["mean", "count"])
    table["error"] = (table["mean"] * (1 - table["mean"]) / table["count"]) ** 0.5
    return table.round(3)


def run(one: Callable[[int], pd.DataFrame], file: Path, count: int) -> None:
    """Run data sets beside each other, and write all rows as they come."""
    parts = []
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        for effects in pool.map(one, range(FIRST, FIRST + count)):
            parts.append(effects)
            pd.concat(parts, ignore_index=True).round(6).to_csv(file, index=False)
    print(shown(pd.concat(parts, ignore_index=True)).to_string())


if __name__ == "__main__":
    run(one, Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 200)
