"""The seams: every component that YAML can name is one of these.

Constructors take hyper-parameters and other components, and store them. `start(problem)` makes the state of R
replicas; nothing heavy happens before it. Class attributes say what a component needs, so that the check can tell
whether parts fit together without building any of them.
"""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Protocol

import torch
from annotated_types import Interval
from torch import Tensor

from credit.core.belief import Belief, Estimate
from credit.core.cells import PAIRS, Axis, Cells
from credit.core.component import Component
from credit.core.errors import UserError
from credit.core.policy import Policy
from credit.core.problem import LabelKind, Problem
from credit.core.state import Stateful
from credit.core.steps import Steps
from credit.core.store import Store
from credit.core.tensors import matvec
from credit.core.truth import Truth
from credit.core.windows import Windows

Relabel = Literal["all", "sampled"] | Annotated[float, Interval(gt=0, lt=1)]
Likelihood = Literal["gaussian", "logistic"]
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


class FeatureMap(Component):
    """What a reward model looks at: `features(steps) -> [..., d]`.

    Attributes:
        looks_at: the axes that it reads, where states and actions are numbers.
    """

    looks_at: Collection[Axis] = PAIRS

    @abstractmethod
    def start(self, problem: Problem) -> None:
        """Learn the sizes."""

    @abstractmethod
    def __call__(self, steps: Steps) -> Tensor:
        """φ of every step, float64 [..., d]; float32 or bool where states are vectors."""


class Encoder(Component):
    """How networks see a state: `encoder(states) -> states`, of the same size.

    Rows are stored as the environment gave them, and agents look through the encoder whenever they look at one: to
    act, to be judged, and at everything that is replayed. So what an encoder learns may change from round to round, and
    no row is out of date. It learns from training steps only: agents show it what they learn from, and evaluations are
    never shown. Reward models and feature maps look at the stored rows, in units of the world (names, thresholds and
    cells mean what they say there), and neural models scale their own features.
    """

    @abstractmethod
    def start(self, problem: Problem) -> None:
        """Learn the sizes; forget all steps."""

    @abstractmethod
    def observe(self, windows: Windows) -> None:
        """Take in new windows of training steps, once each."""

    @abstractmethod
    def __call__(self, states: Tensor) -> Tensor:
        """What networks see [R, n, O] of states [R, n, O], or of [n, O] that are the same for all replicas."""


class Uncertainty(Component):
    """How far the fits of a model can be trusted. One component may serve several models."""

    def start(self, problem: Problem) -> None:
        """Make the streams of R replicas; called once by each model that it serves."""


class Look(Stateful, ABC):
    """What a feature map says of all places."""

    @abstractmethod
    def places(self, at: Tensor | None = None) -> Tensor:
        """φ of some places [R, n, d]; or of all, [R, N, d], or [N, d] where they are the same for all replicas."""

    @abstractmethod
    def rows(self, windows: Windows, newest: bool) -> Tensor:
        """φ of every row [R, n, d] of the newest windows of a store, or of all."""


class Places(Stateful, ABC):
    """Where a pseudo-reward is defined: the cells of a table, or the steps that were taken.

    Attributes:
        cells: what they are, where they are the cells of a table.
    """

    cells: Cells | None = None

    @abstractmethod
    def look(self, features: Callable[[Steps], Tensor]) -> Look:
        """What a feature map, started, says of them."""

    @abstractmethod
    def extend(self, store: Store) -> None:
        """Take in the newest windows."""

    @abstractmethod
    def index(self, windows: Windows) -> Tensor:
        """The place [R, n] of every row of the newest windows, or of all."""

    @property
    def counts(self) -> list[int] | None:
        """How many there are in each replica, where they differ."""
        return None

    @property
    def visits(self) -> Tensor | None:
        """N(s, a) [R, N], where they are the cells of a table."""
        return None


