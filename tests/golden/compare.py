"""Short runs of every method by the code of another commit and by this one, array by array: are they still the same?

Nothing is stored: both sides are computed here and now, since bits belong to a machine. The other commit is checked out
into a temporary folder, so that no change can alter what it is compared with. Neither side uses compiled loops, which
are the same to rounding only (`tests/test_loops.py`); `--loops` lets both do so where Numba is installed.

Run:  make golden                                    (against the commit before the redesign)
      .venv/bin/python tests/golden/compare.py --commit HEAD~1 --only sepsis
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pandas as pd

HERE = Path(__file__).resolve()
ROOT = HERE.parents[2]
BEFORE = "6a61dfa"  # the last commit before the redesign
TABLES = ("reference", "adaptive_mse", "disagreement", "oracle", "delayed", "delayed_fair", "random")
SHORT = {  # what every run of an experiment is shortened by
    "advertiser": "trainer.steps=704",
    "sepsis": "trainer.steps=600",
    "pointmaze": "trainer.steps=3000 agent.first_updates=40 agent.updates=20 env.evaluation_episodes=2",
}
MODELS = "reference.first_steps=30 reference.steps=10 surrogates.heuristic.first_steps=30 surrogates.heuristic.steps=10"
RUNS = {
    "advertiser": [
        *TABLES,
        *("block", "block_fair", "elliptical", "thompson"),
        *("adaptive_mse mixer=stacking", "disagreement transition=shift_mixture"),
        *("adaptive_mse uncertainty.resample=exact", "adaptive_mse mixer=best", "reference uncertainty=analytic"),
        *("delayed assigner=uniform", "disagreement trainer.windows_per_round=9"),
    ],
    "sepsis": [
        *TABLES,
        *("delayed_monte_carlo", "credit_hypotheses trainer.random_windows=9", "last_step trainer.random_windows=9"),
        *("reference feedback=terminal", "credit_hypotheses trainer.random_windows=9 feedback=terminal"),
        *("disagreement transition=mixture", "oracle transition=exact", "delayed feedback=terminal"),
        "reference agent=dqn",
    ],
    "pointmaze": [
        *("delayed", "delayed_fair", "oracle", "random"),
        *(f"{name} {MODELS}" for name in ("adaptive_mse", "disagreement", "disagreement uncertainty=dropout")),
        *(
            f"{name} {MODELS}"
            for name in ("adaptive_mse uncertainty=ensemble", "disagreement trainer.windows_per_round=3")
        ),
        *(
            f"{name} {MODELS}"
            for name in ("adaptive_mse bonus.local_mse.scale=0", "disagreement bonus.disagreement.scale=0")
        ),
        "reference reference.first_steps=30 reference.steps=10",
        "delayed agent=sac_plain agent.update_ratio=0 agent.updates=20",
        "oracle env.primitive=dense",
    ],
}
Arrays = dict[str, np.ndarray]


def words() -> Iterator[tuple[str, list[str]]]:
    """Name and overrides of every run."""
    for experiment, methods in RUNS.items():
        for line in methods:
            method, *more = line.split()
            name = " ".join(
                [experiment, method, *(word for word in more if "_steps=" not in word and ".steps=" not in word)]
            )
            yield name, [f"experiment={experiment}", f"method={method}", *SHORT[experiment].split(), *more]


def compute(output: Path, only: str) -> None:
    """Run everything with the `credit` that is on the path, and list the folders that came out."""
    import torch

    import credit

    code = Path(credit.__file__).parents[1]
    torch.set_num_threads(1)  # this credit leaves the process as it is
    found = {}
    for name, overrides in words():
        if only not in name:
            continue
        given = [*_kept(overrides, code), "seed=1000", "replicas=2", "tracking=none", f"output={output}"]
        try:
            result = credit.run(given)
        except ValueError as error:  # a UserError, wherever that is
            found[name] = f"refused: {str(error).splitlines()[0]}"
            continue
        found[name] = result.error or [str(folder) for folder in result.folders]
        print(".", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    (output / "runs.json").write_text(json.dumps(found))


def _kept(overrides: list[str], code: Path) -> list[str]:
    """The words as that version has them; a random agent has no updates to shorten."""
    kept = [word for word in overrides if not (word.startswith("agent.") and "method=random" in overrides)]
    group = "agent" if (code / "conf" / "agent").is_dir() else "optimizer"
    return [re.sub(r"^agent(?=[.=])", group, word) for word in kept]


def arrays(folder: Path) -> Arrays:
    """All that a run left: columns of its journal but those of time, and its arrays."""
    frame = pd.read_csv(folder / "metrics.csv")
    found = {
        f"metrics/{name}": frame[name].to_numpy() for name in frame if "seconds" not in name and "time" not in name
    }
    for file in sorted(folder.glob("*.npz")):
        with np.load(file, allow_pickle=False) as content:
            found |= {f"{file.stem}/{name}": content[name] for name in content.files}
    return found


def digest(found: Mapping[str, np.ndarray]) -> str:
    """SHA-256 of all arrays of a run by name, the first 12 digits."""
    total = hashlib.sha256()
    for name, values in sorted(found.items()):
        total.update(f"{name} {values.dtype} {values.shape}".encode() + np.ascontiguousarray(values).tobytes())
    return total.hexdigest()[:12]


def differences(before: Arrays, now: Arrays) -> list[str]:
    """One entry for every array that is not the same to the bit."""
    lines = [f"{name} is gone" for name in before if name not in now]
    lines += [f"{name} is new" for name in now if name not in before]
    for name in before.keys() & now.keys():
        old, new = before[name], now[name]
        if old.shape != new.shape:
            lines.append(f"{name} {old.shape} → {new.shape}")
        elif old.dtype.kind not in "fiub":
            lines += [] if (old == new).all() else [f"{name} differs"]
        elif not np.array_equal(old, new, equal_nan=True):
            gap = np.abs(old.astype(float) - new.astype(float)) / np.maximum(np.abs(old.astype(float)), 1e-12)
            lines.append(f"{name} by {np.nanmax(gap):.1e}")
    return sorted(lines)


def main() -> int:
    """Compare; the exit code is the number of runs that differ, at most 1."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--commit", default=BEFORE, help="the commit to compare with")
    parser.add_argument("--only", default="", help="runs whose name contains this")
    parser.add_argument("--loops", action="store_true", help="with compiled loops, where Numba is installed")
    parser.add_argument("--compute", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.compute:
        compute(given.compute, given.only)
        return 0
    with tempfile.TemporaryDirectory() as made:
        other, sides = Path(made) / "code", {name: Path(made) / name for name in ("before", "now")}
        subprocess.run(["git", "-C", ROOT, "worktree", "add", "--quiet", "--detach", other, given.commit], check=True)
        try:
            processes = []
            for name, tree in (("before", other), ("now", ROOT)):
                sides[name].mkdir()
                command = [sys.executable, HERE, "--only", given.only, "--compute", sides[name]]
                environment = {**os.environ, "PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1"}
                environment["NUMBA_DISABLE_JIT"] = str(int(not given.loops))
                processes.append(subprocess.Popen(command, env=environment, cwd=tree))
            if any([process.wait() for process in processes]):  # noqa: C419 - none may be left running
                return 2
        finally:
            subprocess.run(["git", "-C", ROOT, "worktree", "remove", "--force", other], check=True)
        before, now = (json.loads((sides[name] / "runs.json").read_text()) for name in ("before", "now"))
        return int(any([not _same(name, before[name], now.get(name)) for name in before]))  # noqa: C419 - all are said


def _same(name: str, before: str | list[str], now: str | list[str] | None) -> bool:
    """Say how a run compares; whether both sides are the same."""
    if isinstance(before, str) or isinstance(now, str) or now is None:
        same = before == now
        print(f"{'same' if same else 'DIFFERS':8} {name}: {before if same else f'{before} → {now}'}")
        return same
    old, new = ([arrays(Path(folder)) for folder in folders] for folders in (before, now))
    lines = [
        f"seed {1000 + i}: {line}" for i, pair in enumerate(zip(old, new, strict=True)) for line in differences(*pair)
    ]
    marks = " ".join(digest(found) for found in old)
    print(f"{'DIFFERS' if lines else 'same':8} {name} ({marks})")
    for line in lines[:12]:
        print(f"         {line}")
    return not lines


if __name__ == "__main__":
    sys.exit(main())
