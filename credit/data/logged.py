"""Steps that somebody else took, or an earlier run: what a new run may start from."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from credit.core.errors import UserError
from credit.core.problem import Problem

NEAR = 1e-5  # of a number, by which an observation may differ from that behind the step before: files round


@dataclass(frozen=True)
class Logged:
    """n steps, episode after episode.

    Attributes:
        source: where they come from, for messages.
        states, next_states: as learners see them, int64 [n] or float32 [n, O]. actions: as agents do them, int64 [n],
            or float32 [n, A] in [−1, 1].
        episode: which one a step is in, int64 [n], rising by one. step: in the episode, counted from 0, int64 [n].
        terminated: whether nothing lies behind a step [n].
        rewards: r [n], None where nobody says it. success: whether a step is one [n], likewise.
        labels: of the window that a step ends [n], NaN for none; None where labels are to be made of rewards.
        closes: whether a window ends with a step [n]; None likewise.
    """

    source: str
    states: NDArray[Any]
    actions: NDArray[Any]
    next_states: NDArray[Any]
    episode: NDArray[np.int64]
    step: NDArray[np.int64]
    terminated: NDArray[np.bool_]
    rewards: NDArray[np.float64] | None = None
    success: NDArray[np.bool_] | None = None
    labels: NDArray[np.float64] | None = None
    closes: NDArray[np.bool_] | None = None

    def __len__(self) -> int:
        """n."""
        return len(self.episode)

    @property
    def ended(self) -> NDArray[np.bool_]:
        """Whether a step is the last of its episode [n]."""
        return np.diff(self.episode, append=self.episode[-1] + 1) != 0

    @property
    def digest(self) -> str:
        """SHA-256 over names, types, shapes and values of all columns."""
        state = hashlib.sha256()
        for field in fields(self):
            if field.name == "source" or (column := getattr(self, field.name)) is None:
                continue
            values = np.ascontiguousarray(column)
            values = values.astype(values.dtype.newbyteorder("<"))
            state.update(f"{field.name} {values.dtype.str} {values.shape};".encode())
            state.update(values.tobytes())
        return state.hexdigest()

    def require(self, problem: Problem) -> None:
        """Refuse steps that are not of this problem.

        Raises:
            UserError: with the column, the row and its value, and what is allowed.
        """
        if not len(self):
            raise UserError(f"{self.source}: there are no steps in it")
        state = problem.states if problem.finite_states else None
        action = problem.actions if problem.finite_actions else None
        width = problem.observations if state is None else 0
        for name, column in (("observation", self.states), ("next_observation", self.next_states)):
            self._column(name, column, state, width)
        self._column("action", self.actions, action, problem.actions if action is None else 0)
        going = ~self.ended[:-1]
        ahead, behind = self.states[1:][going], self.next_states[:-1][going]
        wrong = ~np.isclose(ahead, behind, rtol=NEAR, atol=NEAR).reshape(len(ahead), -1).all(-1)
        if wrong.any():
            row = int(np.flatnonzero(going)[wrong.argmax()])
            raise UserError(
                f"{self.source}: next_observation {self.next_states[row].tolist()} of {self.where(row)} is not the "
                f"observation {self.states[row + 1].tolist()} of the next row; steps of an episode follow each other, "
                "and others are of another episode (column episode)"
            )
        if problem.episodic and (late := self.step >= problem.horizon).any():
            row = int(late.argmax())
            raise UserError(
                f"{self.source}: row {row} is step {self.step[row]} of its episode (column step), and episodes have at "
                f"most {problem.horizon} steps here; cut them, or raise that limit (env.max_steps, feedback.window)"
            )
        if (early := self.terminated & ~self.ended).any():
            raise UserError(
                f"{self.source}: row {int(early.argmax())} is terminated, and its episode goes on; the next row is of "
                "another one (column episode)"
            )

    def where(self, row: int) -> str:
        """A row, for messages: with its episode and its step."""
        return f"row {row} (episode {self.episode[row]}, step {self.step[row]})"

    def _column(self, name: str, values: NDArray[Any], size: int | None, width: int) -> None:
        """Refuse a column that does not lie in a space of `size` numbers, or of vectors of `width`."""
        wanted = (len(self), width) if size is None else (len(self),)
        if values.shape != wanted:
            have = f"{name} has the shape {list(values.shape[1:])}" if values.ndim > 1 else f"{name} is one number"
            need = f"{width} numbers ({name}_0, …)" if size is None else f"one whole number, 0 to {size - 1}"
            raise UserError(f"{self.source}: {have}, and here a step has {need}; it is of another environment")
        if size is None:
            good, allowed = np.isfinite(values).all(-1), "finite numbers"
            if name == "action":
                good, allowed = good & (np.abs(values) <= 1 + NEAR).all(-1), "within the bounds of the action space"
        else:
            good, allowed = (values >= 0) & (values < size), f"whole numbers from 0 to {size - 1}"
        if not good.all():
            row = int((~good).argmax())
            shown = "is outside" if size is None and name == "action" else f"is {values[row].tolist()}"
            raise UserError(f"{self.source}: {name} of {self.where(row)} {shown}: allowed are {allowed}")
