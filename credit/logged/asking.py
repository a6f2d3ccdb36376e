"""What a user asks of a recovery from logged data, as plain values: checked, and made into models and options."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from keyword import iskeyword
from typing import TYPE_CHECKING, Any

from credit.core import signatures
from credit.core.errors import UserError, nearest
from credit.core.naming import is_name
from credit.core.signatures import signature
from credit.logged.crossing import crossed
from credit.logged.formulas.terms import Terms
from credit.logged.models import Model
from credit.logged.panel import MIXTURE, Panel
from credit.logged.recovered import AnyModel, Options, Recovered
from credit.logged.registered import Chosen, Registered
from credit.logged.tables.clashes import require_apart

if TYPE_CHECKING:
    from credit.core.seams import Mixer

MODEL = ("formula", "regularization", "sign")
REFERENCE = "reference"
CHOSEN = "chosen"  # key of a registered model, in the place of a formula
TAKEN = (REFERENCE, MIXTURE)  # names that no surrogate can have
CARRIED = 8  # actions at most for which it is tried unasked what is carried on
PLAIN = "actions"  # the surrogate where none is given


@dataclass(frozen=True)
class Ask:
    """A request.

    Attributes:
        data: the words `data.*`. reference: formula, regularization, sign; or `chosen`, a registered model. surrogates:
            name → the same; None: actions alone, where there are states, too. options: how. mixer: of the models.
    """

    data: Mapping[str, Any] = field(default_factory=dict)
    reference: Mapping[str, Any] = field(default_factory=dict)
    surrogates: Mapping[str, Mapping[str, Any]] | None = None
    options: Options = field(default_factory=Options)
    mixer: Mixer | None = None

    @classmethod
    def of(cls, given: Mapping[str, Any], mixer: Mixer | None = None) -> Ask:
        """Check plain values: data, reference, surrogates, and the fields of `Options`.

        Raises:
            UserError: with all that is wrong.
        """
        known = [*(one.name for one in fields(Options)), "data", REFERENCE, "surrogates"]
        problems = [
            f"{key}: there is no such key; {nearest(key, [*known, 'mixer'])}" for key in given if key not in known
        ]
        options = {key: value for key, value in given.items() if key in {one.name for one in fields(Options)}}
        for key, value in options.items():
            if reason := signatures.refusal(signature(Options)[key][0], value):
                problems.append(f"{key}={value!r}: {reason}")
        asked = given.get(REFERENCE)
        reference = _model(REFERENCE, {} if asked is None else asked, problems)
        surrogates = given.get("surrogates")
        if surrogates is not None:
            if not isinstance(surrogates, Mapping):
                problems.append(f"surrogates={surrogates!r}: a mapping belongs here, name → formula")
                surrogates = {}
            problems += [
                f"surrogates.{name}: {name!r} is no name for a surrogate; {is_name.__doc__}"
                for name in surrogates
                if not is_name(str(name)) or str(name) in TAKEN
            ]
            surrogates = {str(name): _model(f"surrogates.{name}", one, problems) for name, one in surrogates.items()}
        if problems:
            raise UserError("\n".join(problems))
        return cls(dict(given.get("data") or {}), reference, surrogates, Options(**options), mixer)

    def models(self, panel: Panel) -> list[AnyModel]:
        """The models, the reference first.

        Raises:
            UserError: a formula that is none, a sign of what is not in it, or a registered model that does not fit.
        """
        roles = panel.roles
        actions = _carried(panel)
        reference = dict(self.reference)
        if reference.get("formula") is None and CHOSEN not in reference and actions:
            reference["formula"] = " + ".join(["1", *actions, *map(quoted, roles.states)])
        elif reference.get("formula") is None and CHOSEN not in reference and _formulas() and (pairs := crossed(panel)):
            reference["formula"] = f"1 + {pairs}"
        draws = self.options.draws
        found = [_made(REFERENCE, REFERENCE, reference, panel, draws)]
        surrogates = self.surrogates
        if surrogates is None:
            plain = " + ".join(["1", *(actions or map(quoted, roles.actions))])
            surrogates = {PLAIN: {"formula": plain}} if roles.actions and roles.states and _formulas() else {}
        found += [_made(f"surrogates.{name}", name, one, panel, draws) for name, one in surrogates.items()]
        require_apart(roles, [model.name for model in found], panel.source)
        for model in found:
            if isinstance(model, Model):
                model.bound()
        return found

    def require(self, panel: Panel) -> None:
        """Refuse options that would have no effect on the labels of this table.

        Raises:
            UserError: with the option.
        """
        if panel.roles.label_is == "binary":
            if self.options.nonnegative or self.options.rho is not None:
                word = "nonnegative" if self.options.nonnegative else "rho"
                raise UserError(f"{word} has no effect: labels are bits (data.label_is), and no credit adds up to them")
        elif self.options.residual == "uniform" and self.options.rho is not None:
            raise UserError("rho has no effect: it is of residual=ar1, and residual=uniform is asked; leave one out")

    def fit(self, panel: Panel, models: Sequence[AnyModel] | None = None) -> Recovered:
        """Fit the models (None: those that are asked for) to an opened table."""
        from credit.logged.recovering import recover
        from credit.recovery.mixers import RelativeMSE

        self.require(panel)
        models = self.models(panel) if models is None else models
        return recover(panel, models, self.mixer or RelativeMSE(), self.options)


def _formulas() -> bool:
    """Whether formulas can be read."""
    return importlib.util.find_spec("formulaic") is not None


def _carried(panel: Panel) -> list[str]:
    """Terms of actions that may act on later rows, too, where it can be tried: folds choose how much is carried on.

    There is an order in time, actions are few, and those that are numbers are amounts.
    """
    roles = panel.roles
    numbers = [name for name in roles.actions if panel.columns[name].levels is None]
    if roles.time is None or not numbers or len(numbers) > CARRIED or not _formulas():
        return []
    amounts = {name for name in numbers if panel.columns[name].least >= 0 and name not in roles.stock}
    return [f"adstock({quoted(name)})" if name in amounts else quoted(name) for name in roles.actions]


def quoted(name: str) -> str:
    """A column's name as a formula has it."""
    return name if name.isidentifier() and not iskeyword(name) else f"`{name}`"


