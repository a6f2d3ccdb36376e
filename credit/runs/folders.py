"""The run folders of a job: which seeds are done, which were interrupted, and who computes them now."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from credit.core.errors import UserError
from credit.renamed import translated
from credit.runs import checkpoint
from credit.runs import job as jobs
from credit.runs.locks import Lock

PAUSE = 0.5  # seconds between two looks at a lock


@dataclass(frozen=True)
class Group:
    """Seeds that are computed side by side.

    Attributes:
        seeds: all of them, in order. wanted: those that are not done yet; only their folders are written.
        interrupted: the checkpoint from which they go on; None is a start from the beginning.
    """

    seeds: tuple[int, ...]
    wanted: tuple[int, ...]
    interrupted: Path | None = None


@dataclass(frozen=True)
class Folders:
    """The run folders of one job.

    Attributes:
        parent: what they lie in. asked: the job's seeds. done: those of them that are finished. groups: what is left.
    """

    parent: Path
    asked: tuple[int, ...]
    done: tuple[int, ...]
    groups: tuple[Group, ...]

    @property
    def wanted(self) -> tuple[int, ...]:
        """All seeds that are to be computed; more than was asked for where an interrupted group has more."""
        return tuple(sorted(seed for group in self.groups for seed in group.wanted))

    def of(self, seed: int) -> Path:
        """The folder of a run."""
        return self.parent / f"seed-{seed}"

    def lock(self, seed: int) -> Lock:
        """The lock of a run: who holds it computes it."""
        return Lock(self.of(seed) / ".lock", f"seed {seed} of {self.parent}")


def named(config: Mapping[str, Any]) -> str:
    """The slug of the folder that a job's runs lie in: its own, or another's where the same runs lie already.

    Such a folder was named by an older rule, or by other words for the same.

    Args:
        config: of a job that knows its slug.
    """
    own = jobs.Job.of(config).parent
    if not own.parent.is_dir():
        return own.name
    wanted = jobs.identity(config)
    others = [folder for folder in sorted(own.parent.iterdir()) if folder != own]
    return next((folder.name for folder in (own, *others) if _held(folder) == wanted), own.name)


def _held(parent: Path) -> str | None:
    """The identity of the runs in a folder, by the first of them."""
    file = min(parent.glob("seed-*/config.yaml"), default=None)
    return _identity(file, file.stat().st_mtime_ns) if file else None


@lru_cache(maxsize=4096)
def _identity(file: Path, written: int) -> str | None:
    try:
        return jobs.identity(jobs.read(file.parent))
    except (UserError, KeyError, TypeError, AttributeError):  # damaged, or of a class that is not there any more
        return None


def find(config: Mapping[str, Any], parent: Path) -> Folders:
    """Look at the folders of a job.

    Raises:
        UserError: a folder holds a run of another configuration, or a checkpoint that cannot be read.
    """
    asked = jobs.Job.of(config).seeds
    todo, done = jobs.split(config, parent)
    left, groups, claimed = set(todo), list[Group](), set[int]()
    for file in _checkpoints(parent) if left and not config["rerun"] else []:
        try:
            content = checkpoint.load(file)
        except UserError:
            if file.exists():
                raise
            continue  # the run that wrote it has just finished
        seeds = tuple(content["seeds"])
        wanted = tuple(s for s in seeds if s not in claimed and not (parent / f"seed-{s}" / "DONE").exists())
        if not left & set(wanted):
            continue
        before = translated(content["config"])
        if jobs.identity(before) != jobs.identity(config):
            differ = "; ".join(jobs.differences(before, config))
            raise UserError(f"{file}: the checkpoint is of another configuration: {differ}. Nothing was changed")
        groups.append(Group(seeds, wanted, file))
        claimed |= set(wanted)
        left -= claimed
    rounds = config["trainer"]
    if rounds.get("episodes") and rounds.get("steps_per_round"):  # seeds side by side take as many steps, not episodes
        groups += [Group((seed,), (seed,)) for seed in sorted(left)]
    elif left:
        groups.append(Group(tuple(sorted(left)), tuple(sorted(left))))
    return Folders(parent, asked, tuple(done), tuple(groups))


def _checkpoints(parent: Path) -> list[Path]:
    """The checkpoints of a job's folders, newest first."""
    written: dict[Path, float] = {}
    for file in parent.glob(f"seed-*/{checkpoint.NAME}"):
        with suppress(FileNotFoundError):
            written[file] = file.stat().st_mtime
    return sorted(written, key=written.__getitem__, reverse=True)


def running(config: Mapping[str, Any], parent: Path) -> str | None:
    """Who computes a seed of the job now, if somebody does."""
    found = find(config, parent)
    for seed in found.wanted:
        if (lock := found.lock(seed)).held_elsewhere():
            return f"{lock.what} is being computed by {lock.holder()}"
    return None


@contextmanager
def claimed(config: Mapping[str, Any], parent: Path) -> Iterator[Folders]:
    """Hold the locks of all seeds that are to be computed; waits for whoever holds one, and looks again."""
    while True:
        found = find(config, parent)
        with ExitStack() as held:
            for seed in found.wanted:  # in order, so that no two wait for each other
                found.of(seed).mkdir(parents=True, exist_ok=True)
                _wait(held.enter_context(found.lock(seed)), lambda line: print(line, file=sys.stderr, flush=True))
            if find(config, parent) == found:
                yield found
                return


def _wait(lock: Lock, say: Callable[[str], None]) -> None:
    said = False
    while not lock.take():
        if not said:
            say(f"waiting  {lock.what}: it is being computed by {lock.holder()}")
            said = True
        time.sleep(PAUSE)
