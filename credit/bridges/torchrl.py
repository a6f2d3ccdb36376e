"""Credit assignment for TorchRL: windows out of what was collected, and recovered rewards in what is sampled."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import torch
from tensordict import NestedKey, TensorDictBase
from torch import Tensor
from torchrl.envs.transforms import Transform

from credit.bridges.predicted import predicted, why_not
from credit.core.capabilities import require
from credit.core.checks import BOUND
from credit.core.errors import RunError, UserError
from credit.core.problem import FLOAT, Problem
from credit.core.seams import CreditAssigner
from credit.core.steps import Steps
from credit.core.windows import Windows

Told = Callable[[TensorDictBase], Steps]  # a batch [n] → its steps [n], as the problem has them


class Relabel(Transform):
    """Gives sampled steps the reward that an assigner recovers for their own states and actions.

    It is predicted from the batch itself: the buffer keeps what was collected, nothing in it needs a number, and a new
    fit is seen by the next batch. For replay buffers, not for environments.

    Args:
        assigner: with reward models and without a scaler, like `Recovery(reference)`; fitted before the first batch.
        problem: in whose spaces steps lie.
        steps: how a batch [n] is read, where it has other keys or spaces; see `steps_of`.
        reward_key: of the reward that is replaced; its shape and type stay.

    Raises:
        UserError: the assigner predicts nothing, or does not fit the problem.

    Example:
        >>> recovery = Recovery(reference).fit(windows_of(rollout, problem, length=20), problem)
        >>> buffer = TensorDictReplayBuffer(storage=LazyTensorStorage(10_000), batch_size=64)
        >>> buffer.append_transform(Relabel(recovery, problem))
        >>> buffer.sample()["next", "reward"]
    """

    invertible = False

    def __init__(
        self,
        assigner: CreditAssigner,
        problem: Problem,
        steps: Told | None = None,
        reward_key: NestedKey = ("next", "reward"),
    ) -> None:
        if (reason := why_not(assigner)) is not None:
            raise UserError(reason)
        require({"assigner": assigner}, problem)
        super().__init__(in_keys=[], out_keys=[])
        self.assigner, self.problem, self.reward_key = assigner, problem, reward_key
        self._read: Told = steps or partial(steps_of, problem=problem)

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """The batch with other rewards; its other tensors are the same."""
        batch = tensordict.clone(recurse=False)  # so that what is stored stays as it is
        reward = batch.get(self.reward_key)
        found = predicted(self.assigner, self._read(batch.reshape(-1)))
        return batch.set(self.reward_key, found.reshape(reward.shape).to(reward))

    def _call(self, next_tensordict: TensorDictBase) -> TensorDictBase:
        raise RunError("Relabel works in replay buffers, where a batch has states, actions and rewards; not in an env")


def steps_of(batch: TensorDictBase, problem: Problem) -> Steps:
    """Steps [n] of a batch [n] with TorchRL's keys: observation, action, (next, observation).

    Where the problem has numbers, one-hot vectors become numbers.

    Raises:
        UserError: an action lies outside of [−1, 1].
    """
    states, then = (_as(batch.get(key), problem.finite_states) for key in ("observation", ("next", "observation")))
    actions = _as(batch.get("action"), problem.finite_actions)
    if not problem.finite_actions and (largest := float(actions.abs().max())) > BOUND:
        raise UserError(
            f"an action has the number {largest:.3g}, and here they lie in [-1, 1]: collect behind "
            "torchrl.envs.ActionScaling, or give steps=<function> that scales them"
        )
    return Steps(states.to(problem.device), actions.to(problem.device), then.to(problem.device))


def _as(values: Tensor, finite: bool) -> Tensor:
    """Numbers [n] of one-hot vectors [n, S] or of numbers [n], [n, 1]; or vectors [n, O] float32."""
    if not finite:
        return values.reshape(len(values), -1).float()
    if values.dim() > 1 and values.shape[-1] > 1:
        return values.long().argmax(-1)
    return values.reshape(len(values)).long()


def windows_of(
    rollout: TensorDictBase, problem: Problem, length: int | None = None, steps: Told | None = None
) -> Windows:
    """Windows of T steps, or whole episodes, of what one environment did in n steps; each label is a sum of rewards.

    An episode's end cuts a window short; steps behind the last window that is over are left out.

    Args:
        rollout: [n] in the order of time, with ("next", "reward"), "done" and "terminated".
        problem: of one seed. length: T; None for whole episodes. steps: how a batch is read; see `Relabel`.

    Raises:
        UserError: no window is over.
    """
    done, terminated = (rollout.get(("next", name)).reshape(-1).cpu() for name in ("done", "terminated"))
    ends, clock, first, begun = list[int](), list[int](), 0, 0
    for row, over in enumerate(done.tolist()):
        clock.append(row - begun)
        if over or row + 1 - first == length:
            ends.append(row)
            first = row + 1
        if over:
            begun = row + 1
    if not ends:
        raise UserError(
            f"of these {len(done)} steps no window of {length or 'a whole episode'} is over: collect more, or take a "
            "shorter length"
        )
    last, count = torch.tensor(ends), ends[-1] + 1
    part = rollout[:count]
    found = steps(part) if steps is not None else steps_of(part, problem)
    reward = part.get(("next", "reward")).reshape(-1).to(FLOAT).cpu()
    number = torch.searchsorted(last, torch.arange(count))
    labels = torch.zeros(len(last), dtype=FLOAT).index_add_(0, number, reward)
    windows = Windows(
        found.states[None],
        found.actions[None],
        found.next_states[None],
        torch.tensor([clock[:count]]),
        labels=labels[None],
        last=last[None],
        ended=done[None, :count],
        terminated=terminated[None, :count],
    )
    return windows.to(problem.device)
