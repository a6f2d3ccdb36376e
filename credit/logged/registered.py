"""Reward models that are registered (networks, tables, anybody's own) in the place of a formula."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from credit.core.errors import Misfit, UserError
from credit.logged.panel import Floats, Ints, Panel, Part
from credit.logged.steps import Spaces

if TYPE_CHECKING:
    from credit.core.seams import RewardModel


TABLES = "tables need data.states and data.actions of one column each, both whole numbers or categories"


@dataclass(frozen=True)
class Chosen:
    """A reward model that was asked for.

    Attributes:
        model: not started. own: whether its own uncertainty is meant; else units are weighed as for formulas. node: its
            configuration, from which it can be made again; empty where it came as an object.
    """

    model: RewardModel
    own: bool
    node: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, given: Any) -> Chosen | None:
        """What was given as an object, where it is a reward model."""
        from credit.core.seams import RewardModel

        if isinstance(given, cls):
            return given
        return cls(given, _draws(given)) if isinstance(given, RewardModel) else None


def _draws(model: RewardModel) -> bool:
    """Whether a model has an uncertainty that tells more than a formula without draws."""
    from credit.recovery.uncertainty.bootstrap import Analytic

    return model.uncertainty is not None and not isinstance(model.uncertainty, Analytic)


@dataclass(frozen=True)
class StepTerms:
    """The design of steps in the place of a formula's: what `models.Pass` asks of any model.

    Attributes:
        spaces: how rows are steps. formula: what there is to say of it.
    """

    spaces: Spaces
    formula: str
    choices: tuple[Any, ...] = ()
    sampled: bool = False

    @classmethod
    def of(cls, spaces: Spaces, model: RewardModel) -> StepTerms:
        """Those of a model."""
        return cls(spaces, f"{type(model).__name__} {model.name!r}: {spaces.said}")

    @property
    def names(self) -> tuple[str, ...]:
        """Of all columns."""
        return self.spaces.names

    @property
    def stock(self) -> NDArray[np.bool_]:
        """No column is made another one's mean."""
        return np.zeros(len(self.names), dtype=bool)

    def learn(self, part: Part) -> StepTerms:
        """There is nothing to learn."""
        return self

    def design(self, part: Part, state: dict[str, Any], columns: Ints | None = None) -> Floats:
        """All columns of some rows [n, F]."""
        return self.spaces.design(part)

    def replaced(
        self, part: Part, state: dict[str, Any], column: str, value: Any, columns: Ints | None = None
    ) -> Floats:
        """The same where a column has one value in all rows."""
        return self.spaces.design(part, (column, value))


@dataclass(frozen=True)
class Registered:
    """A reward model of a recovery from a table.

    Attributes:
        name: in tables, files and figures. chosen: the model, not started. terms: its design, the numbers of a step.
        unsaved: why it cannot be saved; "" where it can, as far as that is known before it is fitted.
    """

    name: str
    chosen: Chosen
    terms: StepTerms
    unsaved: str = ""

    @classmethod
    def of(cls, name: str, path: str, chosen: Chosen, panel: Panel, draws: int) -> Registered:
        """Check that a model can be fitted to a table: it is started, once, on a copy.

        Args:
            name: of the model. path: where it was asked for. panel: the table. draws: B, of the recovery.

        Raises:
            UserError: it asks for what no table says, or takes other spaces, labels, or draws.
        """
        from credit.core.capabilities import parts_of, require
        from credit.core.component import Component
        from credit.recovery.recovery import places_of

        spaces, model = Spaces.of(panel), copy.deepcopy(chosen.model)
        problem = spaces.problem((0,))
        try:
            require({path: model}, problem)
        except Misfit as error:
            raise UserError(f"{error} ({spaces.said}; {TABLES})") from None
        for at, part in parts_of(model, path):
            if part.sees_primitive:
                raise UserError(f"{at}: {type(part).__name__} is shown the reward of every step, which no table says")
            if part.knows is not None and type(part).learn is not Component.learn:
                raise UserError(
                    f"{at}: {type(part).__name__} asks its environment for {part.knows.__name__}, and a table has "
                    "none; choose another part in its place"
                )
        _require_labels(path, model, panel)
        if "next_state" in model.looks_at and not spaces.tells_next:
            raise UserError(f"{path}: {model.name} looks at the state behind a step; say data.next_states=[…]")
        if chosen.own:
            _require_draws(path, model, draws)
        model.start(problem, places_of([model], problem))
        return cls(name, chosen, StepTerms.of(spaces, model), _unsaved(chosen, model))


def _unsaved(chosen: Chosen, started: RewardModel) -> str:
    """Why a model cannot be saved."""
    from credit.logged.fits.states import split
    from credit.logged.nodes import described

    try:
        described(chosen.model, chosen.node)
        split(started.acting(), {})
    except (UserError, TypeError) as error:
        return str(error)
    return ""


def _require_labels(path: str, model: RewardModel, panel: Panel) -> None:
    bits, logistic = panel.roles.label_is == "binary", model.likelihood == "logistic"
    if bits and not logistic:
        raise UserError(
            f"{path}: labels are bits (data.label_is=binary), and {type(model).__name__} {model.name!r} fits numbers; "
            f"set {path}.likelihood=logistic where it has that key, or data.label_is=sum"
        )
    if logistic and not bits:
        raise UserError(
            f"{path}: likelihood=logistic is of labels that are bits, and these are numbers; leave it out, or set "
            "data.label_is=binary"
        )
    if getattr(model, "credit", "") == "last_step" and panel.roles.label_is != "last":
        raise UserError(
            f"{path}.credit=last_step: labels are the {panel.roles.label_is} of rows; set data.label_is=last"
        )


def _require_draws(path: str, model: RewardModel, draws: int) -> None:
    from credit.recovery.uncertainty.bootstrap import FitUncertainty

    own = model.uncertainty
    if not isinstance(own, FitUncertainty) or own.draws == draws:
        return
    if not own.draws:
        raise UserError(
            f"{path}: its uncertainty ({type(own).__name__}) makes no draws, and intervals here are of draws; leave "
            "uncertainty out (units are weighed), or choose uncertainty=bootstrap"
        )
    raise UserError(
        f"{path}: its uncertainty makes {own.draws} draws, and the recovery {draws}; they are compared draw by draw: "
        f"set draws={own.draws}, or uncertainty.draws={draws}"
    )
