"""Windows → rewards: models, what they look at, how far they are trusted, how they are mixed and scaled."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection
from typing import Annotated, ClassVar, Literal

from annotated_types import Interval
from torch import Tensor

from credit.core.belief import Belief, Estimate
from credit.core.cells import PAIRS, Axis, Cells
from credit.core.component import Component
from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.state import Stateful
from credit.core.steps import Steps
from credit.core.store import Store
from credit.core.windows import Windows

Relabel = Literal["all", "sampled"] | Annotated[float, Interval(gt=0, lt=1)]
Likelihood = Literal["gaussian", "logistic"]


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
