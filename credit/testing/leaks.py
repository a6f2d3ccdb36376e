"""The label is the only bridge: another reward function with the same labels leaves every action the same to the bit.

The other rewards are finite, so that no mask of NaN hides a leak, and they are in all places where a learner could look
for them: in steps, in demonstrations, and in the environment's own tables.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from credit.config import schema
from credit.core.capabilities import parts_of
from credit.core.problem import Problem
from credit.core.seams import Environment, Transitions
from credit.core.truth import Truth
from credit.core.windows import Windows
from credit.testing.cases import Case
from credit.testing.expect import expect
from credit.testing.short import SEEDS
from credit.trainer import Trainer

SAID = ("observations", "actions", "setting")  # what a component says of the problems that it takes
MOVES = ("sum", "last", "success")  # objectives whose labels survive a move of the rewards


class Moved(Environment):
    """An environment with another reward function, whose windows have the same labels.

    Rewards are rounded to multiples of 2⁻²⁰, so that sums of them are exact, and move by `amount` in a way that the
    label cannot show: by amounts that cancel in each window where it is their sum, in all steps but the last where it
    is that one, and by a positive factor where it says whether any was positive.

    Args:
        env: whose steps. objective: of the feedback. amount: 0 for no move.
    """

    def __init__(self, env: Environment, objective: str, amount: float) -> None:
        self.env, self.objective, self.amount = env, objective, amount
        for name in ("copies", "ends_early", "rolls", "horizon", "evaluation_episodes", *SAID):
            setattr(self, name, getattr(env, name))

    def problem(self, window: int, seeds: tuple[int, ...], device: torch.device | str) -> Problem:
        """The other one's."""
        return self.env.problem(window, seeds, device)

    def start(self, problem: Problem, copies: int = 1, purpose: str = "environment") -> None:
        """Start the other one, and move what it has in tables."""
        self.env.start(problem, copies, purpose)
        self._last, self._sum = problem.window - 1, problem.zeros(copies)
        self._t = torch.zeros_like(self._sum, dtype=torch.int64)  # of each copy's window
        if self.amount and hasattr(self.env, "mdp"):
            mdp = self.env.mdp
            name = "reward_next" if hasattr(mdp, "reward_next") else "reward"
            self.env.__dict__["mdp"] = replace(mdp, **{name: -getattr(mdp, name)})

    def twin(self) -> Moved:
        """A twin of the other one, moved."""
        return Moved(self.env.twin(), self.objective, self.amount)

    def reset(self, mask: Tensor | None = None) -> Tensor:
        """The other one's states."""
        begun = torch.ones_like(self._t, dtype=torch.bool) if mask is None else mask
        self._t, self._sum = torch.where(begun, 0, self._t), torch.where(begun, 0.0, self._sum)
        return self.env.reset(mask)

    def step(self, actions: Tensor, mask: Tensor | None = None) -> Transitions:
        """The other one's step, with other rewards."""
        out = self.env.step(actions, mask)
        ends = self._t == self._last
        for over in (out.terminated, out.truncated):
            ends = ends if over is None else ends | over
        exact = (out.rewards * 2**20).round() / 2**20
        before, moved = self._sum, self._moved(exact, ends)
        following = torch.where(ends, 0, self._t + 1)
        self._t = following if mask is None else torch.where(mask, following, self._t)
        self._sum = self._sum if mask is None else torch.where(mask, self._sum, before)
        return out._replace(rewards=moved)

    def _moved(self, rewards: Tensor, ends: Tensor) -> Tensor:
        if self.objective == "success":
            return rewards * (1 + self.amount)
        if self.objective == "last":
            return torch.where(ends, rewards, rewards + self.amount)
        assert self.objective == "sum"
        by = torch.where(ends, -self._sum, self.amount)
        self._sum = torch.where(ends, 0.0, self._sum + by)
        return rewards + by

    def demonstrations(self) -> tuple[Windows, Tensor] | None:
        """The other one's, with other rewards."""
        found = self.env.demonstrations()
        return None if found is None else (found[0], found[1] + self.amount)

    def knowledge(self) -> Any:
        """The other one's."""
        return self.env.knowledge()

    def truth(self, objective: str, window: int) -> Truth | None:
        """The other one's."""
        return self.env.truth(objective, window)


def started(
    config: Mapping[str, Any], amount: float, prepare: Callable[[Trainer], None] = lambda trainer: None
) -> Trainer:
    """A trainer in an environment whose rewards are moved.

    Args:
        config: of the run. amount: of the move. prepare: what else is done with it before it starts.
    """
    trainer: Trainer = schema.build(config, "trainer")
    trainer.env = Moved(trainer.env, str(trainer.feedback.objective), amount)
    prepare(trainer)
    trainer.start(SEEDS)
    return trainer


def lived(
    config: Mapping[str, Any], amount: float, prepare: Callable[[Trainer], None] = lambda trainer: None
) -> Windows:
    """All that a run collected and was told."""
    trainer = started(config, amount, prepare)
    trainer.run(lambda step, values: None)
    return trainer.store.windows


def differing(one: Windows, other: Windows) -> list[str]:
    """Names of what is not the same to the bit."""
    columns = {name: value for name, value in vars(one).items() if isinstance(value, Tensor) and name != "primitive"}
    assert {"states", "actions", "labels"} <= columns.keys()
    return [name for name, value in columns.items() if not torch.equal(value, getattr(other, name))]


def keeps_to_labels(case: Case) -> None:
    """Nobody but the oracle, which says so, learns anything of rewards but by labels."""
    trainer: Trainer = schema.build(case.config, "trainer")
    roots = {"assigner": trainer.assigner, "agent": trainer.agent}
    shown = [part for name, root in roots.items() for _, part in parts_of(root, name) if part.sees_primitive]
    if shown or trainer.feedback.objective not in MOVES:
        return
    found = differing(lived(case.config, 0.0), lived(case.config, 0.5))
    expect(
        not found,
        f"other rewards with the same labels led to other {', '.join(found)}: something reads the primitive reward "
        "past the label, in the environment or in what it tells (facts, knowledge)",
    )
