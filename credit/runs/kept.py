"""What a run keeps beyond its figures, where it is asked to (`keep=[steps,agent]`), and starts another one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from credit.core.errors import UserError
from credit.core.naming import registered_name
from credit.core.problem import Problem
from credit.core.seams import Agent
from credit.data import tables
from credit.envs.recorded import STEPS
from credit.runs import checkpoint
from credit.trainer import Trainer

AGENT = "agent.pt"
RANDOM = {"generators", "_generators", "bit_generator", "_episodes"}  # what says that a state is one of random numbers


def write_steps(trainer: Trainer, folder: Path, replica: int) -> None:
    """The steps whose labels have come as `steps.parquet`, in the columns that `demonstrations_from` reads.

    Without what the run itself had started from, and without primitive rewards, which no store holds.
    """
    if len(trainer.store) > trainer.given:
        tables.write(folder / STEPS, step_columns(trainer, replica))


def step_columns(trainer: Trainer, replica: int) -> dict[str, NDArray[Any]]:
    """Name → column [n], or [n, k], of one replica."""
    windows, skipped, problem = trainer.store.windows, trainer.given, trainer.problem
    first = int(windows.ends[replica, skipped - 1]) + 1 if skipped else 0
    rows = slice(first, int(windows.ends[replica, -1]) + 1)
    number = windows.number[replica, rows].cpu().numpy()
    ends = np.diff(number, append=-1) != 0
    labels = windows.labels[replica].cpu().numpy().astype(float)
    if windows.labelled is not None:
        labels = np.where(windows.labelled[replica].cpu().numpy(), labels, np.nan)
    if windows.ended is not None:
        ended = windows.ended[replica, rows].cpu().numpy()
        episode = np.concatenate([[0], np.cumsum(ended[:-1])])
    else:
        episode = number - number[0] if problem.episodic else np.zeros_like(number)
    steps = windows.times[replica, rows].cpu().numpy() if problem.episodic else np.arange(len(number))
    over = np.zeros(len(number)) if windows.terminated is None else windows.terminated[replica, rows].cpu().numpy()
    return {
        "episode": episode,
        "step": steps if windows.step is None else windows.step[replica, rows].cpu().numpy(),
        "observation": windows.states[replica, rows].cpu().numpy(),
        "action": _own(trainer.env.recorded(windows.actions[replica, rows]).cpu().numpy()),
        "next_observation": windows.next_states[replica, rows].cpu().numpy(),
        "terminated": over.astype(np.int8),
        "window": number - number[0],
        "label": np.where(ends, labels[number], np.nan),
    }


def write_agent(trainer: Trainer, folder: Path) -> None:
    """The agent of all seeds that were computed side by side as `agent.pt`, in the folder of the first.

    With all that it learns by, and so large where it remembers much.
    """
    checkpoint.save(folder / AGENT, {**_facts(trainer.agent, trainer.problem), "state": trainer.agent.state_dict()})


def begin_with(policy: str, agent: Agent, problem: Problem) -> None:
    """Make a started agent what another run's was in the end; its random numbers stay its own.

    Args:
        policy: the folder of a run, or of all its seeds, that was told `keep=[agent]`.

    Raises:
        UserError: no agent lies there, or one of another kind, of other spaces, sizes, or number of seeds.
    """
    file = _found(Path(policy))
    saved, now = checkpoint.load(file, problem.device), _facts(agent, problem)
    for name, what in (
        ("agent", "an agent"),
        ("observations", "observations"),
        ("actions", "actions"),
        ("seeds", "seeds side by side"),
    ):
        if saved.get(name) != now[name]:
            hint = "; set replicas to as many" if name == "seeds" else "; it is of another problem or method"
            raise UserError(f"policy_from={policy}: {what} {saved.get(name)}, and this run has {now[name]}{hint}")
    fresh = agent.state_dict()
    if why := _misfit(fresh, saved["state"], "agent"):
        raise UserError(f"policy_from={policy}: {why}; give agent.… the same sizes as in that run")
    agent.load_state_dict(_merged(fresh, saved["state"]))


def _facts(agent: Agent, problem: Problem) -> dict[str, Any]:
    """What must be the same where a policy is saved and where it goes on."""
    return {
        "agent": registered_name(type(agent).__module__, type(agent).__name__),
        "observations": str(problem.observation_space),
        "actions": str(problem.action_space),
        "seeds": problem.replicas,
    }


def _found(folder: Path) -> Path:
    """The file of an agent: one serves all seeds that were computed side by side, and lies with the first of them."""
    for place in (folder, *([folder.parent] if folder.name.startswith("seed-") else [])):
        files: Sequence[Path] = [place / AGENT] if (place / AGENT).exists() else sorted(place.glob(f"seed-*/{AGENT}"))
        if len(files) == 1:
            return files[0]
        if files:
            raise UserError(
                f"policy_from={folder}: several agents lie there; give the folder of one of them: "
                f"{', '.join(str(file.parent) for file in files)}"
            )
    raise UserError(
        f"policy_from={folder}: no {AGENT} lies there; compute that run with keep=[agent] (and rerun=true, where it "
        "is done), and give its folder"
    )


def _own(values: NDArray[Any]) -> NDArray[Any]:
    """Actions of any shape as [n], or [n, k]."""
    return values if values.ndim == 1 else values.reshape(len(values), -1)


def _is_random(state: Any) -> bool:
    """Whether this is the state of random numbers."""
    packed = isinstance(state, list) and state[:1] == ["generator"]
    return packed or (isinstance(state, Mapping) and not RANDOM.isdisjoint(state))


def _misfit(fresh: Any, saved: Any, where: str) -> str:
    """The first place at which a saved state has another form than one that was just made; empty where it has none.

    What is empty at the start may have grown.
    """
    if _is_random(fresh):
        return ""
    if isinstance(fresh, torch.Tensor) and isinstance(saved, torch.Tensor):
        same = fresh.shape == saved.shape or not fresh.numel()
        return "" if same else f"{where} has the shape {list(saved.shape)}, and in this run {list(fresh.shape)}"
    pairs = _pairs(fresh, saved)
    if pairs is None:
        return f"{where} is another thing in this run"
    return next(filter(None, (_misfit(a, b, f"{where}.{key}") for key, a, b in pairs)), "")


def _merged(fresh: Any, saved: Any) -> Any:
    """A saved state, with the random numbers of one that was just made."""
    if _is_random(fresh):
        return fresh
    if isinstance(fresh, Mapping) and fresh:
        return {key: _merged(fresh[key], value) for key, value in saved.items()}
    if isinstance(fresh, (list, tuple)) and fresh:
        return type(fresh)(_merged(a, b) for a, b in zip(fresh, saved, strict=True))
    return saved


def _pairs(fresh: Any, saved: Any) -> list[tuple[Any, Any, Any]] | None:
    """Key, and what lies there on both sides, of what holds others; None where the sides do not go together."""
    if isinstance(fresh, Mapping) and isinstance(saved, Mapping):
        same = not fresh or fresh.keys() == saved.keys()
        return [(key, fresh[key], saved[key]) for key in fresh] if same else None
    if isinstance(fresh, (list, tuple)) and isinstance(saved, (list, tuple)):
        same = not fresh or len(fresh) == len(saved)
        return [(i, *pair) for i, pair in enumerate(zip(fresh, saved, strict=bool(fresh)))] if same else None
    plain = (bool, int, float, str, type(None))
    return [] if isinstance(fresh, plain) and isinstance(saved, plain) else None
