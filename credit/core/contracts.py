"""What every seam promises of its answers, held to where somebody's own part is tried before a run.

A part that breaks its promise would be noticed later, in another place and in other words, or never: a weight that
does not sum to one, an action out of range, a label that is not a number.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any

import torch
from torch import Tensor

from credit.core.belief import Belief, Estimate
from credit.core.errors import UserError
from credit.core.policy import Policy
from credit.core.problem import Problem
from credit.core.seams import (
    Agent,
    Bonus,
    CreditAssigner,
    Encoder,
    Environment,
    FeatureMap,
    Feedback,
    Mixer,
    RewardModel,
    Scaler,
    Transition,
    Transitions,
    TransitionTable,
)

Promise = Callable[[Any, Problem, tuple[Any, ...]], None]  # answer, problem, what was asked; raises Broken
SUM = 1e-6  # how far sums of shares may be from one


class Broken(UserError):
    """A part gave something else than its seam promises."""


def tensor(value: Any, what: str, shape: tuple[int | None, ...], where: Tensor | None = None) -> Tensor:
    """A finite tensor of some shape, None for any size.

    Args:
        value: what was given. what: what it is. shape: what it must have. where: which of it count, None for all.

    Raises:
        Broken: it is something else.
    """
    if not isinstance(value, Tensor):
        raise Broken(f"{what}: {_shown(value)}, and it must be a tensor {_list(shape)}")
    if value.dim() != len(shape) or any(w not in (None, size) for w, size in zip(shape, value.shape, strict=True)):
        raise Broken(f"{what} has the shape {list(value.shape)}, and it must be {_list(shape)}")
    finite = value.isfinite()
    if where is not None:
        finite = finite | ~where.view(*where.shape, *[1] * (value.dim() - where.dim()))
    if not finite.all():
        place = tuple((~finite).nonzero()[0].tolist())
        raise Broken(f"{what} is {float(value[place])} at {list(place)}, and it must be finite")
    return value


def watch(part: Any, problem: Problem, path: str) -> None:
    """Hold a part to its promises: a method that breaks one raises `Broken`, with the part's path and class.

    Args:
        part: a component, or a policy. problem: whose sizes count. path: what messages call the part.
    """
    cls = type(part)
    watched = {
        name: _held(getattr(cls, name), promise, problem, f"{path}: {cls.__name__}.{name}")
        for seam, promises in PROMISES.items()
        if isinstance(part, seam)
        for name, promise in promises.items()
    }
    part.__class__ = type(cls.__name__, (cls,), {**watched, "__module__": cls.__module__})


def _held(method: Callable[..., Any], promise: Promise, problem: Problem, name: str) -> Callable[..., Any]:
    @wraps(method)
    def called(self: Any, *args: Any, **kwargs: Any) -> Any:
        answer = method(self, *args, **kwargs)
        try:
            promise(answer, problem, (*args, *kwargs.values()))
        except Broken as error:
            raise Broken(f"{name}: {error}") from None
        return answer

    return called


def _states(value: Any, problem: Problem, what: str, where: Tensor | None = None) -> None:
    shape = () if problem.finite_states else (problem.observations,)
    found = tensor(value, what, (problem.replicas, None, *shape), where)
    if problem.finite_states:
        _numbers(found, what, problem.states, where)


def _actions(value: Any, problem: Problem, what: str) -> None:
    if problem.finite_actions:
        _numbers(tensor(value, what, (problem.replicas, None)), what, problem.actions)
        return
    found = tensor(value, what, (problem.replicas, None, problem.actions))
    if (most := float(found.abs().max())) > 1:
        raise Broken(f"{what} reach {most:g}, and vectors of actions lie in [-1, 1]")


def _numbers(found: Tensor, what: str, size: int, where: Tensor | None = None) -> None:
    if found.dtype != torch.int64:
        raise Broken(f"{what} are {found.dtype}, and they must be torch.int64")
    kept = found if where is None else found[where]
    wrong = kept[(kept < 0) | (kept >= size)]
    if wrong.numel():
        raise Broken(f"{what} hold {int(wrong[0])}, and they must be whole numbers from 0 to {size - 1}")


def _mask(asked: tuple[Any, ...], place: int) -> Tensor | None:
    return next((value for value in asked[place:] if isinstance(value, Tensor) and value.dtype == torch.bool), None)


def _reset(answer: Any, problem: Problem, asked: tuple[Any, ...]) -> None:
    _states(answer, problem, "the states")


def _step(answer: Any, problem: Problem, asked: tuple[Any, ...]) -> None:
    if not isinstance(answer, Transitions):
        raise Broken(f"{_shown(answer)}, and it must be Transitions(states, rewards, terminated, truncated, facts)")
    mask = _mask(asked, 1)
    _states(answer.states, problem, "the next states", mask)
    copies = answer.states.shape[:2]
    tensor(answer.rewards, "the rewards", copies, mask)
    for name in ("terminated", "truncated"):
        if (ended := getattr(answer, name)) is not None and tensor(ended, name, copies).dtype != torch.bool:
            raise Broken(f"{name} are {ended.dtype}, and they must be torch.bool, or None where nothing ends")
    if not isinstance(answer.facts, Mapping):
        raise Broken(f"facts: {_shown(answer.facts)}, and they must be a mapping from names to tensors [R, K, ...]")
    for name, value in answer.facts.items():
        if not isinstance(value, Tensor) or value.shape[:2] != copies:
            raise Broken(f"the fact {name!r}: {_shown(value)}, and it must be a tensor {_list((*copies, '...'))}")


def _labels(answer: Any, problem: Problem, asked: tuple[Any, ...]) -> None:
    tensor(answer, "the labels", tuple(asked[0].shape[:2]))


def _features(answer: Any, problem: Problem, asked: tuple[Any, ...]) -> None:
    states = asked[0].states
    leading = tuple(states.shape if problem.finite_states else states.shape[:-1])
    tensor(answer, "what steps look like", (*leading, None))


def _encoded(answer: Any, problem: Problem, asked: tuple[Any, ...]) -> None:
    tensor(answer, "what networks see", (problem.replicas, asked[0].shape[-2], problem.observations))


def _estimate(answer: Any, problem: Problem, asked: tuple[Any, ...]) -> None:
    if not isinstance(answer, Estimate):
        raise Broken(f"{_shown(answer)}, and it must be an Estimate(mean, variance, draws)")
    mean = tensor(answer.mean, "the mean", (problem.replicas, None))
    if not isinstance(answer.variance, Tensor) or answer.variance.shape != mean.shape:
        raise Broken(f"the variance: {_shown(answer.variance)}, and it must have the mean's shape {list(mean.shape)}")
    if not (answer.variance >= 0).all():  # it may be infinite where nothing is known
        raise Broken("the variance is negative or no number somewhere, and it must be 0 or more")
    if answer.draws is not None:
        tensor(answer.draws, "the draws", (problem.replicas, None, None))


def _weights(answer: Any, problem: Problem, asked: tuple[Any, ...]) -> None:
    sums = tensor(answer, "the weights", tuple(asked[0].shape)).sum(-2)
    if ((sums - 1).abs() > SUM).any():
        wrong = float(sums[(sums - 1).abs() > SUM][0])
        raise Broken(f"the weights of the models sum to {wrong:g} somewhere, and they must sum to 1")


def _optimism(answer: Any, problem: Problem, asked: tuple[Any, ...]) -> None:
    belief: Belief = asked[0]
    tensor(answer, "the bonus", tuple(belief.mixed.shape), belief.valid)


def _scaled(answer: Any, problem: Problem, asked: tuple[Any, ...]) -> None:
    if not (isinstance(answer, tuple) and len(answer) == 2):
        raise Broken(f"{_shown(answer)}, and it must be two tensors: the scaled rewards, and their unit")
    tensor(answer[0], "the scaled rewards", tuple(asked[0].shape))
    if not (tensor(torch.as_tensor(answer[1]), "the unit", ()) > 0):
        raise Broken(f"the unit is {float(answer[1])}, and it must be positive")


def _rewards(answer: Any, problem: Problem, asked: tuple[Any, ...]) -> None:
    tensor(answer, "the pseudo-rewards", (problem.replicas, len(asked[0])))


def _act(answer: Any, problem: Problem, asked: tuple[Any, ...]) -> None:
    _actions(answer, problem, "the actions")


def _policies(answer: Any, problem: Problem, asked: tuple[Any, ...]) -> None:
    if not isinstance(answer, Mapping) or not isinstance(answer.get("behaviour"), Policy):
        raise Broken(f"{_shown(answer)}, and it must map names to policies, one of them 'behaviour'")


def _probabilities(answer: Any, problem: Problem, asked: tuple[Any, ...]) -> None:
    if answer is None:
        return
    found = tensor(answer, "the probabilities", (problem.replicas, None, problem.actions))
    if (found < 0).any() or ((found.sum(-1) - 1).abs() > SUM).any():
        raise Broken("the probabilities of some state are negative or do not sum to 1")


def _backup(answer: Any, problem: Problem, asked: tuple[Any, ...]) -> None:
    tensor(answer, "the expected values", (problem.replicas, problem.states, problem.actions))


def _table(answer: Any, problem: Problem, asked: tuple[Any, ...]) -> None:
    states, actions = problem.states, problem.actions
    sums = tensor(answer, "P̂", (problem.replicas, states, actions, states)).sum(-1)
    if (answer < 0).any() or ((sums - 1).abs().gt(SUM) & sums.ne(0)).any():
        raise Broken("P̂ of some (s, a) is negative or sums neither to 1 nor, where nothing is known, to 0")


def _shown(value: Any) -> str:
    if isinstance(value, Tensor):
        return f"a tensor {list(value.shape)} was given"
    return "None was given" if value is None else f"a {type(value).__name__} was given"


def _list(shape: tuple[Any, ...]) -> str:
    return f"[{', '.join('any' if size is None else str(size) for size in shape)}]"


PROMISES: dict[type, dict[str, Promise]] = {
    Environment: {"reset": _reset, "step": _step},
    Feedback: {"__call__": _labels},
    FeatureMap: {"__call__": _features},
    Encoder: {"__call__": _encoded},
    RewardModel: {"estimate": _estimate},
    Mixer: {"weights": _weights},
    Bonus: {"__call__": _optimism},
    Scaler: {"__call__": _scaled},
    CreditAssigner: {"rewards": _rewards},
    Agent: {"act": _act, "policies": _policies},
    Policy: {"act": _act, "probabilities": _probabilities},
    Transition: {"backup": _backup},
    TransitionTable: {"probabilities": _table},
}
