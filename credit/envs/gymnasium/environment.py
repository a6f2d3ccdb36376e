"""Any environment of Gymnasium that is installed, by its id."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, partial
from typing import Any, Literal

from credit.core.errors import UserError
from credit.core.ranges import NonNegativeInt, PositiveInt
from credit.core.truth import EpisodicTruth
from credit.envs.gymnasium.copies import Copies, Here, Make
from credit.envs.gymnasium.listed import Listed
from credit.envs.gymnasium.making import NO_LIMIT, make
from credit.envs.gymnasium.pools import Pooled, Pools
from credit.envs.gymnasium.singles import Singles
from credit.envs.spaces import View


class Gymnasium(Singles):
    """Environments that Gymnasium makes, side by side (`Singles`).

    Args:
        id: as `gymnasium.make` takes it; `package:id` imports the package first.
        kwargs: for the environment's constructor.
        wrappers: names of wrappers, the innermost first: of `gymnasium.wrappers`, or `package.module:Class`.
        max_steps: most steps of an episode; None takes the time limit that the id was registered with.
        copies, workers, view, success, evaluation_episodes, names: as all single environments have them (`Described`).
        horizon: steps of an evaluation, where episodes never end: the registered time limit does not hold then.
        backend: whose environment has this id: Gymnasium's, or EnvPool's, whose copies step in threads.

    Raises:
        UserError: wrappers or workers with EnvPool; at `problem`: no such id, a space that nobody takes, no time limit.

    Example:
        >>> Gymnasium("CartPole-v1").problem(None, seeds=(0,)).actions
        2
    """

    def __init__(
        self,
        id: str,
        kwargs: dict[str, Any] | None = None,
        wrappers: Sequence[str] = (),
        max_steps: PositiveInt | None = None,
        copies: PositiveInt | None = 1,
        workers: NonNegativeInt = 0,
        view: View = "auto",
        success: str = "auto",
        evaluation_episodes: PositiveInt = 10,
        names: Sequence[str] | None = None,
        horizon: PositiveInt | None = None,
        backend: Literal["gymnasium", "envpool"] = "gymnasium",
    ) -> None:
        super().__init__(max_steps, horizon, copies, workers, view, success, evaluation_episodes, names)
        self.id = id
        self.kwargs = dict(kwargs or {})
        self.wrappers = tuple(wrappers)
        self.backend = backend
        for key, value in (("wrappers", list(wrappers)), ("workers", workers)):
            if backend == "envpool" and value:
                raise UserError(
                    f"env.{key}={value}: EnvPool's environments are stepped in its own threads, as they are; leave "
                    "that out, or env.backend=envpool"
                )

    def filmed(self) -> Gymnasium | None:
        """The same in this process, which renders `rgb_array`; None where that is none of its render modes."""
        if self.backend != "gymnasium" or "rgb_array" not in (self._one.metadata.get("render_modes") or ()):
            return None
        return type(self)(**{**self._keys, "kwargs": {**self.kwargs, "render_mode": "rgb_array"}, "workers": 0})

    def frame(self) -> Any:
        """What the first copy renders."""
        assert isinstance(self._copies, Here)
        return self._copies.frame()

    @property
    def called(self) -> str:
        """The id."""
        return f"env.id={self.id!r}"

    @property
    def limit(self) -> int | None:
        """That with which the id was registered, or MiniGrid's own."""
        registered = self._one.spec.max_episode_steps if self._one.spec else None
        return registered or getattr(self._one.unwrapped, "max_steps", None)

    @property
    def hint(self) -> str:
        """What to do with a mission in words."""
        grid = self.id.startswith(("MiniGrid", "BabyAI"))
        return "; here: env.wrappers=[minigrid.wrappers:ImgObsWrapper]" if grid else ""

    @property
    def _make(self) -> Make:
        limit = NO_LIMIT if self.endless else self.max_steps
        if self.backend == "envpool":
            return partial(Pooled, self.id, self.kwargs, limit)
        return partial(make, self.id, self.kwargs, limit, self.wrappers)

    @cached_property
    def _copies(self) -> Copies:
        return Pools(self._make, self._count) if self.backend == "envpool" else super()._copies

    def truth(self, objective: str, window: int) -> EpisodicTruth | None:
        """Where the environment offers its `P` and the start distribution: V* and the value of policies."""
        listed = Listed.of(self._one.unwrapped)
        if self.endless or listed is None or objective != "sum" or not self._problem.tabular:
            return None
        return listed.truth(window)
