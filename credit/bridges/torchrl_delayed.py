"""Late labels for any agent of TorchRL: `credit.envs.DelayedReward` as a transform of environments."""

from __future__ import annotations

import copy
import math

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.data import Binary, Composite, TensorSpec, Unbounded
from torchrl.envs.transforms import Transform

from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.seams import Feedback
from credit.envs.labeller import Labeller


class DelayedReward(Transform):
    """The label of a window in place of its rewards: at its last step, and 0 before it.

    `label` (NaN where there is none), `window_end` and `censored`, whether a window ended without a label, lie beside
    the observation of every step, [..., 1]; after a reset they are NaN and false. Windows are as the feedback has them;
    an episode begins a new one. The primitive reward is nowhere behind this transform; what else the environment tells
    (an info reader's keys) is not touched. What truncates, like `StepCounter`, stands before this one in a `Compose`:
    the end of an episode that is set behind it closes no window, so that its steps never get their label.

    Args:
        feedback: what makes labels; it is copied.
        seed: of the feedback's random numbers; the n-th of a batch of environments has seed + n.
        longest: most steps of an episode, where windows are whole ones.
        label_key, end_key, censored_key: what is written.
        success: the key that says whether a step is a success, for a feedback that reads it; `auto` looks for
            `success`, `is_success`; `reward`: a step with a positive reward is one. A `GymEnv` tells what Gymnasium's
            `info` has only after `env.auto_register_info_dict()`.

    Raises:
        UserError: two keys are the same; labels that come late, which an agent's step cannot wait for; a
            `success` that the feedback does not read.

    Example:
        >>> env = TransformedEnv(GymEnv("Pendulum-v1"), DelayedReward(BlockSum(window=20, noise=0.0)))
        >>> env.rollout(40)["next", "label"]  # in every 20th step
    """

    def __init__(
        self,
        feedback: Feedback,
        seed: int = 0,
        longest: int | None = None,
        label_key: str = "label",
        end_key: str = "window_end",
        censored_key: str = "censored",
        success: str = "auto",
    ) -> None:
        self._own = (label_key, end_key, censored_key)
        if len({*self._own, "reward"}) < len(self._own) + 1:
            raise UserError(f"label_key, end_key, censored_key are {list(self._own)}: give three names, none 'reward'")
        super().__init__(in_keys=["reward"], out_keys=["reward", *self._own])
        self._feedback, self._seed, self._success = feedback, seed, success
        self._window = feedback.window or longest
        self._made(0)  # what does not fit is said here
        self._labellers: list[Labeller] = []

    def _made(self, number: int) -> Labeller:
        whole = self._feedback.window is None
        problem = Problem.vectors(1, 1, self._window or 1, (self._seed + number,))
        problem = Problem(
            problem.observation_space, problem.action_space, problem.window, problem.seeds, problem.device, whole
        )
        return Labeller(copy.deepcopy(self._feedback), problem, self._success)

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        """New windows where episodes begin; those that were open have no label."""
        shape = (*tensordict_reset.batch_size, 1)
        count = math.prod(shape)
        if len(self._labellers) != count:
            self._labellers = [self._made(number) for number in range(count)]
        mask = None if tensordict is None else tensordict.get("_reset", None)
        begun = [True] * count if mask is None else mask.reshape(-1).tolist()
        for labeller, new in zip(self._labellers, begun, strict=True):
            if new:
                labeller.begin()
        label, never = torch.full(shape, torch.nan), torch.zeros(shape, dtype=torch.bool)
        return self._written(tensordict_reset, label, never, never)

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        """The label where a window ends, and 0 elsewhere, in place of the reward.

        Raises:
            RunError: a reward is not finite. UserError: a success is read, and nothing ever told one.
        """
        reward, over = next_tensordict.get("reward"), next_tensordict.get("done")
        told = {key: self._column(next_tensordict, key) for key in self._labellers[0].keys if key in next_tensordict}
        seen = [
            labeller.step(one, {key: column[n] for key, column in told.items()}, end)
            for n, (labeller, one, end) in enumerate(
                zip(self._labellers, reward.reshape(-1).tolist(), over.reshape(-1).tolist(), strict=True)
            )
        ]
        ended = torch.tensor([end for end, _ in seen]).view(reward.shape)
        label = torch.tensor([torch.nan if y is None else y for _, y in seen]).view(reward.shape)
        next_tensordict.set("reward", label.nan_to_num(0.0).to(reward))
        return self._written(next_tensordict, label, ended, ended & label.isnan())

    def _column(self, told: TensorDictBase, key: str) -> list[float]:
        """A fact of each environment."""
        found: list[float] = told.get(key).reshape(-1).double().tolist()
        return found

    def _written(self, told: TensorDictBase, *values: Tensor) -> TensorDictBase:
        for name, value in zip(self._own, values, strict=True):
            told.set(name, value.to(told.device) if told.device is not None else value)
        return told

    def transform_observation_spec(self, observation_spec: TensorSpec) -> TensorSpec:
        """What is seen, and our three keys.

        Raises:
            UserError: the environment has one of them already.
        """
        assert isinstance(observation_spec, Composite)
        if taken := sorted({*self._own} & {*map(str, observation_spec.keys())}):
            raise UserError(f"the environment tells {taken} itself: give DelayedReward other keys (label_key=…)")
        shape, device = (*observation_spec.shape, 1), observation_spec.device
        label, end, censored = self._own
        observation_spec[label] = Unbounded(shape, dtype=torch.float32, device=device)
        for name in (end, censored):
            observation_spec[name] = Binary(shape=shape, dtype=torch.bool, device=device)
        return observation_spec
