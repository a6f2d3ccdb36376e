"""The six arrows: collect → feedback → dataset → recover → relabel → improve. One trainer for every experiment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar

import torch
from torch import Tensor

from credit.agents.random import Random
from credit.core.component import Component
from credit.core.dataset import Dataset
from credit.core.errors import RunError, UserError
from credit.core.interfaces import (
    CreditAssigner,
    Environment,
    Feedback,
    Optimizer,
    Oracle,
    SomeDataset,
    SomeProblem,
    SomeWindows,
)
from credit.core.trajectories import TrajectoryDataset
from credit.core.types import Belief, NonNegativeInt, PositiveInt, Problem

Log = Callable[[int, dict[str, Tensor]], None]


class Trainer(Component):
    """Algorithms B.1 and B.2: run a policy for some windows, learn a reward from their labels, improve the policy.

    Args:
        env: where steps happen.
        feedback: what a label is.
        assigner: windows → one reward per step.
        optimizer: rewards → policy.
        steps: primitive steps a run; a last window that they cut short gives no label and is not learned from. Where
            trajectories may end early, each counts for its longest.
        windows_per_round: windows collected between two refits.
        first_windows: windows at the start that are collected in rounds of their own size,
        first_windows_per_round: which is this.
        random_windows: windows at the start in which actions are random.
        log_every: windows between two rows of the journal.
    """

    keeps: ClassVar = (
        *("env", "feedback", "assigner", "optimizer", "_explorer", "oracle", "dataset"),
        *("rounds", "collected"),
    )

    def __init__(
        self,
        env: Environment,
        feedback: Feedback,
        assigner: CreditAssigner,
        optimizer: Optimizer,
        steps: PositiveInt = 14_000,
        windows_per_round: PositiveInt = 1,
        first_windows: NonNegativeInt = 0,
        first_windows_per_round: PositiveInt = 1,
        random_windows: NonNegativeInt = 0,
        log_every: PositiveInt = 40,
    ) -> None:
        self.env = env
        self.feedback = feedback
        self.assigner = assigner
        self.optimizer = optimizer
        self.steps = steps
        self.windows_per_round = windows_per_round
        self.first_windows = first_windows
        self.first_windows_per_round = first_windows_per_round
        self.random_windows = random_windows
        self._explorer = Random()
        self.log_every = log_every

    def start(self, seeds: tuple[int, ...], device: torch.device | str = "cpu") -> None:
        """Make the state of one replica a seed; everything that can be refused is refused here.

        Raises:
            UserError: the parts do not go together with these sizes.
        """
        window = self.feedback.window
        if self.steps < window:
            raise UserError(f"trainer.steps={self.steps}: shorter than one window (feedback.window={window})")
        whole = self.steps // window
        for key in ("windows_per_round", "first_windows_per_round", "random_windows"):
            if getattr(self, key) > whole:
                raise UserError(
                    f"trainer.{key}={getattr(self, key)}: more than the {whole} windows of the whole run "
                    f"(trainer.steps={self.steps}, feedback.window={window}); take at most {whole}, or more steps"
                )
        self.problem: SomeProblem = self.env.problem(window, seeds, device)
        tabular = isinstance(self.problem, Problem)
        if self.steps % window and not tabular:
            raise UserError(
                f"trainer.steps={self.steps}: trajectories cannot be cut short; take a multiple of feedback.window="
                f"{window}, like {max(whole, 1) * window}"
            )
        for part in (self.env, self.feedback, self.assigner, self.optimizer, self._explorer):
            part.start(self.problem)
        self.oracle: Oracle = self.env.oracle(self.problem, self.feedback)
        self.dataset: SomeDataset = Dataset(self.problem, whole) if tabular else TrajectoryDataset(self.problem)
        self._shows_primitive = any(model.sees_primitive for model in getattr(self.assigner, "models", ()))
        self.rounds = 0  # that were learned from
        self.collected = 0  # windows of each replica, without demonstrations

    def run(
        self,
        log: Log,
        progress: Callable[[int], None] = lambda steps: None,
        between: Callable[[], None] = lambda: None,
    ) -> None:
        """Take all steps, or those that are left after `load_state_dict`.

        Args:
            log: called with the step and the metrics [R] every `log_every` windows and at the end, and at the start
                where there are demonstrations.
            progress: called with the number of steps taken so far.
            between: called between two rounds, where the state is whole; it may raise to end the run there.

        Raises:
            RunError: a label is NaN or infinite, or a network is.
        """
        whole, rest = divmod(self.steps, self.problem.window)
        demonstrations = None if self.rounds else self.env.demonstrations()
        if demonstrations is not None:
            self._learn(*demonstrations)
            log(0, self.metrics())
            between()
        while self.collected < whole:
            before, count = self.collected, min(self._round(self.collected), whole - self.collected)
            windows, primitive = self._collect(count)
            self.collected += count
            self._learn(windows, primitive)
            progress(self.collected * self.problem.window)
            if self.collected // self.log_every > before // self.log_every and (self.collected < whole or rest):
                log(self.collected * self.problem.window, self.metrics())
            if self.collected < whole:  # what a last round leaves is not all state
                between()
        if rest:
            _, primitive = self.env.collect(self._actor().act, self.feedback, 1, rest)
            self.oracle.update(primitive, None, self._actor())
        progress(self.steps)
        log(self.steps, self.metrics())

    def metrics(self) -> dict[str, Tensor]:
        """Metric → [R], judged by the oracle, and what the optimizer says of itself."""
        own = {f"optimizer/{name}": value for name, value in self.optimizer.diagnostics().items()}
        return self.oracle.metrics(self.optimizer.policies(), self.recovery()) | own

    def recovery(self) -> Belief | None:
        """What is believed about the reward, where the assigner believes something."""
        return self.assigner.recovery()

    def _actor(self) -> Optimizer:
        return self._explorer if self.collected < self.random_windows else self.optimizer

    def _round(self, done: int) -> int:
        """How many windows come before the next refit; a round crosses neither border."""
        size = self.first_windows_per_round if done < self.first_windows else self.windows_per_round
        ends = [end - done for end in (self.first_windows, self.random_windows) if end > done]
        return min([size, *ends])

    def _collect(self, count: int) -> tuple[SomeWindows, Tensor]:
        actor = self._actor()
        windows, primitive = self.env.collect(actor.act, self.feedback, count, self.problem.window)
        finite = torch.isfinite(windows.labels)
        if not finite.all():
            replica, k = (int(i) for i in (~finite).nonzero()[0])
            raise RunError(
                f"window {self.collected + k} of seed {self.problem.seeds[replica]} has the label "
                f"{float(windows.labels[replica, k])}: labels must be finite; look at env's reward and at feedback"
            )
        self.oracle.update(primitive, windows.labels, actor)
        return windows, primitive

    def _learn(self, windows: SomeWindows, primitive: Tensor) -> None:
        self.dataset.append(replace(windows, primitive=primitive) if self._shows_primitive else windows)
        try:
            self.assigner.observe(self.dataset)
            self.optimizer.improve(self.dataset, self.assigner)
        except RunError as error:
            raise RunError(f"round {self.rounds}: {error}") from error
        self.rounds += 1
