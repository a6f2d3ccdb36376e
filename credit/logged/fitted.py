"""Models that were fitted, apart from the rows that they were fitted to: what scoring needs, and how it is saved.

A model of another kind than `Linear` is a `Part`, too, and has a line in `KINDS`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from credit.core.errors import UserError
from credit.logged.formulas.terms import Terms
from credit.logged.models import Model
from credit.logged.panel import Floats, Ints

if TYPE_CHECKING:
    from credit.core.seams import Mixer
    from credit.logged.fits.linear import LinearFit
    from credit.logged.fits.predicting import RegisteredFit
    from credit.logged.registered import Registered
    from credit.logged.tables.known import Known

Arrays = Mapping[str, np.ndarray]


class Part(Protocol):
    """A model and its fits: which columns of its design are used, and what `mixed` makes credit of these by."""

    @property
    def model(self) -> Model | Registered: ...  # noqa: D102
    @property
    def columns(self) -> Ints: ...  # noqa: D102
    @property
    def theta(self) -> Any: ...  # noqa: D102
    @property
    def chosen(self) -> Mapping[str, str]: ...  # noqa: D102

    def saved(self) -> tuple[dict[str, Any], Arrays]:
        """What JSON knows, with its `kind`, and arrays of numbers."""

    @classmethod
    def read(cls, plain: Mapping[str, Any], arrays: Arrays, known: Known) -> Part:
        """What was saved of a table whose columns are `known`; any error where it was not."""


@dataclass(frozen=True)
class Linear:
    """A linear model, and all of its fits.

    Attributes:
        model: formula and how it was fitted. columns: of the design, those that are in some fit [d].
        theta: the point fit first [1 + B, d]. penalty: λ of each [1 + B]. chosen: free term → what folds chose for it.
    """

    model: Model
    columns: Ints
    theta: Floats
    penalty: Floats
    chosen: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, model: Model, fit: LinearFit) -> Linear:
        """Of a fit, the columns that are used."""
        columns = fit.used(model.terms)
        chosen = {free.text: free.candidates[fit.chosen[0][at]] for at, free in enumerate(model.terms.choices)}
        return cls(model, columns, fit.theta[:, columns], fit.penalty, chosen)

    def saved(self) -> tuple[dict[str, Any], Arrays]:
        """Plain values and arrays."""
        plain = {
            "kind": "linear",
            "name": self.model.name,
            "terms": self.model.terms.to_dict(),
            "regularization": self.model.regularization,
            "signs": dict(self.model.signs),
            "chosen": dict(self.chosen),
        }
        return plain, {"columns": self.columns, "theta": self.theta, "penalty": self.penalty}

    @classmethod
    def read(cls, plain: Mapping[str, Any], arrays: Arrays, known: Known) -> Linear:
        """What was saved.

        Raises:
            KeyError, TypeError, ValueError: it is no such thing; a UserError for a formula that is none.
        """
        terms = Terms.from_dict(plain["terms"])
        model = Model(plain["name"], terms, plain["regularization"], dict(plain["signs"]))
        columns, theta, penalty = arrays["columns"], arrays["theta"], arrays["penalty"]
        if theta.shape != (len(penalty), len(columns)) or not np.isfinite(theta).all():
            raise ValueError(f"theta of {model.name} is {theta.shape}, for {len(columns)} columns")
        inside = len(columns) == 0 or (columns[0] >= 0 and columns[-1] < len(terms.names))
        if columns.dtype.kind != "i" or not inside or (np.diff(columns) <= 0).any():
            raise ValueError(f"columns of {model.name} are not those of its formula")
        return cls(model, columns.astype(np.int64), theta.astype(np.float64), penalty, dict(plain["chosen"]))


@dataclass(frozen=True)
class Alive:
    """A registered model that was fitted.

    Attributes:
        model: with how rows are steps. theta: predicts all fits.
    """

    model: Registered
    theta: RegisteredFit
    chosen: Mapping[str, str] = field(default_factory=dict)

    @property
    def columns(self) -> Ints:
        """All of its design."""
        return np.arange(len(self.model.terms.names))

    def saved(self) -> tuple[dict[str, Any], Arrays]:
        """Plain values and arrays.

        Raises:
            UserError: it could not be made again, or its state is none that can be saved.
        """
        from credit.logged.nodes import described

        spaces, chosen = self.model.terms.spaces, self.model.chosen
        try:
            fit, arrays = self.theta.saved()
        except TypeError as error:  # of a state that no checkpoint can hold, either
            raise UserError(str(error)) from None
        plain = {
            "kind": "registered",
            "name": self.model.name,
            "node": described(chosen.model, chosen.node),
            "own": chosen.own,
            "spaces": {"sizes": spaces.sizes, "window": spaces.window, "even": spaces.even},
            "fit": fit,
        }
        return plain, arrays

    @classmethod
    def read(cls, plain: Mapping[str, Any], arrays: Arrays, known: Known) -> Alive:
        """What was saved.

        Raises:
            KeyError, TypeError, ValueError: it is no such thing; a UserError for what is not registered.
        """
        from credit.core.seams import RewardModel
        from credit.logged.fits.predicting import RegisteredFit
        from credit.logged.nodes import made
        from credit.logged.registered import Chosen, Registered, StepTerms
        from credit.logged.steps import Spaces

        name, said, node = str(plain["name"]), plain["spaces"], plain["node"]
        sizes = None if said["sizes"] is None else (int(said["sizes"][0]), int(said["sizes"][1]))
        spaces = Spaces(known.roles, known.columns, sizes, int(said["window"]), bool(said["even"]))
        model = made(node, RewardModel, name)
        try:
            fit = RegisteredFit.read(plain["fit"], arrays, lambda: made(node, RewardModel, name), spaces)
        except Exception as error:  # whatever a model says to a state that is not its own
            raise ValueError(f"the model {name}: {type(error).__name__}: {error}") from None
        return cls(Registered(name, Chosen(model, bool(plain["own"]), node), StepTerms.of(spaces, model)), fit)


KINDS: dict[str, type[Linear | Alive]] = {"linear": Linear, "registered": Alive}


@dataclass(frozen=True)
class Fitted:
    """Models that were fitted, the reference first.

    Attributes:
        parts: models with their fits. mixer: of their proxies. factor: by what a deviation over draws is multiplied to
            be half an interval; NaN where there is none. rho: of what is left of labels. intercept: of bits, beside
            the sum of a window; None for numbers. nonnegative: whether balanced credit may not be below 0.
    """

    parts: Sequence[Part]
    mixer: Mixer
    factor: float
    rho: float
    intercept: float | None
    nonnegative: bool

    @property
    def models(self) -> tuple[Model | Registered, ...]:
        """Without their fits."""
        return tuple(one.model for one in self.parts)

    @cached_property
    def unsaved(self) -> str:
        """Why they cannot be saved; "" where they can."""
        for one in self.parts:
            try:
                one.saved()
            except UserError as error:
                return f"{one.model.name}: {error}"
        return ""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the models."""
        return tuple(one.model.name for one in self.parts)