def _model(path: str, given: Any, problems: list[str]) -> dict[str, Any]:
    """A model's keys; a text is its formula, an object itself."""
    if isinstance(given, str):
        return {"formula": given}
    if not isinstance(given, Mapping):
        if (chosen := Chosen.of(given)) is not None:
            return {CHOSEN: chosen}
        problems.append(
            f"{path}={given!r}: a formula belongs here, a mapping of {', '.join(MODEL)}, or a registered reward model"
        )
        return {}
    found = dict(given)
    for key, value in given.items():
        if key not in MODEL:
            problems.append(f"{path}.{key}: there is no such key; {nearest(str(key), MODEL)}")
        elif key == "formula" and not (value is None or isinstance(value, str)):
            found[key] = str(value)  # 1
        elif key == "regularization" and not (
            value is None or (isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < 1e300)
        ):
            problems.append(f"{path}.regularization={value!r}: a number belongs here, 0 or more; null: chosen by folds")
        elif key == "sign" and not isinstance(value, Mapping):
            problems.append(f"{path}.sign={value!r}: a mapping belongs here, such as {{tv: positive}}")
    return found


def _no_model(formula: Any) -> str:
    """What there is to say of one word, which may be meant as the name of a registered model."""
    if not (isinstance(formula, str) and formula.strip().isidentifier()):
        return ""
    from credit.config.classes import names

    near = nearest(formula.strip(), names("reward"))
    return f"; nor is there a registered reward model of that name (`credit list reward`): {near}"


def _made(path: str, name: str, given: Mapping[str, Any], panel: Panel, draws: int) -> AnyModel:
    if CHOSEN in given:
        return Registered.of(name, path, given[CHOSEN], panel, draws)
    try:
        terms = Terms.of(given.get("formula"), panel.columns, panel.roles)
    except UserError as error:
        raise UserError(f"{path}: {error}{_no_model(given.get('formula'))}") from None
    regularization = given.get("regularization")
    return Model(name, terms, None if regularization is None else float(regularization), dict(given.get("sign") or {}))
