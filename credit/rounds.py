"""When a run collects, refits and reports: in rounds of windows, or of steps."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import torch

from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.seams import Agent, CreditAssigner, Environment, Feedback


class Keys(Protocol):
    """What a trainer is told of its rounds."""

    env: Environment
    steps: int | None
    windows_per_round: int
    first_windows: int
    first_windows_per_round: int
    random_windows: int
    log_every: int
    steps_per_round: int | None
    random_steps: int
    episodes: int | None


def problem_of(
    env: Environment, feedback: Feedback, seeds: Sequence[int], device: torch.device | str, rolling: bool
) -> Problem:
    """What learners may know of an environment under a feedback.

    Args:
        env, feedback: not started. seeds: one a replica. rolling: whether rounds are of steps.

    Raises:
        UserError: no length of windows, one that no episode has, or one that needs rounds of steps.
    """
    name, window, horizon = type(env).__name__, feedback.window, env.horizon
    if window is None and env.setting == "continuing":
        raise UserError(
            f"feedback.window=null is a whole episode, and {name} goes on for ever: no label would ever come; take "
            "windows of T steps, such as feedback=block_sum feedback.window=20"
        )
    if window is None and horizon is None:
        raise UserError(
            f"feedback.window=null is a whole episode, and episodes of {name} have no length of their own; give T, "
            "such as feedback.window=7"
        )
    if window is not None and horizon is not None and window > horizon:
        raise UserError(
            f"feedback.window={window}: the longest episode of {name} has {horizon} steps; take at most {horizon}, or "
            "null for whole episodes"
        )
    if rolling and not env.rolls:
        raise UserError(
            f"trainer.steps_per_round: copies of {name} begin their windows together, so rounds are of windows; set it "
            "to null, and trainer.windows_per_round"
        )
    if feedback.reads is not None and env.facts is not None and feedback.reads not in env.facts:
        raise UserError(
            f"feedback reads whether a step is a {feedback.reads}, and {name} does not tell; "
            f"{env.tells(feedback.reads)}"
        )
    problem = env.problem(window or horizon or 0, tuple(seeds), device)
    inside = (problem.episodic and problem.window < problem.horizon) or feedback.lengths is not None
    late = feedback.delay or feedback.delay_windows or feedback.missing
    if not rolling and (inside or late):
        what = f"windows of {feedback.lengths or problem.window} steps inside episodes" if inside else "such labels"
        how = "late" if feedback.delay or feedback.delay_windows else "missing"
        raise UserError(
            f"feedback: {what if inside else how + ' labels'} need rounds of steps; set trainer.steps_per_round, such "
            f"as trainer.steps_per_round={max(problem.horizon, 100)}"
        )
    even = not rolling and not env.ends_early
    lockstep = rolling or not env.ends_early
    names = tuple(env.names or problem.names)
    return replace(problem, labels=feedback.kind, even=even, lockstep=lockstep, names=names)


def require_in_time(feedback: Feedback, assigner: CreditAssigner, agent: Agent, steps: int | None) -> None:
    """Refuse labels that come too late for an agent that learns from the newest round alone.

    Args:
        steps: of each copy in a round; None where rounds are of windows.

    Raises:
        UserError: rewards are made of the label itself; or no step of a round has its label when the round ends.
    """
    late = f"feedback.delay={feedback.delay}, delay_windows={feedback.delay_windows}: labels come late, and this agent"
    if not (agent.newest and (feedback.delay or feedback.delay_windows)):
        return
    if not assigner.learns:
        raise UserError(
            f"{late} learns from the newest round alone, in which {type(assigner).__name__} needs the labels "
            "themselves; use a method with reward models (method=reference), an agent that remembers (td3, "
            "discrete_sac, dqn, sac), or set both to 0"
        )
    least = feedback.lengths[0] if feedback.lengths else feedback.window or 1
    if steps is not None and (wait := max(feedback.delay, feedback.delay_windows * least)) >= steps:
        raise UserError(
            f"{late} learns from the newest round alone, of {steps} steps of each copy: none of them has its label "
            f"within {wait}; take a larger trainer.steps_per_round"
        )


@dataclass(frozen=True)
class Plan:
    """The rounds of a run, counted in units: windows, or steps.

    Attributes:
        rolling: whether a unit is a step. unit: steps of one. whole: units of the run. rest: steps behind them.
        random: units at the start in which actions are random. every: units between two rows of the journal.
        rounds: units of a round. first: units at the start in rounds of their own, first_rounds: which have so many.
        steps: of the whole run; 0 where only its episodes are known. episodes: whole ones of each replica, that are
            taken in rounds of steps; 0 where the units say how many.
    """

    rolling: bool
    unit: int
    whole: int
    rest: int
    random: int
    every: int
    rounds: int
    first: int = 0
    first_rounds: int = 1
    steps: int = 0
    episodes: int = 0

    @classmethod
    def of(cls, trainer: Keys, problem: Problem) -> Plan:
        """What a trainer's keys come to.

        Raises:
            UserError: they do not go together.
        """
        steps, window = _steps(trainer, problem), problem.window
        if steps is not None and steps < window:
            raise UserError(f"trainer.steps={steps}: shorter than one window (feedback.window={window})")
        if (size := trainer.steps_per_round) is not None:
            for key in ("first_windows", "random_windows"):
                if getattr(trainer, key):
                    raise UserError(
                        f"trainer.{key}={getattr(trainer, key)}: rounds are of steps (trainer.steps_per_round={size}); "
                        "leave it 0, and see trainer.random_steps"
                    )
            copies = trainer.env.copies or 1
            if steps is None:
                episodes = _episodes(trainer, problem, size, copies)
                every = trainer.log_every * size
                return cls(True, 1, sys.maxsize, 0, trainer.random_steps, every, size, episodes=episodes)
            if copies > 1 and (size % copies or steps % copies):
                raise UserError(
                    f"env.copies={copies}: each takes as many of trainer.steps_per_round={size} and trainer.steps="
                    f"{steps}; take multiples of {copies}"
                )
            if steps // copies < window:
                raise UserError(
                    f"trainer.steps={steps}: each of env.copies={copies} takes {steps // copies} of them, less than "
                    f"one window of {window}; take at least {copies * window}"
                )
            return cls(True, 1, steps, 0, trainer.random_steps, trainer.log_every * size, size, steps=steps)
        if trainer.random_steps:
            raise UserError(
                f"trainer.random_steps={trainer.random_steps}: rounds are of windows; set it to 0, and "
                "trainer.random_windows to as many as are to be random"
            )
        assert steps is not None
        budget = f"trainer.steps={steps}" if trainer.episodes is None else f"trainer.episodes={trainer.episodes}"
        whole, rest = divmod(steps, window)
        for key in ("windows_per_round", "first_windows_per_round", "random_windows"):
            if getattr(trainer, key) > whole:
                raise UserError(
                    f"trainer.{key}={getattr(trainer, key)}: more than the {whole} windows of the whole run "
                    f"({budget}, feedback.window={window}); take at most {whole}, or a longer run"
                )
        if rest and problem.episodic and not problem.tabular:
            raise UserError(
                f"trainer.steps={steps}: trajectories cannot be cut short; take a multiple of feedback.window="
                f"{window}, like {max(whole, 1) * window}"
            )
        sizes = trainer.windows_per_round, trainer.first_windows, trainer.first_windows_per_round
        return cls(False, window, whole, rest, trainer.random_windows, trainer.log_every, *sizes, steps=steps)

    def size(self, done: int) -> int:
        """How many units come before the next refit, after so many; a round crosses no border."""
        size = self.first_rounds if done < self.first else self.rounds
        ends = [end - done for end in (self.first, self.random, self.whole) if end > done]
        return min([size, *ends])


def _steps(trainer: Keys, problem: Problem) -> int | None:
    """Steps of the run; None where episodes are counted, and rounds are of steps.

    Raises:
        UserError: neither steps nor episodes are given, or both; or there are no episodes.
    """
    steps, episodes = trainer.steps, trainer.episodes
    if episodes is None:
        if steps is None:
            raise UserError("trainer.steps=null and trainer.episodes=null: how long is the run? Give one of them")
        return steps
    if steps is not None:
        raise UserError(
            f"trainer.steps={steps} and trainer.episodes={episodes}: a run is as long as one of them says; set the "
            "other to null"
        )
    if not problem.episodic:
        raise UserError(
            f"trainer.episodes={episodes}: {type(trainer.env).__name__} goes on for ever and has no episodes; set it "
            "to null, and trainer.steps"
        )
    return None if trainer.steps_per_round is not None else episodes * problem.window


def _episodes(trainer: Keys, problem: Problem, size: int, copies: int) -> int:
    """Episodes of each replica, taken in rounds of so many steps.

    Raises:
        UserError: copies do not take equally many; or there are several replicas, whose episodes end apart.
    """
    episodes = trainer.episodes or 0
    if episodes % copies or size % copies:
        raise UserError(
            f"env.copies={copies}: each takes as many of trainer.episodes={episodes} and of trainer.steps_per_round="
            f"{size}; take multiples of {copies}"
        )
    if problem.replicas > 1:
        raise UserError(
            f"trainer.episodes={episodes} with trainer.steps_per_round={size}: {problem.replicas} replicas side by "
            "side take as many steps, and so not as many episodes; start one trainer a seed"
        )
    return episodes
