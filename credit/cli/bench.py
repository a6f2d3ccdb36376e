"""`credit bench`: speed and memory against peers, as ratios within one run."""

from __future__ import annotations

import importlib
import os
import sys

from rich.table import Table

from credit.cli.common import Words
from credit.cli.main import guarded
from credit.cli.output import page
from credit.core.errors import UserError, nearest

BENCHES = {
    "tabular": "the advertiser's tabular core against the naive way: time, growth, memory, agreement",
    "sac": "SAC's updates and collection against Stable-Baselines3, TorchRL, plain PyTorch; seeds side by side",
    "relabel": "relabelling all rows, a share, or what is sampled after every refit: time, age of rewards",
    "reliability": "runs and a sweep that are killed and gone on with; what tracking bears, and costs",
    "sepsis": "the solver for thousands of unknown rewards: time, growth, against a dense solve, memory",
    "train": "whole runs of SAC with recovered rewards against Stable-Baselines3: time and its parts, memory",
    "recover": "ten million logged rows from disk to disk: time, memory, jobs a file; the fit against scikit-learn's",
    "returns": "returns of SAC and DQN on true rewards against Stable-Baselines3's: hours, and only by name",
}
LONG = {"returns"}


def main(argv: list[str]) -> int:
    """Run one benchmark, or all that take minutes; 1 if a target was missed."""
    words = Words.parse(argv)
    if words.help:
        print("usage: credit bench [NAME]\n\n" + "\n".join(f"  {name:<10} {line}" for name, line in BENCHES.items()))
        return 0
    for name in words.overrides:
        if name not in BENCHES:
            raise UserError(f"{name!r} is no benchmark; {nearest(name, BENCHES)}")
    os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")  # before NumPy is imported
    missed = 0
    for name in words.overrides or [name for name in BENCHES if name not in LONG]:
        rows = importlib.import_module(f"credit.bench.{name}").run(lambda line: print(f"… {line}", file=sys.stderr))
        table = Table("measured", "figure", "target", "", title=f"credit bench {name}", title_justify="left")
        for row in rows:
            mark = "" if row.met is None else "met" if row.met else "MISSED"
            table.add_row(row.what, row.figure, row.target, mark)
            missed += row.met is False
        page().print(table)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(guarded("bench", sys.argv[1:]))
