"""Passes of `credit recover` over the files of a table, as jobs on Hydra's launchers: one a file."""

from __future__ import annotations

import os
import pickle
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from credit.config import launchers
from credit.core.errors import RunError, UserError

if TYPE_CHECKING:
    from credit.logged.panel import Panel
    from credit.logged.spreading import Runner


@dataclass(frozen=True)
class Pass:
    """One pass, as a launcher runs it: job n reads what is to be done and section n, and writes what it found.

    Attributes:
        folder: which all machines see.
    """

    folder: Path

    def __call__(self, config: Any) -> None:
        """Do this job's part."""
        number = launchers.job_number()
        function = pickle.loads((self.folder / "function").read_bytes())
        section = pickle.loads((self.folder / f"section-{number}").read_bytes())
        try:
            found: Any = (True, function(section))
        except UserError as error:
            found = (False, str(error))
        partial = self.folder / f".found-{number}.{os.getpid()}"
        partial.write_bytes(pickle.dumps(found, protocol=pickle.HIGHEST_PROTOCOL))
        partial.rename(self.folder / f"found-{number}")


def runner(words: Sequence[str], folder: Path, config_dirs: Sequence[str]) -> Runner:
    """What runs passes on a launcher.

    Args:
        words: that choose it, hydra/launcher=ray. folder: for what jobs read and write. config_dirs: of YAML files.
    """

    def run(function: Callable[[Panel], Any], sections: Sequence[Panel]) -> list[Any]:
        folder.mkdir(parents=True, mode=0o700)  # what jobs unpickle is nobody else's to write
        try:
            (folder / "function").write_bytes(pickle.dumps(function))
            for number, section in enumerate(sections):
                (folder / f"section-{number}").write_bytes(pickle.dumps(section))
            launcher = launchers.choose(words, len(sections), False, config_dirs)
            place = {"session": "recover", "output": str(folder)}
            errors = launchers.launch(Pass(folder.resolve()), len(sections), launcher, place, list(config_dirs))
            return [_found(folder, number, errors) for number in range(len(sections))]
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    return run


def _found(folder: Path, number: int, errors: dict[int, str]) -> Any:
    file = folder / f"found-{number}"
    if not file.exists():
        raise RunError(f"the job of file {number} found nothing: {errors.get(number, 'it did not come to its end')}")
    good, found = pickle.loads(file.read_bytes())
    if not good:
        raise UserError(found)
    return found