class RewardModel(Component):
    """Maps a step to a pseudo-reward, fitted to labels only. It owns its uncertainty.

    Attributes:
        name: its name in metrics, files and figures.
        looks_at: the axes that it reads, where states and actions are numbers.
        uncertainty: how far its fit can be trusted, where it says so.
        likelihood: of labels given the sum of its rewards: real numbers around it, or bits with these log-odds.
    """

    name: str
    likelihood: Likelihood = "gaussian"
    looks_at: Collection[Axis] = PAIRS
    uncertainty: Uncertainty | None = None

    @abstractmethod
    def start(self, problem: Problem, places: Places) -> None:
        """Make R empty fits."""

    @abstractmethod
    def observe(self, store: Store) -> None:
        """Fit the newest windows, after all those before.

        Raises:
            RunError: the fit is not finite.
        """

    @abstractmethod
    def estimate(self, at: Tensor | None = None) -> Estimate:
        """What is predicted of some places [R, n], or of all [R, N]."""

    @abstractmethod
    def believe(self, steps: Steps) -> Estimate:
        """What is predicted of other steps [n], for a picture: [R, n]."""

    def prior(self, visits: Tensor) -> Tensor | float:
        """What is added to the variance of a reference after N visits [R, N] of a place."""
        return 0.0

    def looks(self) -> Tensor | None:
        """A number [N] for every cell; unvisited cells with the same number have the same prediction. None: no two."""
        return None


class Mixer(Component):
    """MSE proxies, or how well labels were predicted, → weights.

    Attributes:
        sees_label_errors: whether it is shown them; they cost a prediction of every label.
    """

    sees_label_errors: ClassVar[bool] = False

    @abstractmethod
    def weights(self, mse: Tensor, label_errors: Tensor | None = None) -> Tensor:
        """Weights [..., M, N] that sum to one over M.

        Args:
            mse: proxies [..., M, N]. label_errors: sums of products of the models' held-out label errors [..., M, M],
                in units of the labels' variance.
        """


class Bonus(Component):
    """What optimism adds to the mixed reward.

    Attributes:
        by_belief: whether it follows from the belief about a place alone, so that it can be asked for some places.
    """

    by_belief: ClassVar[bool] = False

    def start(self, problem: Problem) -> None:
        """Make streams, where the bonus is random."""

    @abstractmethod
    def __call__(self, belief: Belief, reference: RewardModel, steps: Steps | None = None) -> Tensor:
        """Bonus [R, N]; `belief.bonus` and `belief.plan` are not yet filled.

        Args:
            belief: about all places, or about some steps. reference: the first model. steps: those; None for all.
        """


class Scaler(Component):
    """How the mixed pseudo-reward is scaled and clipped before an agent sees it. It decides continuous control.

    Attributes:
        cap: the most that a scaled reward can be, where there is such a number.
    """

    cap: float | None = None

    @abstractmethod
    def __call__(self, rewards: Tensor) -> tuple[Tensor, Tensor]:
        """The scaled rewards [n] of one replica, and the unit [] by which they were divided."""

    def like(self, seen: Tensor) -> tuple[Callable[[Tensor], Tensor], Tensor]:
        """How rewards are scaled where `seen` [n] stand for all of a replica: a function of any of them, and the unit.

        Raises:
            UserError: a scaler of one's own that does not say it.
        """
        raise UserError(
            f"{type(self).__name__} does not say how some rewards are scaled as all would be; give it `like`, or set "
            "assigner.relabel=all"
        )


class CreditAssigner(Component):
    """Windows → one reward per step: a redistribution, or recovery with reward models.

    Attributes:
        relabel: which old rows a replay asks for after a refit, where rewards change: all, a share of them, the oldest
            rewards first, or those that are sampled. Where it is not all, `at` must be there.
    """

    relabel: Relabel = "all"

    @abstractmethod
    def start(self, problem: Problem) -> None:
        """Make the state of R replicas."""

    @abstractmethod
    def observe(self, store: Store) -> None:
        """Take in the newest windows."""

    @abstractmethod
    def rewards(self, windows: Windows) -> Tensor:
        """The pseudo-reward of every row [R, n] of the newest windows, or of all windows."""

    def at(self, rows: Tensor) -> Tensor:
        """The pseudo-reward of some rows of all windows, by number [R, m]."""
        raise NotImplementedError

    def belief(self) -> Belief | None:
        """What is believed about the reward, where something is."""
        return None

    def table(self) -> tuple[Cells, Tensor, Tensor] | None:
        """What a planner plans with, where there is a table: cells, and the reward of each [R, N] with optimism and
        without it."""
        return None

    @property
    def learns(self) -> bool:
        """Whether the rewards of old windows change when new ones come, so that memories must be relabelled."""
        return False


