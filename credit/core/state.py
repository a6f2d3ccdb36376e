"""What changes while a run goes on, as plain data, so that the run can be stopped and gone on with to the bit.

`start(problem)` makes an object as it is at the beginning of a run; `load_state_dict` then makes it what it was when
`state_dict` was called. Light to import: no torch.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

PLAIN = (bool, int, float, str)
LEFT = ["left", None]  # in the place of what is left out
Packed = Any  # None, bool, int, float, str, tensors, and [tag, content] for everything that holds others


class Stateful:
    """Something with a state: by default, whatever `start` put on it.

    Attributes:
        keeps: names of the attributes that are the state, where that is less than all: caches and constants need not be
            kept. An attribute may be a number, a string, a tensor, an array, a NumPy generator, a PyTorch module or
            optimizer, another `Stateful`, or a list, tuple or dictionary of these.
        acts: names of those that policies look at, where that is less than all: what is kept of a finished run.

    Example:
        >>> class Counts(Stateful):
        ...     keeps = ("_counts",)
    """

    keeps: ClassVar[tuple[str, ...] | None] = None
    acts: ClassVar[tuple[str, ...] | None] = None

    def state_dict(self) -> dict[str, Packed]:
        """The state: tensors on the CPU and plain data.

        Raises:
            TypeError: an attribute is of another kind; name those that matter in `keeps`, or override both methods.
        """
        return self._packed(self._names())

    def acting(self) -> dict[str, Packed]:
        """The part of the state that policies look at: without optimizers, random numbers, and what `acts` leaves out.

        Laid over the state that `start` makes (`credit.core.acting.laid_over`), it acts as this one does.
        """
        if self.acts is None and type(self).state_dict is not Stateful.state_dict:  # whose parts have names of its own
            return self.state_dict()
        return self._packed(self._looked_at(), lean=True)

    def load_state_dict(self, state: Mapping[str, Packed]) -> None:
        """Go on from a state, after the same `start`.

        Raises:
            ValueError: it is the state of something else.
        """
        expected = set(self._names())
        if expected != set(state):
            raise ValueError(f"{type(self).__name__} has the state {sorted(expected)}, not {sorted(state)}")
        for name, packed in state.items():
            setattr(self, name, unpack(packed, getattr(self, name), f"{type(self).__name__}.{name}"))

    def filled(self) -> Mapping[str, int]:
        """How many columns of an attribute [R, columns, ...] are the state, where it has room for more; it loses that
        when it is loaded."""
        return {}

    def _packed(self, names: Sequence[str], lean: bool = False) -> dict[str, Packed]:
        filled = self.filled()
        values = {name: getattr(self, name) for name in names}
        kept = {name: value[:, : filled[name]] if name in filled else value for name, value in values.items()}
        return {name: pack(value, f"{type(self).__name__}.{name}", lean) for name, value in kept.items()}

    def _looked_at(self) -> tuple[str, ...]:
        return self._names() if self.acts is None else self.acts

    def _names(self) -> tuple[str, ...]:
        if self.keeps is not None:
            return self.keeps
        given = inspect.signature(type(self)).parameters
        return tuple(
            name for name, value in vars(self).items() if not _constant(value) and (name not in given or _holds(value))
        )


def pack(value: Any, where: str, lean: bool = False) -> Packed:
    """A value as plain data.

    Args:
        value: what is packed. where: it is, for messages. lean: whether what no policy looks at is left out, so that
            `start` makes it anew: optimizers, random numbers, and what `acting` leaves out.

    Raises:
        TypeError: it cannot be, or `where` it is needs methods of its own.
    """
    import numpy as np
    import torch

    if isinstance(value, np.generic):
        value = value.item()
    if value is None or type(value) in PLAIN:
        return value
    if isinstance(value, torch.Tensor):
        return value.detach().cpu().clone()  # a view would be saved with all that it is a view of
    if isinstance(value, np.ndarray):
        return ["array", torch.from_numpy(value.copy())]
    if isinstance(value, np.random.Generator):
        return LEFT if lean else ["generator", pack(value.bit_generator.state, where)]
    if isinstance(value, (Stateful, torch.nn.Module)):
        return ["state", value.acting() if lean and isinstance(value, Stateful) else value.state_dict()]
    if isinstance(value, torch.optim.Optimizer):
        return LEFT if lean else ["optimizer", pack(value.state_dict(), where)]
    if isinstance(value, Mapping):
        return ["dict", [[pack(key, where), pack(inner, f"{where}[{key!r}]", lean)] for key, inner in value.items()]]
    if type(value) in (list, tuple):
        return [type(value).__name__, [pack(inner, f"{where}[{i}]", lean) for i, inner in enumerate(value)]]
    raise TypeError(
        f"{where} is a {type(value).__name__}, which no checkpoint can hold: name the attributes that are the state in "
        "`keeps`, or give the class a state_dict and a load_state_dict"
    )


def unpack(packed: Packed, now: Any, where: str) -> Any:
    """A value from plain data; tensors and what has a state change in place where they can, and else are new.

    Args:
        now: the value that it replaces, as `start` made it.

    Raises:
        ValueError: there must be something in place that is not there.
    """
    import numpy as np
    import torch

    if isinstance(packed, torch.Tensor):
        return _written(now, packed)
    if not isinstance(packed, list):
        return packed
    tag, content = packed
    if tag in ("list", "tuple"):
        there = now if type(now) in (list, tuple) and len(now) == len(content) else [None] * len(content)
        values = [unpack(*each, f"{where}[{i}]") for i, each in enumerate(zip(content, there, strict=True))]
        return values if tag == "list" else tuple(values)
    if tag == "dict":
        pairs = [(unpack(key, None, where), inner) for key, inner in content]
        held = now if isinstance(now, Mapping) else {}
        return {key: unpack(inner, held.get(key), f"{where}[{key!r}]") for key, inner in pairs}
    if tag == "array":
        return content.numpy()
    if tag == "generator" and isinstance(now, np.random.Generator):
        now.bit_generator.state = unpack(content, None, where)
    elif tag == "state" and isinstance(now, (Stateful, torch.nn.Module)):
        now.load_state_dict(content)
    elif tag == "optimizer" and isinstance(now, torch.optim.Optimizer):
        now.load_state_dict(unpack(content, None, where))
    else:
        raise ValueError(f"{where}: the checkpoint has a {tag} where the run has {type(now).__name__}")
    return now


def same(one: Any, two: Any) -> bool:
    """Whether two values of a state, or arrays, are equal to the bit, NaN to NaN."""
    import numpy as np
    import torch

    if isinstance(one, Mapping):
        return isinstance(two, Mapping) and one.keys() == two.keys() and all(same(one[key], two[key]) for key in one)
    if isinstance(one, (list, tuple)):
        return len(one) == len(two) and all(map(same, one, two))
    if isinstance(one, (torch.Tensor, np.ndarray)):
        one, two = np.asarray(one), np.asarray(two)
        return one.dtype == two.dtype and np.array_equal(one, two, equal_nan=one.dtype.kind == "f")
    return bool(one == two)


def _written(now: Any, tensor: Any) -> Any:
    """The tensor where `now` is, if it has room for it: others may look at the same memory."""
    import torch

    if not isinstance(now, torch.Tensor):
        return tensor
    if now.shape != tensor.shape or now.dtype != tensor.dtype or _repeats(now):
        return tensor.to(now.device)
    with torch.no_grad():
        return now.copy_(tensor)


def _repeats(tensor: Any) -> bool:
    """Whether several elements are one number in memory."""
    return any(stride == 0 and size > 1 for stride, size in zip(tensor.stride(), tensor.shape, strict=True))


def _constant(value: Any) -> bool:
    import torch

    from credit.core.problem import Replicas

    return isinstance(value, (Replicas, torch.device))


def _holds(value: Any) -> bool:
    """Whether a constructor's argument has a state of its own."""
    parts = value.values() if isinstance(value, Mapping) else value if isinstance(value, (list, tuple)) else (value,)
    return any(isinstance(part, Stateful) for part in parts)
