"""Any environment of TorchRL, by what makes it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from credit.core.ranges import NonNegativeInt, PositiveInt
from credit.envs.facts import SUCCESS, looked_for
from credit.envs.gymnasium.copies import Make
from credit.envs.gymnasium.singles import Singles
from credit.envs.spaces import View
from credit.envs.torchrl.making import make


class TorchRLEnvironment(Singles):
    """Environments of TorchRL (`torchrl.envs.EnvBase`), side by side (`Singles`).

    Spaces are those of its specs. Observations are seen as Gymnasium's: one alone as it is, several as a dictionary.
    An episode begins with `set_seed` and `reset`; an end that is no termination is a truncation.

    Args:
        target: the dotted path of a class, or of a function that returns an environment.
        kwargs: for that.
        keys: names of the observations that are seen, in this order; None for all but what tells a success, the number
            of a `StepCounter`, and a `RewardSum`, which is never seen.
        max_steps: most steps of an episode; None takes that of its `StepCounter`, of a Gymnasium environment inside,
            or its attribute `max_steps`.
        copies, workers, view, evaluation_episodes, names, horizon: as all single environments have them (`Described`).
        success: the observation that says whether a step is a success, else as `Described` has it.

    Raises:
        UserError: at `problem`: there is no such thing, it is already many, a spec that nobody takes, no time limit.

    Example:
        >>> TorchRLEnvironment("torchrl.envs.GymEnv", {"env_name": "CartPole-v1"}).problem(None, seeds=(0,)).actions
        2
    """

    def __init__(
        self,
        target: str,
        kwargs: dict[str, Any] | None = None,
        keys: Sequence[str] | None = None,
        max_steps: PositiveInt | None = None,
        copies: PositiveInt | None = 1,
        workers: NonNegativeInt = 0,
        view: View = "auto",
        success: str = "auto",
        evaluation_episodes: PositiveInt = 10,
        names: Sequence[str] | None = None,
        horizon: PositiveInt | None = None,
    ) -> None:
        super().__init__(max_steps, horizon, copies, workers, view, success, evaluation_episodes, names)
        self.target = target
        self.kwargs = dict(kwargs or {})
        self.keys = None if keys is None else tuple(keys)

    @property
    def called(self) -> str:
        """The target."""
        return f"env.target={self.target!r}"

    @property
    def limit(self) -> int | None:
        """That of its transforms, or its own."""
        found: int | None = self._one.get_wrapper_attr("limit")
        return found

    @property
    def hint(self) -> str:
        """How a TorchRL environment is wrapped."""
        return "; a TorchRL environment is wrapped by a function that returns it in transforms of torchrl.envs"

    @property
    def _make(self) -> Make:
        told = looked_for(self.success) or SUCCESS  # those of others are never seen
        return partial(make, self.target, self.kwargs, self.keys, told, self.max_steps)
