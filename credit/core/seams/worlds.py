"""Where steps happen, what labels are, and what says how good a policy is."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from typing import Any, ClassVar, Literal, NamedTuple, Protocol

import numpy as np
import torch
from gymnasium.spaces import Space
from numpy.typing import NDArray
from torch import Tensor

from credit.core.belief import Belief
from credit.core.cells import Cells
from credit.core.component import Component
from credit.core.errors import UserError
from credit.core.policy import Policy
from credit.core.problem import LabelKind, Problem
from credit.core.seams.agents import Agent
from credit.core.state import Stateful
from credit.core.steps import Steps
from credit.core.truth import Truth
from credit.core.windows import Windows

Objective = Literal["sum", "last", "success"]  # a label is about all rewards of a window, its last one, or its goal


class Feedback(Component):
    """The rule that makes a label, the only place that sees primitive rewards: `feedback(rewards [R,K,T]) -> [R,K]`.

    Attributes:
        window: T, most steps of a window; None for a whole episode.
        lengths: least and most steps, where they are drawn anew for each window.
        missing, delay, delay_windows, cut: how labels arrive, as `credit.envs.feedback.Labels` says.
        objective: what it asks for, so that a judge knows what to judge; every feedback says it.
        kind: of its labels: real numbers, or bits, of which 1 says success.
        reads: a fact of the environment that it is shown instead of the reward, where the environment tells it.
        whole: whether it needs windows of T steps; environments whose episodes may end before are refused.
    """

    window: int | None
    lengths: tuple[int, int] | None = None
    missing: float = 0.0
    delay: int = 0
    delay_windows: int = 0
    cut: Literal["label", "drop"] = "label"
    objective: ClassVar[Objective | str]
    kind: ClassVar[LabelKind] = "real"
    reads: ClassVar[str | None] = None
    whole: ClassVar[bool] = False

    @abstractmethod
    def start(self, problem: Problem) -> None:
        """Make the noise streams of R replicas."""

    @abstractmethod
    def __call__(self, rewards: Tensor) -> Tensor:
        """Labels Y [R, K] of windows with primitive rewards [R, K, T], 0 behind the end of a shorter one."""

    def label(self, rewards: Tensor, lengths: Tensor) -> Tensor:
        """The same, of windows whose lengths [R, K] are known, 0 where there is none."""
        return self(rewards)


class Transitions(NamedTuple):
    """What a step of K copies of each of R replicas led to.

    Attributes:
        states: s' [R, K, ...], before any new episode begins. rewards: the primitive r [R, K], float64.
        terminated: whether nothing lies behind s' [R, K]. truncated: whether the episode ends for another reason
            [R, K]. None where nothing ends before the window does.
        facts: name → tensor [R, K, ...], what feedback may read and evaluations keep (`success`, …); never a learner.
    """

    states: Tensor
    rewards: Tensor
    terminated: Tensor | None = None
    truncated: Tensor | None = None
    facts: Mapping[str, Tensor] = {}


class Act(Protocol):
    """Whatever acts: a policy, or an agent that explores."""

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """Actions of K copies of each replica [R, K, ...], as `Policy.act` has them."""


def _numbers(name: str, values: Any, space: Space[Any]) -> Tensor:
    """Values [n, ...] of a space without parts as a tensor.

    Raises:
        UserError: they are no numbers.
    """
    nested = isinstance(values, (Mapping, tuple))
    if not nested and (isinstance(values, Tensor) or (values := np.asarray(values)).dtype.kind in "biuf"):
        return torch.as_tensor(values)
    what = "has parts" if nested else f"is {values[0]!r}, no numbers"
    raise UserError(f"{name} {what}, and here it must be of {space}")


class Environment(Component):
    """Where steps happen: K copies of each of R replicas, stepped together.

    Its primitive reward reaches the collector alone, which hands it to feedback and judge. Components that need to
    know more than the problem get `knowledge()`. An environment need have no more than `problem`, `start`, `reset` and
    `step`.

    Attributes:
        copies: K, how many episodes of a replica run at once; None for as many as are collected. It is 1 where the
            task goes on for ever.
        horizon: most steps of an episode, where it has a limit of its own.
        facts: what its steps tell beside the reward, for feedback and judges; None where that is not known before.
        ends_early: whether an episode may end before its window does; else every window has T steps.
        rolls: whether copies may begin episodes one by one while others go on, and be saved in mid-episode.
        evaluation_episodes: of each replica, in each evaluation by rollouts.
        names: of the coordinates of an observation, for feature maps; None: s0, s1, …
    """

    copies: int | None = None
    horizon: int | None = None
    facts: Collection[str] | None = None
    ends_early: ClassVar[bool] = True
    rolls: ClassVar[bool] = True
    evaluation_episodes: int = 20
    names: Sequence[str] | None = None

    @abstractmethod
    def problem(self, window: int, seeds: tuple[int, ...], device: torch.device | str) -> Problem:
        """What a learner may know; other spaces than `Discrete` and `Box` by the encoders of `credit.envs.spaces`.

        Raises:
            UserError: no such task.
        """

    @abstractmethod
    def start(self, problem: Problem, copies: int = 1, purpose: str = "environment") -> None:
        """Make K copies of each of R replicas, all state anew.

        Args:
            problem: sizes, seeds, device. copies: K.
            purpose: what they are for; copies with another purpose meet other random numbers.
        """

    @abstractmethod
    def reset(self, mask: Tensor | None = None) -> Tensor:
        """Begin an episode in the copies of the mask [R, K], None for all; the states of all copies [R, K, ...]."""

    @abstractmethod
    def step(self, actions: Tensor, mask: Tensor | None = None) -> Transitions:
        """Act in the copies of the mask [R, K], None for all; the others stay as they are.

        Args:
            actions: [R, K, ...] as the problem's action space has them.
        """

    @property
    def follows(self) -> bool:
        """Whether `follow` is here now, for one copy of a task that goes on for ever."""
        return False

    def follow(self, table: Tensor, windows: int) -> tuple[Tensor, ...]:
        """Whole windows under one action a state [R, S], as by `step`: states, actions, next states and r [R, n]."""
        raise NotImplementedError

    def twin(self) -> Environment:
        """Another of the same that shares no state with this one, to be started."""
        return copy.deepcopy(self)

    def knowledge(self) -> Any:
        """What is known of this environment beside the problem, for components that ask for it: a frozen record."""
        return None

    def truth(self, objective: str, window: int) -> Truth | None:
        """What an exact judge judges by, where P and r are known; None: judge by rollouts.

        Raises:
            UserError: P and r are known, but not what this objective comes to.
        """
        return None

    def states_of(self, observations: Any) -> Tensor:
        """States [n, ...] as learners see them, of what was recorded in this environment's own observation space.

        Raises:
            UserError: that is of another space. By default they must be as learners see them.
        """
        return _numbers("observation", observations, self.problem(self.horizon or 1, (0,), "cpu").observation_space)

    def actions_of(self, actions: Any) -> Tensor:
        """What an agent does, of actions [n, ...] that were recorded in this environment's own action space.

        Raises:
            UserError: they are of another space.
        """
        return _numbers("action", actions, self.problem(self.horizon or 1, (0,), "cpu").action_space)

    def recorded(self, actions: Tensor) -> Tensor:
        """The other way round: actions in the environment's own space, of what an agent does."""
        return actions

    def impossible(self, states: NDArray[Any]) -> NDArray[np.bool_]:
        """In which of states [n, ...] that others recorded nobody can be here [n], such as a wall; none by default."""
        return np.zeros(len(states), dtype=bool)

    def demonstrations(self) -> tuple[Windows, Tensor] | None:
        """Labelled windows that every method starts from, and their primitive rewards [R, n]; none by default."""
        return None

    def tells(self, fact: str) -> str:
        """What to do that it tells a fact which it does not tell now."""
        return f"let its steps give a fact {fact!r}, or choose another feedback"

    def digests(self) -> dict[str, list[str]]:
        """What each replica was given beside its configuration: name → digest of the data; nothing by default."""
        return {}

    def summary(self, cells: Cells) -> dict[str, Tensor]:
        """Two small axes, name → whole numbers [N], over which a table too large to draw is averaged; or none."""
        return {}

    def grid(self) -> Steps | None:
        """Steps [n] at which pictures look at a reward; none by default."""
        return None

    def filmed(self) -> Environment | None:
        """Another of the same, to be started, whose first copy can be looked at by `frame`; None where none can."""
        return None

    def frame(self) -> Any:
        """A picture of the first copy as it is now [height, width, 3] uint8, where this is a `filmed` one."""
        raise NotImplementedError

    def picture(self, replica: int) -> dict[str, Any]:
        """Name → array: what pictures of a run need beside its own windows; nothing by default."""
        return {}


