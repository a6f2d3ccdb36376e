"""After how many episodes of watch repair are the decisions of the greedy policy right?

    credit train -m sweep=watch_repair
    python examples/episodes_to_solve.py outputs/watch_repair

A seed has solved it behind the first 750 episodes in a row in which 95% of the greedy policies decide rightly for all
four brands: the rule of RUDDER's authors, who count decisions while they explore.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import credit

OPTIMUM = 1.75  # of an episode: brands 1 and 2 are worth 3.5 each, and one in two is one of them
HORIZON, WINDOW, SHARE = 50, 750, 0.95


def solved(run: credit.Run) -> float:
    """Episodes until a run has solved it; infinite where it has not."""
    episodes = run.metrics.index.to_numpy() // HORIZON
    right = np.isclose(run.metrics["return/greedy"], OPTIMUM)
    every = int(episodes[0])  # episodes between two looks
    share = np.convolve(right, np.ones(WINDOW // every) / (WINDOW // every), "valid")
    behind = np.flatnonzero(share >= SHARE)
    return float(episodes[behind[0] + WINDOW // every - 1]) if len(behind) else float("inf")


def main(folder: Path) -> None:
    """One line for the runs of each method and variant."""
    for parent in sorted({file.parents[1] for file in folder.glob("*/*/seed-*/DONE")}):
        runs = [credit.load(seed) for seed in sorted(parent.glob("seed-*"))]
        found = np.sort([solved(run) for run in runs])
        regret = np.array([run.metrics["regret/cumulative"].iloc[-1] for run in runs])
        error = regret.std(ddof=1) / len(runs) ** 0.5 if len(runs) > 1 else float("nan")
        those = ", ".join(f"{episodes:.0f}" for episodes in found[np.isfinite(found)])
        print(
            f"{parent.parent.name} {parent.name}: {np.isfinite(found).sum()} of {len(runs)} seeds"
            f"{f', after {those} episodes' if those else ''}; regret {regret.mean():.0f} ± {error:.0f}"
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
