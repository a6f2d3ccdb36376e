"""The arrows: collect → feedback → windows → recover → relabel → improve. One trainer for every problem."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar

import torch
from torch import Tensor

from credit.agents.random import Random
from credit.core.belief import Belief
from credit.core.capabilities import parts_of, require
from credit.core.component import Component
from credit.core.errors import RunError, UserError
from credit.core.knowledge import inform
from credit.core.ranges import NonNegativeInt, PositiveInt
from credit.core.seams import Agent, CreditAssigner, Environment, Feedback
from credit.core.store import Store
from credit.core.windows import Windows
from credit.envs.collect import Collector
from credit.judges.choose import judge

Log = Callable[[int, dict[str, Tensor]], None]


class Trainer(Component):
    """Algorithms B.1 and B.2: run a policy for some windows, learn a reward from their labels, improve the policy.

    Args:
        env: where steps happen.
        feedback: what a label is.
        assigner: windows → one reward per step.
        agent: rewards → policy.
        steps: primitive steps a run; a last window that they cut short gives no label and is not learned from. Where
            trajectories may end early, each counts for its longest.
        windows_per_round: windows collected between two refits.
        first_windows: windows at the start that are collected in rounds of their own size,
        first_windows_per_round: which is this.
        random_windows: windows at the start in which actions are random.
        log_every: windows between two rows of the journal.
    """

    keeps: ClassVar = (
        *("env", "feedback", "collector", "assigner", "agent", "_explorer", "judge", "store"),
        *("rounds", "collected"),
    )

    def __init__(
        self,
        env: Environment,
        feedback: Feedback,
        assigner: CreditAssigner,
        agent: Agent,
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
        self.agent = agent
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
        self.problem = replace(self.env.problem(window, seeds, device), labels=self.feedback.kind)
        if self.steps % window and self.problem.episodic and not self.problem.tabular:
            raise UserError(
                f"trainer.steps={self.steps}: trajectories cannot be cut short; take a multiple of feedback.window="
                f"{window}, like {max(whole, 1) * window}"
            )
        roots = {"feedback": self.feedback, "assigner": self.assigner, "agent": self.agent}
        require(roots, self.problem)
        self.env.start(self.problem)
        parts = [pair for name, root in roots.items() for pair in parts_of(root, name)]
        inform(parts, self.env.knowledge(), type(self.env).__name__)
        for part in (self.feedback, self.assigner, self.agent, self._explorer):
            part.start(self.problem)
        self.collector = Collector(self.env, self.feedback, self.problem)
        self.judge = judge(self.env, self.feedback, self.problem, self.collector.evaluation)
        self.store = Store(self.problem, self.steps if self.problem.tabular else 0)
        self._shows_primitive = any(part.sees_primitive for _, part in parts)
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
            self._learn(windows, primitive, checked=True)
            progress(self.collected * self.problem.window)
            if self.collected // self.log_every > before // self.log_every and (self.collected < whole or rest):
                log(self.collected * self.problem.window, self.metrics())
            if self.collected < whole:  # what a last round leaves is not all state
                between()
        if rest:
            windows, primitive = self.collector.collect(self._actor(), 1, rest)
            self.judge.update(windows, primitive, self._actor(), complete=False)
        progress(self.steps)
        log(self.steps, self.metrics())

    def metrics(self) -> dict[str, Tensor]:
        """Metric → [R], as judged, and what the agent says of itself."""
        own = {f"optimizer/{name}": value for name, value in self.agent.diagnostics().items()}
        return self.judge.measure(self.agent.policies(), self.belief()) | own

    def belief(self) -> Belief | None:
        """What is believed about the reward, where the assigner believes something."""
        return self.assigner.belief()

    def _actor(self) -> Agent:
        return self._explorer if self.collected < self.random_windows else self.agent

    def _round(self, done: int) -> int:
        """How many windows come before the next refit; a round crosses neither border."""
        size = self.first_windows_per_round if done < self.first_windows else self.windows_per_round
        ends = [end - done for end in (self.first_windows, self.random_windows) if end > done]
        return min([size, *ends])

    def _collect(self, count: int) -> tuple[Windows, Tensor]:
        actor = self._actor()
        windows, primitive = self.collector.collect(actor, count)
        if not math.isfinite(float(windows.labels.sum())) and not (finite := windows.labels.isfinite()).all():
            replica, k = (int(i) for i in (~finite).nonzero()[0])
            raise RunError(
                f"window {self.collected + k} of seed {self.problem.seeds[replica]} has the label "
                f"{float(windows.labels[replica, k])}: labels must be finite; look at env's reward and at feedback"
            )
        self.judge.update(windows, primitive, actor)
        return windows, primitive

    def _learn(self, windows: Windows, primitive: Tensor, checked: bool = False) -> None:
        self.store.append(replace(windows, primitive=primitive) if self._shows_primitive else windows, checked)
        try:
            self.assigner.observe(self.store)
            self.agent.improve(self.store, self.assigner)
        except RunError as error:
            raise RunError(f"round {self.rounds}: {error}") from error
        self.rounds += 1
