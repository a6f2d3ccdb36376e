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
from credit.rounds import Plan, problem_of, require_in_time

Log = Callable[[int, dict[str, Tensor]], None]


class Trainer(Component):
    """Algorithms B.1 and B.2: run a policy for some windows, learn a reward from their labels, improve the policy.

    Args:
        env: where steps happen.
        feedback: what a label is.
        assigner: windows → one reward per step.
        agent: rewards → policy.
        steps: primitive steps a run; a last window that they cut short gives no label and is not learned from. Where
            trajectories may end early, and rounds are of windows, each counts for its longest. None where there are
        episodes: whole episodes a run, of each replica; None where there are steps.
        windows_per_round: windows collected between two refits.
        first_windows: windows at the start that are collected in rounds of their own size,
        first_windows_per_round: which is this.
        random_windows: windows at the start in which actions are random.
        log_every: windows between two rows of the journal; where rounds are of steps, rounds.
        steps_per_round: steps of each replica between two refits; None: rounds are of windows. Where they are of steps,
            copies go on from round to round, and windows may be parts of episodes.
        random_steps: steps at the start in which actions are random, where rounds are of steps.
    """

    keeps: ClassVar = (
        *("env", "feedback", "collector", "assigner", "agent", "_explorer", "judge", "store"),
        *("rounds", "given", "collected", "_seen"),
    )

    def __init__(
        self,
        env: Environment,
        feedback: Feedback,
        assigner: CreditAssigner,
        agent: Agent,
        steps: PositiveInt | None = 14_000,
        windows_per_round: PositiveInt = 1,
        first_windows: NonNegativeInt = 0,
        first_windows_per_round: PositiveInt = 1,
        random_windows: NonNegativeInt = 0,
        log_every: PositiveInt = 40,
        steps_per_round: PositiveInt | None = None,
        random_steps: NonNegativeInt = 0,
        episodes: PositiveInt | None = None,
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
        self.steps_per_round = steps_per_round
        self.random_steps = random_steps
        self.episodes = episodes

    def start(self, seeds: tuple[int, ...], device: torch.device | str = "cpu") -> None:
        """Make the state of one replica a seed; everything that can be refused is refused here.

        Raises:
            UserError: the parts do not go together with these sizes.
        """
        self.problem = problem_of(self.env, self.feedback, seeds, device, rolling=self.steps_per_round is not None)
        self.plan = Plan.of(self, self.problem)
        round_of = self.steps_per_round and self.steps_per_round // (self.env.copies or 1)
        require_in_time(self.feedback, self.assigner, self.agent, round_of)
        roots = {"feedback": self.feedback, "assigner": self.assigner, "agent": self.agent}
        require(roots, self.problem)
        self.env.start(self.problem)
        parts = [pair for name, root in roots.items() for pair in parts_of(root, name)]
        inform(parts, self.env.knowledge(), type(self.env).__name__)
        for part in (self.feedback, self.assigner, self.agent, self._explorer):
            part.start(self.problem)
        self.collector = Collector(self.env, self.feedback, self.problem)
        self.judge = judge(self.env, self.feedback, self.problem, self.collector.evaluation)
        self.store = Store(self.problem, self.plan.steps if self.problem.tabular else 0)
        self._shows_primitive = any(part.sees_primitive for _, part in parts)
        self.rounds = 0  # that were learned from
        self.given = 0  # windows of demonstrations
        self._given: tuple[Windows, Tensor | None] | None = None  # what `give` was told
        self._seen = 0  # of what is collected, what was learned from
        self.collected = 0  # windows of each replica, or steps, without demonstrations

    def give(self, windows: Windows, primitive: Tensor | None = None) -> None:
        """Learn from these before the first round, behind what the environment demonstrates; no judge sees them.

        Args:
            windows: of every replica, as this run's own are. primitive: their rewards r [R, n], where they are known.

        Raises:
            UserError: a part is shown r, and nobody knows it.
        """
        if primitive is None and self._shows_primitive:
            raise UserError(
                "a part of this method is shown the primitive reward of every step, and demonstrations with labels "
                "alone have none; give them with a column reward, or choose another method"
            )
        self._given = windows, primitive

    def run(
        self,
        log: Log,
        progress: Callable[[int], None] = lambda steps: None,
        between: Callable[[], None] = lambda: None,
    ) -> None:
        """Take all steps, or those that are left after `load_state_dict`.

        Args:
            log: called with the step and the metrics [R] as `log_every` says and at the end, and at the start
                where there are demonstrations.
            progress: called with the number of steps taken so far, or of episodes, of `total`.
            between: called between two rounds, where the state is whole; it may raise to end the run there.

        Raises:
            RunError: a label is NaN or infinite, or a network is.
        """
        plan = self.plan
        if not self.rounds:
            for demonstrations in (self.env.demonstrations(), self._given):
                if demonstrations is not None:
                    self._learn(*demonstrations)
            self.given = len(self.store)
            if self.given:
                log(0, self.metrics())
                between()
        while not self._done():
            before, count = self.collected, plan.size(self.collected)
            actor = self._actor()
            if plan.rolling:
                found = self.collector.roll(actor, count, plan.episodes)
                count = self.collector.taken
            else:
                found = self.collector.collect(actor, count)
            self.collected += count
            if found is not None:
                taken = self.collected - self._seen if plan.rolling else None
                self._learn(*self._judged(*found, actor), checked=True, taken=taken)
                self._seen = self.collected
            progress(self.collector.episodes if plan.episodes else self.collected * plan.unit)
            if self.collected // plan.every > before // plan.every and (plan.rest or not self._done()):
                log(self.collected * plan.unit, self.metrics())
            if not self._done():  # what a last round leaves is not all state
                between()
        if plan.rest:
            windows, primitive = self.collector.collect(self._actor(), 1, plan.rest)
            self.judge.update(windows, primitive, self._actor(), complete=False)
        progress(self.total)
        log(plan.steps or self.collected, self.metrics())

    @property
    def total(self) -> int:
        """What a run's progress goes up to: steps, or episodes where rounds of steps take as many as these have."""
        return self.plan.episodes or self.plan.steps

    def metrics(self) -> dict[str, Tensor]:
        """Metric → [R], as judged, and what the agent says of itself."""
        own = {f"optimizer/{name}": value for name, value in self.agent.diagnostics().items()}
        return self.judge.measure(self.agent.policies(), self.belief()) | own

    def belief(self) -> Belief | None:
        """What is believed about the reward, where the assigner believes something."""
        return self.assigner.belief()

    def _done(self) -> bool:
        if self.plan.episodes:
            return self.collector.episodes >= self.plan.episodes
        return self.collected >= self.plan.whole

    def _actor(self) -> Agent:
        return self._explorer if self.collected < self.plan.random else self.agent

    def _judged(self, windows: Windows, primitive: Tensor, actor: Agent) -> tuple[Windows, Tensor]:
        """New windows, looked through and shown to the judge."""
        if not math.isfinite(float(windows.labels.sum())) and not (finite := windows.labels.isfinite()).all():
            replica, k = (int(i) for i in (~finite).nonzero()[0])
            raise RunError(
                f"window {len(self.store) + k} of seed {self.problem.seeds[replica]} has the label "
                f"{float(windows.labels[replica, k])}: labels must be finite; look at env's reward and at feedback"
            )
        self.judge.update(windows, primitive, actor)
        return windows, primitive

    def _learn(
        self, windows: Windows, primitive: Tensor | None, checked: bool = False, taken: int | None = None
    ) -> None:
        self.store.append(replace(windows, primitive=primitive) if self._shows_primitive else windows, checked, taken)
        try:
            self.assigner.observe(self.store)
            self.agent.improve(self.store, self.assigner)
        except RunError as error:
            raise RunError(f"round {self.rounds}: {error}") from error
        self.rounds += 1
