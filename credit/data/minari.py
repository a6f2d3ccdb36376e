"""Episodes that others recorded, in Minari's format."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from credit.core.errors import UserError


class Recorded(NamedTuple):
    """L steps: actions [L, ...], and what was observed before each and behind the last one.

    Attributes:
        number: of the episode in its dataset. observations: [L + 1, ...], or name → that, nested as the space is.
        rewards: r [L]. terminated: whether nothing lies behind the last step.
        success: whether each step is one [L], None where the dataset does not say.
    """

    number: int
    observations: Any
    actions: NDArray[Any]
    rewards: NDArray[Any]
    terminated: bool
    success: NDArray[Any] | None


def episodes(source: str | Path, limit: int | None = None) -> Iterator[Recorded]:
    """The episodes of a dataset, one by one.

    Args:
        source: a dataset's folder, or the name of one that Minari has on this machine (nothing is downloaded).
        limit: how many, from the first; None for all.

    Raises:
        UserError: Minari is not installed, there is no such dataset, or an episode is not one.
    """
    found = _opened(source)
    read = found.iterate_episodes()
    for number in found.episode_indices[:limit]:
        try:
            episode = next(read)
        except Exception as error:  # whatever a damaged file makes HDF5 raise
            raise _damaged(source, f"episode {number}", error) from None
        yield _checked(source, episode)


def _checked(source: str | Path, episode: Any) -> Recorded:
    """An episode as Minari has it, if it is one."""
    steps = len(episode.actions)
    if steps == 0:
        raise UserError(f"{source}: episode {episode.id} has no steps; give a dataset without it")
    for name, part in _parts(episode.observations, "observations"):
        if np.ndim(part) == 0 or len(part) != steps + 1:
            raise UserError(
                f"{source}: episode {episode.id} with {steps} actions has {name} of shape {np.shape(part)}; there "
                f"must be {steps + 1} rows, one before each action and one behind the last"
            )
    for name, column in (("rewards", episode.rewards), ("terminations", episode.terminations)):
        if np.shape(column) != (steps,):
            raise UserError(f"{source}: episode {episode.id} with {steps} actions has {name} {np.shape(column)}")
    told = (getattr(episode, "infos", None) or {}).get("success")
    return Recorded(
        int(episode.id),
        episode.observations,
        np.asarray(episode.actions),
        np.asarray(episode.rewards, dtype=float),
        bool(np.asarray(episode.terminations)[-1]),
        None if told is None else np.asarray(told)[-steps:].astype(bool),  # the first is of the reset
    )


def _opened(source: str | Path) -> Any:
    try:
        import minari
    except ImportError:
        raise UserError("to read a Minari dataset: pip install 'minari[hdf5]'") from None
    folder = Path(source)
    if folder.is_file():
        raise UserError(f"{source} is a file, and a Minari dataset is a folder (with data/main_data.hdf5); give that")
    try:
        if folder.exists():
            return minari.MinariDataset(folder / "data" if (folder / "data").exists() else folder)
        return minari.load_dataset(str(source))
    except (FileNotFoundError, ValueError) as error:
        what = str(error)
        if "download=True" in what:  # which is a word of Minari's functions
            what = "Minari has no dataset of this name on this machine"
        raise UserError(f"{source}: {what}; run `minari download {source}`, or give a dataset's folder") from None
    except Exception as error:  # of its metadata
        raise _damaged(source, "the dataset", error) from None


def _damaged(source: str | Path, what: str, error: Exception) -> UserError:
    why = f"{type(error).__name__}: {error}".partition("\n")[0]
    return UserError(f"{source}: {what} cannot be read ({why}); a file is damaged, or not as Minari writes it")


def _parts(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """The arrays of nested observations, each with its name."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _parts(inner, f"{name}[{key!r}]")
    else:
        yield name, value
