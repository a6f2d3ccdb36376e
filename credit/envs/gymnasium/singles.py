"""Single environments with Gymnasium's face side by side: what does not depend on where they come from."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, Literal, NoReturn

import numpy as np
import torch
from gymnasium.spaces import Space
from gymnasium.vector.utils import concatenate, create_empty_array
from torch import Tensor

from credit.core.errors import RunError, nearest
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Transitions
from credit.core.state import pack, same, unpack
from credit.core.streams import reset_seed
from credit.envs import spaces
from credit.envs.facts import REWARD
from credit.envs.gymnasium.copies import Copies, Here, Out, Raised
from credit.envs.gymnasium.described import Described
from credit.envs.gymnasium.workers import Elsewhere


class Singles(Described):
    """R × K single environments in lock-step; each episode is seeded by (seed, copy, purpose, episode).

    What they are, and which keys they take, `Described` says. `info` reaches nobody, but for the success that it may
    report, which feedback and judges read. Whoever is gone on with in mid-episode plays that again.
    """

    @cached_property
    def _copies(self) -> Copies:
        """All of them, made when the first episode begins."""
        return Elsewhere(self._make, self._count, self.workers) if self.workers else Here(self._make, self._count)

    def start(self, problem: Problem, copies: int = 1, purpose: str = "environment") -> None:
        """Make K copies of R replicas; none has begun an episode."""
        self._problem, self._purpose, self._shape = problem, purpose, (problem.replicas, copies)
        self._count = problem.replicas * copies
        self._episodes = np.zeros(self._count, dtype=np.int64)  # begun by each copy
        self._open: list[list[Any] | None] = [None] * self._count  # actions of its episode, while that goes on
        self._latest: list[Any] = [None] * self._count
        self._heard = False  # whether any copy ever told a success, or that it is none
        if (held := vars(self).pop("_copies", None)) is not None:
            held.close()

    def reset(self, mask: Tensor | None = None) -> Tensor:
        """Begin an episode in the copies of the mask [R, K]; the states of all."""
        self._begin(self._which(mask))
        return self._states()

    def _begin(self, which: Sequence[int]) -> None:
        seeds = [self._seed(n, self._episodes[n]) for n in which]
        for n in which:
            self._episodes[n], self._open[n] = self._episodes[n] + 1, None
        for n, first in zip(which, self._asked("reset", which, seeds), strict=True):
            self._latest[n], self._open[n] = first, []

    def step(self, actions: Tensor, mask: Tensor | None = None) -> Transitions:
        """One step of the copies of the mask [R, K]."""
        which = self._which(mask)
        taken = self._encoders[1](actions).flatten(0, 1).cpu().numpy()
        chosen = [self._action(taken[n]) for n in which]
        rewards, success = torch.zeros(self._count, dtype=FLOAT), torch.zeros(self._count, dtype=torch.bool)
        terminated, truncated = success.clone(), success.clone()
        outs = self._asked("step", which, chosen)
        if (key := self._reports) is not None:
            self._require_told(key, which, outs)
        for n, action, out in zip(which, chosen, outs, strict=True):
            self._latest[n] = out.observation
            rewards[n], terminated[n], truncated[n] = out.reward, out.terminated, out.truncated
            success[n] = key is not None and bool(out.info.get(key, False))
            if out.terminated or out.truncated:
                if self.endless:
                    raise RunError(
                        f"{self.called} ended an episode, {self._named(n)}, and env.horizon={self.endless} says that "
                        "none ends; give env.max_steps=<most steps of an episode> instead"
                    )
                self._open[n] = None
            elif (done := self._open[n]) is not None:
                done.append(action)
        self._require_finite("reward", rewards)
        if self.success == REWARD:
            success = rewards > 0
        facts = {"success": self._all(success)} if self.facts else {}
        ended = self._all(terminated), self._all(truncated & ~terminated)
        return Transitions(self._states(), self._all(rewards), *ended, facts)

    def _require_told(self, key: str, which: Sequence[int], outs: Sequence[Out]) -> None:
        """A misspelt key would make every step a failure.

        Raises:
            RunError: an episode is over, and no step of any copy had it.
        """
        self._heard = self._heard or any(key in out.info for out in outs)
        for n, out in zip(which, outs, strict=True):
            last = len(self._open[n] or ()) + 1 == self.endless
            if not self._heard and (out.terminated or out.truncated or last):
                raise RunError(
                    f"{self.called}: up to the end of an episode no step had the key {key!r} in its info, "
                    f"{self._named(n)}; {nearest(key, map(str, out.info))}; env.success=KEY names another, and "
                    "env.success=reward says that a positive reward is a success"
                )

    def _action(self, value: np.ndarray) -> Any:
        """As the environment's space has it."""
        return int(value) if value.ndim == 0 else value

    def _asked(self, method: Literal["reset", "step"], which: Sequence[int], arguments: Sequence[Any]) -> list[Any]:
        try:
            return getattr(self._copies, method)(which, arguments)
        except Raised as error:
            where = self._named(error.copy)
            raise RunError(f"{self.called} {error.did} {method}, {where}: {error.what}") from error

    def _named(self, copy: int) -> str:
        """Whose a copy is, and where it is."""
        replica, k = divmod(copy, self._shape[1])
        return (
            f"seed {self._problem.seeds[replica]}, copy {k} for {self._purpose}, episode {self._episodes[copy]}, step "
            f"{len(self._open[copy] or ())}"
        )

    def _which(self, mask: Tensor | None) -> list[int]:
        return list(range(self._count)) if mask is None else mask.flatten().nonzero()[:, 0].tolist()

    def _seed(self, copy: int, episode: int) -> int:
        replica, k = divmod(copy, self._shape[1])
        return reset_seed(self._problem.seeds[replica], self._purpose, k, int(episode))

    def _all(self, values: Tensor) -> Tensor:
        return values.view(*self._shape, *values.shape[1:]).to(self._problem.device)

    def _states(self) -> Tensor:
        """What all copies see [R, K, ...]."""
        space = self._one.observation_space
        block: Any = create_empty_array(space, self._count)  # anew: what was seen before stays what it was
        try:
            block = concatenate(space, self._latest, block)
        except Exception:  # whatever NumPy says of other shapes and types
            self._require_fits(space)
            raise
        if (wrong := spaces.outside(space, block)) is not None and wrong.any():
            self._misfit(int(wrong.argmax()), space)
        states = self._encoders[0](block)
        self._require_finite("observation", states)
        return self._all(states)

    def _require_fits(self, space: Space[Any]) -> None:
        for n, seen in enumerate(self._latest):
            try:
                one: Any = create_empty_array(space, 1)
                concatenate(space, [seen], one)
            except Exception:  # see above
                self._misfit(n, space)

    def _misfit(self, copy: int, space: Space[Any]) -> NoReturn:
        seen = self._latest[copy]
        given = f"{seen!r}"
        if isinstance(seen, np.ndarray):
            given = f"{seen.tolist() if seen.size <= 8 else 'an array'}, {list(seen.shape)} of {seen.dtype}"
        raise RunError(
            f"{self.called}: observation {given[:200]}, {self._named(copy)}; it must be of {space}, as the environment "
            "says of itself"
        )

    def _require_finite(self, what: str, values: Tensor) -> None:
        if values.is_floating_point() and not (finite := values.isfinite()).all():
            place = tuple((~finite).nonzero()[0].tolist())
            raise RunError(
                f"{self.called}: {what} {float(values[place])} at number {place[1:] or 0}, "
                f"{self._named(place[0])}; learners need finite numbers"
            )

    def twin(self) -> Singles:
        """Another of the same, to be started."""
        return type(self)(**self._keys)

    @property
    def _keys(self) -> dict[str, Any]:
        """What it was made of."""
        keys = {key: getattr(self, key) for key in inspect.signature(type(self)).parameters if key != "horizon"}
        return {**keys, "horizon": self.endless}

    def state_dict(self) -> dict[str, Any]:
        """How many episodes each copy has begun, and what it has done in the one that is open."""
        open_ = [None if actions is None else pack(np.array(actions), "the open episode") for actions in self._open]
        held = zip(self._open, self._latest, strict=True)
        latest = [None if actions is None else pack(seen, "the last observation") for actions, seen in held]
        return {"episodes": self._episodes.tolist(), "open": open_, "latest": latest, "heard": self._heard}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Begin the open episodes again with their seeds, and play what was played.

        Raises:
            ValueError: that leads elsewhere.
        """
        self._episodes = np.asarray(state["episodes"], dtype=np.int64)
        self._heard = state.get("heard", True)  # of before there was this word
        for n, packed in enumerate(state["open"]):
            self._open[n] = None
            if packed is None:
                continue
            actions = [self._action(action) for action in unpack(packed, None, "the open episode")]
            self._episodes[n] -= 1
            self._begin([n])
            for action in actions:
                (out,) = self._asked("step", [n], [action])
                self._latest[n] = out.observation
            self._open[n] = actions
            if not same(self._latest[n], unpack(state["latest"][n], self._latest[n], "the last observation")):
                raise ValueError(
                    f"{self.called} cannot be gone on with in mid-episode: the same seed and the same actions led "
                    "elsewhere; begin the run anew (rerun=true)"
                )