class Agent(Component):
    """The policy optimizer that consumes relabelled rewards."""

    @abstractmethod
    def start(self, problem: Problem) -> None:
        """Make the policies of R replicas."""

    @abstractmethod
    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """Actions of K copies of each replica [R, K, ...], as a `Policy` has them; may explore."""

    @abstractmethod
    def improve(self, store: Store, assigner: CreditAssigner) -> None:
        """Learn from the newest windows, or plan with what is believed."""

    @abstractmethod
    def policies(self) -> dict[str, Policy]:
        """`behaviour` and, where there are others to judge, those: without bonus (`greedy`), averaged, …"""

    def executed(self) -> Policy:
        """What `act` follows now, exploration included; by default the behaviour."""
        return self.policies()["behaviour"]

    @property
    def newest(self) -> bool:
        """Whether it learns from steps of the newest round alone, and forgets them."""
        return False

    def table(self) -> Tensor | None:
        """One action for every state [R, S], where to look it up is all that `act` does until `improve`; else None."""
        return None

    def remark(self) -> str:
        """What a user should know of it before a run, once started; nothing by default."""
        return ""

    def diagnostics(self) -> dict[str, Tensor]:
        """What the last improvement came to: name → [R], for the journal; nothing by default."""
        return {}


class Transition(Component):
    """P̂ for planning."""

    @abstractmethod
    def start(self, problem: Problem) -> None:
        """Make the counts of R replicas."""

    @abstractmethod
    def observe(self, windows: Windows) -> None:
        """Count new transitions."""

    @abstractmethod
    def backup(self, values: Tensor) -> Tensor:
        """Σ P̂(s'|s, a) v(s') [R, S, A] of values [R, S]."""


class TransitionTable(Transition):
    """A transition model that is small enough to be written out."""

    @abstractmethod
    def probabilities(self) -> Tensor:
        """P̂ [R, S, A, S]; rows sum to one, or to zero where nothing is known and nothing assumed."""

    def backup(self, values: Tensor) -> Tensor:
        """Σ P̂(s'|s, a) v(s') [R, S, A]."""
        probabilities = self.probabilities()
        return matvec(probabilities.flatten(1, 2), values).view(probabilities.shape[:-1])


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
        if isinstance(observations, (Mapping, tuple)):
            raise UserError(f"observations have parts, and {type(self).__name__} knows none")
        return torch.as_tensor(observations)

    def actions_of(self, actions: Any) -> Tensor:
        """What an agent does, of actions [n, ...] that were recorded in this environment's own action space.

        Raises:
            UserError: they are of another space.
        """
        return torch.as_tensor(actions)

    def recorded(self, actions: Tensor) -> Tensor:
        """The other way round: actions in the environment's own space, of what an agent does."""
        return actions

    def demonstrations(self) -> tuple[Windows, Tensor] | None:
        """Labelled windows that every method starts from, and their primitive rewards [R, n]; none by default."""
        return None

    def tells(self, fact: str) -> str:
        """What to do that it tells a fact which it does not tell now."""
        return f"let its steps give a fact {fact!r}, or choose another feedback"

    def remark(self) -> str:
        """What a user should know of these settings before a run, once started; nothing by default."""
        return ""

    def digests(self) -> dict[str, list[str]]:
        """What each replica was given beside its configuration: name → digest of the data; nothing by default."""
        return {}

    def summary(self, cells: Cells) -> dict[str, Tensor]:
        """Two small axes, name → whole numbers [N], over which a table too large to draw is averaged; or none."""
        return {}

    def grid(self) -> Steps | None:
        """Steps [n] at which pictures look at a reward; none by default."""
        return None

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
    """

    metric: ClassVar[str]
    higher_is_better: ClassVar[bool]

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