class Evaluated(NamedTuple):
    """Episodes that were only looked at.

    Attributes:
        windows: K episodes of each replica; the labels are their returns. primitive: r [R, n].
        facts: name → [R, K, ...], what the environment said of each episode's last step.
    """

    windows: Windows
    primitive: Tensor
    facts: dict[str, Tensor]


class Evaluation(Stateful, ABC):
    """Episodes with copies and random numbers of their own, from which nobody learns."""

    @abstractmethod
    def __call__(self, policy: Policy) -> Evaluated:
        """Some whole episodes of each replica."""


class Judge(Component):
    """What says how good a policy is, by truth or by rollouts of its own.

    Attributes:
        metric: the name of the figure by which methods are ranked. higher_is_better: its direction.
        rates: its figures that are shares, in [0, 1], so that their intervals stay there. The first word is enough:
            `policy/error` is `policy/error_greedy`, too. The value is another figure, without which it is none; or "".
    """

    metric: ClassVar[str]
    higher_is_better: ClassVar[bool]
    rates: ClassVar[Mapping[str, str]] = {}

    @abstractmethod
    def update(self, windows: Windows, primitive: Tensor, agent: Agent, complete: bool = True) -> None:
        """Count windows with rewards r [R, n] that an agent collected; `complete` is false for one cut short."""

    @abstractmethod
    def measure(self, policies: Mapping[str, Policy], belief: Belief | None) -> dict[str, Tensor]:
        """Metric → [R]."""

    def truth(self, cells: Cells) -> Tensor | None:
        """The true reward [N] of cells, NaN where they cannot express it; None where nobody knows."""
        return None

    def picture(self, replica: int) -> dict[str, Any]:
        """Name → array: what it saw last, for pictures of a run; nothing by default."""
        return {}
