"""A short run of somebody's own parts before anything is made: do they keep their promises, and can they go on?

What credit ships is tested; what comes from elsewhere is tried here, so that a part that is nearly right is told so
before the run and never loses one. Some windows are collected and learned from; after the first the state is saved as
a checkpoint, and parts made anew go on from it: they must come to the same.
"""

from __future__ import annotations

import tempfile
import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from credit.config import schema
from credit.config.fitting import key_of
from credit.core import contracts
from credit.core.capabilities import parts_of
from credit.core.component import Component
from credit.core.errors import RAISED, Misfit, RunError, UserError
from credit.core.policy import Policy
from credit.core.state import same
from credit.rounds import problem_of
from credit.runs import checkpoint
from credit.runs.artifacts import Recorder
from credit.trainer import Trainer

WINDOWS = 3  # one to learn from before the state is saved, one behind it, and one more for what shows late
SHORT = {"windows_per_round": 1, "first_windows": 0, "random_windows": 0, "log_every": WINDOWS}
FEW = dict.fromkeys(("updates", "first_updates", "steps", "first_steps"), 20) | {"evaluation_episodes": 1}
QUICK = FEW | {"compile": 0}  # at most, of what costs time and changes no promise
ROOTS = ("env", "feedback", "assigner", "agent")
REPLICAS = 2
CANNOT_GO_ON = "a run of these parts could not be stopped and gone on with"
STATE = "make every attribute that changes in `start`, and name it in `keeps` where the class has one"

Ended = tuple[dict[str, Any], list[dict[str, dict[str, np.ndarray]]]]  # the last metrics, and every seed's files

_right: set[frozenset[tuple[str, type]]] = set()  # what was tried in this process, and is right


def problems(config: Mapping[str, Any], trainer: Trainer) -> list[str]:
    """What a short run of a right configuration finds wrong; nothing where all parts are credit's own.

    Args:
        config: as `job.check` has found it right. trainer: what it makes.
    """
    parts = _parts(trainer)
    classes = frozenset((path, type(part)) for path, part in parts)
    if not any(_foreign(part) for _, part in parts) or classes in _right:
        return []
    first = _short(config)
    try:
        found = _tried(config, first)
    except Misfit:
        return []  # the start of the whole run says so, too, and with what would fit
    except (UserError, RunError) as error:
        return [str(error)]
    except RAISED as error:  # whatever somebody's part may raise
        return [_blamed(error, first)]
    if not found:
        _right.add(classes)
    return found


def _tried(config: Mapping[str, Any], first: Trainer) -> list[str]:
    """Play, save behind a window, load into parts made anew, go on, compare."""
    second, saved = _short(config), dict[str, Any]()
    seeds = tuple(range(config["seed"], config["seed"] + min(REPLICAS, config["replicas"])))
    problem = problem_of(first.env, first.feedback, seeds, "cpu", rolling=first.steps_per_round is not None)
    for path, part in _parts(first):
        if _foreign(part):
            contracts.watch(part, problem, key_of(path))
    for trainer in (first, second):
        trainer.start(seeds)

    def save() -> None:
        if first.rounds == 1 and not saved:
            try:
                saved.update(_through_a_file(first.state_dict()))
            except (TypeError, ValueError, AttributeError, LookupError, RuntimeError) as error:
                raise RunError(f"{CANNOT_GO_ON} ({error})") from error

    whole = _played(first, save)
    try:
        second.load_state_dict(saved)
    except (TypeError, ValueError, AttributeError, LookupError, RuntimeError) as error:
        return [f"{CANNOT_GO_ON} ({error}): {STATE}"]
    if same(whole, _played(second)):
        return []
    pairs = zip(_parts(first), _parts(second), strict=True)
    other = [
        key_of(path)
        for (path, one), (_, two) in pairs
        if _foreign(one) and not same(one.state_dict(), two.state_dict())
    ]
    suspects = other or [key_of(path) for path, part in _parts(second) if _foreign(part)]
    return [f"{', '.join(suspects)}: {CANNOT_GO_ON}: after it was saved and loaded it came to other numbers; {STATE}"]


def _played(trainer: Trainer, between: Any = lambda: None) -> Ended:
    """What a run comes to, as its folders would hold it."""
    recorder, rows = Recorder(trainer), list[dict[str, Any]]()

    def note(step: int, values: dict[str, torch.Tensor]) -> None:
        rows.append(values)
        if step == trainer.steps:
            recorder.note(step)

    trainer.run(note, between=between)
    return rows[-1], [recorder.files(index) for index in range(trainer.problem.replicas)]


def _short(config: Mapping[str, Any]) -> Trainer:
    trainer: Trainer = schema.build(config, "trainer")
    window = trainer.feedback.window or trainer.env.horizon or 1
    vars(trainer).update(SHORT, steps=WINDOWS * window, episodes=None)
    if trainer.steps_per_round is not None:
        trainer.steps_per_round = window
    for _, part in _parts(trainer):
        given = {key: getattr(part, key, None) for key in QUICK}
        vars(part).update({key: type(value)(min(value, QUICK[key])) for key, value in given.items() if value})
    return trainer


def _parts(trainer: Trainer) -> list[tuple[str, Component]]:
    return [pair for name in ROOTS for pair in parts_of(getattr(trainer, name), name)]


def _foreign(part: object) -> bool:
    return type(part).__module__.partition(".")[0] != "credit"


def _through_a_file(state: Mapping[str, Any]) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / checkpoint.NAME
        checkpoint.save(path, {"trainer": state})
        found: dict[str, Any] = checkpoint.load(path)["trainer"]
    return found


def _blamed(error: BaseException, trainer: Trainer) -> str:
    """What a part raised, and which: the innermost of somebody's own that was at work."""
    paths = {type(part).__name__: key_of(path) for path, part in _parts(trainer) if _foreign(part)}
    what = f"{type(error).__name__}: {error}"
    for frame, line in reversed(list(traceback.walk_tb(error.__traceback__))):
        part = frame.f_locals.get("self")
        if isinstance(part, (Component, Policy)) and _foreign(part) and frame.f_code.co_filename != contracts.__file__:
            name = type(part).__name__
            where = f"{Path(frame.f_code.co_filename).name}, line {line}"
            return f"{paths.get(name, 'a policy')}: {name}.{frame.f_code.co_name} raised {what} ({where})"
    return f"a short run failed with these parts of your own ({', '.join(paths.values())}): {what}"
