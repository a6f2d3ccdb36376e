"""The seams: every component that YAML can name is one of these.

Constructors take hyper-parameters and other components, and store them. `start(problem)` makes the state of R
replicas; nothing heavy happens before it. Class attributes say what a component needs, so that the check can tell
whether parts fit together without building any of them.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Collection
from typing import Any, ClassVar, Protocol

from torch import Tensor

from credit.core.cells import PAIRS, Axis, Cells
from credit.core.component import Component
from credit.core.types import Belief, Steps

# What tabular problems (`credit.core.tables`) and continuous ones (`credit.core.continuous`) each have of their own; a
# component's `domain` says which of them it takes.
SomeProblem = Any  # Problem or ContinuousProblem
SomeWindows = Any  # Windows or Trajectories
SomeDataset = Any  # Dataset or TrajectoryDataset

Act = Callable[[Tensor, int], Tensor]  # states [R] or [n, O], and the step in the window → actions [R] or [n, A]


class Feedback(Component):
    """The rule that makes a label, the only place that sees primitive rewards: `feedback(rewards [R,K,T]) -> [R,K]`.

    Attributes:
        window: T. additive: whether the label is, but for noise, the sum of primitive rewards.
    """

    window: int
    additive: ClassVar[bool] = True

    @abstractmethod
    def start(self, problem: SomeProblem) -> None:
        """Make the noise streams of R replicas."""

    @abstractmethod
    def __call__(self, rewards: Tensor) -> Tensor:
        """Labels Y [R, K] of windows with primitive rewards [R, K, T]."""


class Oracle(Protocol):
    """What a learner is worth, judged by the truth."""

    def truth(self, cells: Cells) -> Tensor:
        """The true reward [N] of the cells; NaN where they cannot express it."""

    def update(self, primitive: Tensor, labels: Tensor | None, optimizer: Optimizer) -> None:
        """Count windows with rewards r [R, K, T] and labels [R, K] (None for a window that was cut short)."""

    def metrics(self, policies: dict[str, Any], recovery: Belief | None) -> dict[str, Tensor]:
        """Metric → [R]."""


class Environment(Component):
    """Where steps happen. Its primitive reward reaches the feedback and, for metrics only, the trainer."""

    @abstractmethod
    def problem(self, window: int, seeds: tuple[int, ...], device: Any) -> SomeProblem:
        """What a learner may know."""

    @abstractmethod
    def start(self, problem: SomeProblem) -> None:
        """Put R replicas into their initial states."""

    @abstractmethod
    def collect(self, act: Act, feedback: Feedback, windows: int, steps: int) -> tuple[SomeWindows, Tensor]:
        """Run `act` for some windows of `steps` steps; return labelled windows and, for metrics, r [R, K, T]."""

    def demonstrations(self) -> tuple[SomeWindows, Tensor] | None:
        """Labelled windows that every method starts from, and their primitive rewards; none by default."""
        return None

    def remark(self) -> str:
        """What a user should know of these settings before a run, once started; nothing by default."""
        return ""

    def digests(self) -> dict[str, list[str]]:
        """What each replica was given beside its configuration: name → digest of the data; nothing by default."""
        return {}

    def summary(self, cells: Cells) -> dict[str, Tensor]:
        """Two small axes, name → whole numbers [N], over which a table too large to draw is averaged; or none."""
        return {}

    def grid(self) -> Any:
        """Moves at which pictures look at a reward; none by default."""
        return None

    def picture(self, replica: int) -> dict[str, Any]:
        """Name → array: what pictures of a run need beside its own trajectories; nothing by default."""
        return {}

    @abstractmethod
    def oracle(self, problem: SomeProblem, feedback: Feedback) -> Oracle:
        """The metrics that compare a learner with the truth, for the objective that the feedback shows."""


class FeatureMap(Component):
    """What a reward model looks at: `features(steps) -> [..., d]`.

    Attributes:
        looks_at: the axes that it reads.
    """

    looks_at: Collection[Axis] = PAIRS

    @abstractmethod
    def start(self, problem: SomeProblem) -> None:
        """Learn the sizes."""

    @abstractmethod
    def __call__(self, steps: Steps) -> Tensor:
        """φ of every step, float64 [..., d]; float32 where states are real numbers."""


class RewardModel(Component):
    """Maps a step to a pseudo-reward, fitted to labels only.

    Attributes:
        name: its name in metrics, files and figures.
    """

    name: str


class Uncertainty(Component):
    """How far a fit can be trusted."""


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
            mse: proxies [..., M, N]. label_errors: sums of products of the models' held-out label errors [..., M, M].
        """


class Bonus(Component):
    """What optimism adds to the mixed reward."""

    def start(self, problem: SomeProblem) -> None:
        """Make streams, where the bonus is random."""

    @abstractmethod
    def __call__(self, recovery: Belief, reference: RewardModel) -> Tensor:
        """Bonus [R, N]; `recovery.bonus` and `recovery.plan` are not yet filled."""


class CreditAssigner(Component):
    """Windows → one reward per step: a redistribution, or recovery with reward models."""

    @abstractmethod
    def start(self, problem: SomeProblem) -> None:
        """Make the state of R replicas."""

    @abstractmethod
    def observe(self, dataset: SomeDataset) -> None:
        """Take in the newest windows."""

    @abstractmethod
    def rewards(self, windows: SomeWindows) -> Tensor:
        """The pseudo-reward of every step, [R, K, T] or [N]."""

    def recovery(self) -> Belief | None:
        """What is believed about the reward, where something is."""
        return None


class Optimizer(Component):
    """The policy optimizer that consumes relabelled rewards."""

    @abstractmethod
    def start(self, problem: SomeProblem) -> None:
        """Make the policies of R replicas."""

    @abstractmethod
    def act(self, states: Tensor, step: int) -> Tensor:
        """Actions [R] in states [R] at a step of the window."""

    @abstractmethod
    def improve(self, dataset: SomeDataset, assigner: CreditAssigner) -> None:
        """Learn from the newest windows, or plan with what is believed."""

    @abstractmethod
    def policies(self) -> dict[str, Any]:
        """`behaviour` and, where there is one without bonus, `greedy`: actions [R, S], or [R, T, S] by step.

        In continuous problems functions like `act`, without its noise: `behaviour`, and others that are evaluated too.
        """

    def diagnostics(self) -> dict[str, Tensor]:
        """What the last improvement came to: name → [R], for the journal; nothing by default."""
        return {}

    def executed(self) -> Tensor:
        """What `act` follows now, for episodic problems: actions [R, T, S], or probabilities [R, T, S, A]."""
        return self.policies()["behaviour"]
