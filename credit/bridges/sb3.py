"""Credit assignment for Stable-Baselines3: a callback that writes recovered rewards into the agent's replay buffer."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from credit.bridges.predicted import predicted, unlabelled, why_not
from credit.bridges.rows import Closed, Row, both, chosen, rows_of, steps_of, windows_of
from credit.core.capabilities import parts_of, require
from credit.core.errors import RunError, UserError
from credit.core.problem import Problem
from credit.core.seams import CreditAssigner
from credit.core.steps import Steps
from credit.core.store import Store
from credit.envs import spaces

try:
    from stable_baselines3.common.buffers import ReplayBuffer
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.her.her_replay_buffer import HerReplayBuffer
except ModuleNotFoundError as error:
    raise UserError(f"no {error.name}: pip install 'credit-rl[sb3]' for Stable-Baselines3's agents") from None


class Relabel(BaseCallback):
    """Fits an assigner to labels of windows, every so many steps, and gives every row of the buffer its reward.

    In the buffer a reward is the assigner's once its window is labelled and fitted, and is written again after every
    fit. Until then, and where a window is still open, it is what the assigner predicts for its step (`Recovery` without
    a scaler), or what its rule gives steps without a label (the mean of an even spread, 0 before a delayed label): a 0
    there would teach the agent that its newest steps are worth nothing. Before the first fit all are 0; let learning
    start after it (`learning_starts`, `every`). Where the environment is wrapped in `credit.envs.DelayedReward`,
    windows and labels are what that tells, and rows of windows without a label get what the assigner predicts for them,
    or 0 where it predicts nothing. Elsewhere a label is the sum of the environment's rewards over a window; it is the
    last that is seen of them.

    Args:
        assigner: not started; `Recovery`, or a rule.
        window: T, steps of a window; an episode's end cuts one short. None: whole episodes, or what the wrapper tells.
        every: environment steps between two fits.
        longest: most steps of an episode, where those are windows and the environment tells no time limit.
        view: whether observations are seen as a number or as a vector; `auto`: a number where there are few.
        seed: of the assigner's random numbers.

    Attributes:
        store: all labelled windows so far; those that the buffer has lost, too.
        problem: what the assigner knows.

    Raises:
        UserError: when learning starts: an agent without a replay buffer, or what does not fit.

    Example:
        >>> model.learn(20_000, callback=Relabel(Recovery(reference), window=20, every=1_000))
    """

    def __init__(
        self,
        assigner: CreditAssigner,
        window: int | None = None,
        every: int = 1_000,
        longest: int | None = None,
        view: spaces.View = "auto",
        seed: int = 0,
    ) -> None:
        for name, value in (("window", window), ("every", every), ("longest", longest)):
            if value is not None and value < 1:
                raise UserError(f"Relabel({name}={value}): it is a number of steps, at least 1")
        super().__init__()
        self.assigner, self.window, self.every, self.longest = assigner, window, every, longest
        self.view, self.seed = view, seed
        self._buffer: Any = None

    def _on_training_start(self) -> None:
        """Begin anew with another buffer; with the same one, go on."""
        buffer = getattr(self.model, "replay_buffer", None)
        if not isinstance(buffer, ReplayBuffer) or isinstance(buffer, HerReplayBuffer):
            raise UserError(
                f"{type(self.model).__name__} has {type(buffer).__name__} for a replay buffer, and rewards can be "
                "written only where they are kept and read: use SAC, TD3, DDPG or DQN with a ReplayBuffer (hindsight "
                "computes rewards anew, and PPO and A2C keep none)"
            )
        normalize = self.model.get_vec_normalize_env()
        if normalize is not None and normalize.norm_reward:
            raise UserError("VecNormalize scales by the true rewards; give it norm_reward=False")
        if buffer is not self._buffer:
            self._begin(buffer)
        elif self.locals.get("reset_num_timesteps", True):  # the environments were reset
            for copy in range(buffer.n_envs):
                self._interrupt(copy, midway=False)

    def _begin(self, buffer: Any) -> None:
        self._buffer, copies = buffer, buffer.n_envs
        self.problem = self._problem()
        self.store = Store(self.problem)
        self.assigner.start(self.problem)
        self._first, self._added, self._since = buffer.pos, 0, 0  # where the first row goes; rows of each copy
        self._expected: int | None = None  # where the row goes that was announced and not yet seen
        self._infos: list[dict[str, Any]] = []
        self._open: list[list[Row]] = [[] for _ in range(copies)]  # windows
        self._sum, self._step = np.zeros(copies), np.zeros(copies, dtype=np.int64)
        self._midway = np.zeros(copies, dtype=bool)  # whether the first rows of a window were not seen
        self._closed: list[Closed] = []
        self._places = np.zeros(0, dtype=np.int64)  # of the store's rows
        self._fresh: list[Row] = []  # rows that came since the agent last learned
        self._lost: list[Row] = []  # rows that never get a label, since the last fit
        self._apart: Steps | None = None  # those before
        self._places_apart = self._places

    def _problem(self) -> Problem:
        """What the assigner may know; it must fit.

        Raises:
            UserError: it does not.
        """
        env = self.training_env
        self._told = env.has_attr("label_window")
        if self._told and self.window is not None:
            raise UserError(f"window={self.window}: DelayedReward tells where windows end; leave window out")
        if any(part.sees_primitive for _, part in parts_of(self.assigner)):
            raise UserError("this assigner is shown every true reward: so is the agent itself, without this callback")
        if self._told and why_not(self.assigner) and getattr(self.assigner, "scaler", None) is not None:
            raise UserError(f"windows of DelayedReward may have no label: {why_not(self.assigner)}")
        most = self.window or self.longest or self._limit()
        if most >= (size := self._buffer.buffer_size):
            raise UserError(
                f"a window has up to {most} steps, and the buffer holds {size} of each environment: it must hold more; "
                "give a larger buffer_size, or take shorter windows"
            )
        self._seen = spaces.observations(self._buffer.observation_space, self.view)
        done = spaces.actions(self._buffer.action_space)
        whole = self.window is None and not self._told
        problem = spaces.problem(self._seen, done, most, (self.seed,), episodic=whole)
        require({"assigner": self.assigner}, problem)
        return problem

    def _limit(self) -> int:
        """Most steps of a window, as the environments tell it.

        Raises:
            UserError: they do not.
        """
        if self._told:
            found = self.training_env.get_attr("label_window")
        else:
            found = [spec and spec.max_episode_steps for spec in self.training_env.get_attr("spec")]
        if None in found:
            raise UserError("windows are episodes, and there is no time limit: give longest=<most steps of an episode>")
        return int(max(found))

    def _on_step(self) -> bool:
        """Look at the row that was added since the last call; the next one is added behind this."""
        self._take()
        self._expected, self._infos = self._buffer.pos, self.locals["infos"]
        return True

    def _on_rollout_end(self) -> None:
        """Before the agent learns: no reward stays that is not the assigner's."""
        self._take()
        if self._since >= self.every:
            self._since = 0
            self._fresh = [] if self._fit() else self._fresh
        self._write_unlabelled(self._fresh)
        self._fresh = []

    def _take(self) -> None:
        """Take in the row of all copies that was announced, if it was added.

        Raises:
            RunError: somebody else has added rows.
        """
        buffer, at, self._expected = self._buffer, self._expected, None
        if at is None:
            return
        if buffer.pos == at:  # another callback ended the training between step and buffer
            for copy in range(buffer.n_envs):
                self._interrupt(copy, midway=True)
            return
        if buffer.pos != (at + 1) % buffer.buffer_size:
            raise RunError(f"the replay buffer went on from row {at} to {buffer.pos}, and one row was collected")
        rewards, done = buffer.rewards[at].astype(np.float64), buffer.dones[at] > 0
        buffer.rewards[at] = 0
        states, next_states = self._observed(buffer, at), self._observed(buffer, at, following=True)
        actions = self._acted(buffer.actions[at])
        for copy, info in enumerate(self._infos):
            place = self._added * buffer.n_envs + copy
            row = Row(states[copy], actions[copy], next_states[copy], int(self._step[copy]), place)
            self._open[copy].append(row)
            self._fresh.append(row)
            self._sum[copy] += rewards[copy]
            self._step[copy] += 1
            self._close(copy, bool(done[copy]), info)
        self._added, self._since = self._added + 1, self._since + buffer.n_envs

    def _observed(self, buffer: Any, at: int, following: bool = False) -> Tensor:
        """What is seen of observations of all copies, or of those that followed."""
        column = buffer.observations
        if following and buffer.optimize_memory_usage:
            at = (at + 1) % buffer.buffer_size
        elif following:
            column = buffer.next_observations

        def shaped(space: Any, values: Any) -> Any:
            if isinstance(values, dict):
                return {name: shaped(space[name], own) for name, own in values.items()}
            return np.array(values[at]).reshape(buffer.n_envs, *space.shape)  # a copy: the buffer goes on

        return self._seen(shaped(buffer.observation_space, column)).clone()

    def _acted(self, actions: np.ndarray) -> Tensor:
        """Actions as the problem has them: numbers, or vectors that the agent has scaled to [−1, 1]."""
        found = torch.from_numpy(np.array(actions))
        return found[:, 0].long() if self.problem.finite_actions else found.float().clamp(-1, 1)

    def _close(self, copy: int, over: bool, info: dict[str, Any]) -> None:
        """End a copy's window, if it is over."""
        rows = self._open[copy]
        ends: bool = info["window_end"] if self._told else over or len(rows) == self.window
        label: float | None = info.get("label") if self._told else float(self._sum[copy])
        if ends and label is not None and not self._midway[copy]:
            terminated = over and not info.get("TimeLimit.truncated", False)
            self._closed.append(Closed(rows, label, over, terminated))
        elif ends:
            self._lost += rows
        if ends:
            self._open[copy], self._sum[copy], self._midway[copy] = [], 0.0, False
        if over:
            self._step[copy] = 0

    def _interrupt(self, copy: int, midway: bool) -> None:
        """A copy's open window never gets a label: its environment was reset, or a row of it was never kept."""
        self._lost += self._open[copy]
        self._open[copy], self._sum[copy], self._midway[copy] = [], 0.0, midway and self._told
        if not midway:
            self._step[copy] = 0

    def _fit(self) -> bool:
        """Fit the assigner to the windows that came, if any, and write all rewards that may have changed; if so."""
        if not self._closed:
            return False
        windows, new = windows_of(self._closed), _places(rows_of(self._closed))
        self._closed = []
        self.store.append(windows)
        self._places = np.concatenate([self._places, new])
        self.assigner.observe(self.store)
        every = self.assigner.learns
        self._write(self._places if every else new, self.assigner.rewards(self.store.windows if every else windows)[0])
        self._write_predicted()
        self._write_unlabelled([row for rows in self._open for row in rows])
        self.logger.record("credit/windows", len(self.store))
        self.logger.record("credit/label", float(windows.labels.mean()))
        return True

    def _write_predicted(self) -> None:
        """The rewards of rows that never get a label, where the assigner knows them."""
        if why_not(self.assigner) is not None:
            self._lost = []
            return
        if self._lost:
            self._apart = both(self._apart, steps_of(self._lost))
            self._places_apart = np.concatenate([self._places_apart, _places(self._lost)])
            self._lost = []
        if self._apart is not None:
            kept = torch.from_numpy(self._here(self._places_apart))
            self._apart, self._places_apart = chosen(self._apart, kept), self._places_apart[kept.numpy()]
            self._write(self._places_apart, predicted(self.assigner, self._apart))

    def _write_unlabelled(self, rows: list[Row]) -> None:
        """The rewards of rows whose windows have no label yet, once there was a fit."""
        if not (rows and len(self.store)):
            return
        if why_not(self.assigner) is None:
            rewards = predicted(self.assigner, steps_of(rows))
        else:
            rewards = torch.full((len(rows),), unlabelled(self.assigner, self.store))
        self._write(_places(rows), rewards)

    def _write(self, places: np.ndarray, rewards: Tensor) -> None:
        """Rewards [n] of rows, where the buffer still has them."""
        buffer, here = self._buffer, self._here(places)
        when, copy = np.divmod(places[here], buffer.n_envs)
        buffer.rewards[(self._first + when) % buffer.buffer_size, copy] = rewards.detach().cpu().numpy()[here]

    def _here(self, places: np.ndarray) -> np.ndarray:
        """Which rows [n] were not overwritten."""
        found: np.ndarray = places // self._buffer.n_envs >= self._added - self._buffer.buffer_size
        return found


def _places(rows: list[Row]) -> np.ndarray:
    return np.array([row.place for row in rows], dtype=np.int64)
