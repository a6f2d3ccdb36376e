"""What `credit recover` asks of registered parts: a mixer, and reward models in the place of formulas.

Reward models are composed as those of a run are: options, keys, a user's own YAML files, and with `experiment=NAME` the
models of an experiment. Without one they are as for environments that have no experiment of their own.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from credit.config import classes, files, registry, schema
from credit.config.quoting import quoted
from credit.core import signatures
from credit.core.errors import UserError, nearest
from credit.core.signatures import component_kind, signature
from credit.logged.asking import MODEL, REFERENCE
from credit.logged.registered import Chosen

if TYPE_CHECKING:
    from credit.core.seams import Mixer, RewardModel, Uncertainty

GENERIC = ("experiment=generic_discrete", "env=riverswim")  # what an environment without an experiment begins with
METHOD = "disagreement"  # reference and surrogates, mixed
SURROGATES = "surrogates"
WORDS = ("experiment", "uncertainty")  # of registered models alone
Tree = Mapping[str, Any]


@dataclass(frozen=True)
class Models:
    """What is asked of models.

    Attributes:
        reference, surrogates: as `Ask` takes them; a registered one is `Chosen`. mixer: of the models. draws: those of
            the uncertainty that was asked for, None where it has none of its own.
    """

    reference: Any = None
    surrogates: Mapping[str, Any] | None = None
    mixer: Mixer | None = None
    draws: int | None = None


@dataclass
class _Wanted:
    """Overrides by which models are composed.

    Attributes:
        words: as on the command line of a run. names: of surrogates that are registered. reference: whether it is.
        formulas: surrogates that are formulas.
    """

    words: list[str]
    reference: bool = False
    names: list[str] = field(default_factory=list)
    formulas: dict[str, Any] = field(default_factory=dict)


def models_of(tree: Tree, config_dirs: Sequence[str]) -> Models:
    """The models that a command line asks for.

    Args:
        tree: the words, of which `reference`, `surrogates`, `mixer` and those of `WORDS` are looked at.

    Raises:
        UserError: no such option or key, or a value that is not allowed.
    """
    experiment, uncertainty = tree.get("experiment"), tree.get("uncertainty")
    base = [*(GENERIC if experiment is None else (f"experiment={experiment}",)), f"method={METHOD}"]
    whole = experiment is not None
    theirs = (registry.compose(base, config_dirs).get(SURROGATES) or {}) if whole else {}
    wanted = _Wanted(base)
    reference, surrogates = tree.get(REFERENCE), tree.get(SURROGATES)
    if _registered(REFERENCE, reference, config_dirs, whole):
        wanted.reference = True
        wanted.words += _overrides(REFERENCE, reference)
    elif whole and reference is None:
        wanted.reference = True
    for name, given in (surrogates or {}).items() if isinstance(surrogates, Mapping) else ():
        path = f"{SURROGATES}.{name}"
        if _registered(path, given, config_dirs, name in theirs):
            wanted.names.append(str(name))
            wanted.words += _overrides(path, given, new=name not in theirs)
        else:
            wanted.formulas[str(name)] = given
    if not (wanted.reference or wanted.names or whole):
        if uncertainty is not None:
            raise UserError(
                "uncertainty has no effect: it is of registered models (reference=ridge), and formulas weigh units; "
                "leave it out"
            )
        return Models(reference, surrogates, mixer_of(tree.get("mixer"), config_dirs))
    wanted.words += _overrides("uncertainty", uncertainty)
    if whole:
        wanted.words += _overrides("mixer", tree.get("mixer"))
    return _composed(tree, wanted, config_dirs)


def _composed(tree: Tree, wanted: _Wanted, config_dirs: Sequence[str]) -> Models:
    config = registry.compose(wanted.words, config_dirs)
    whole = tree.get("experiment") is not None
    own = whole or tree.get("uncertainty") is not None
    made: Uncertainty = schema.build(config, "uncertainty")
    found: dict[str, Any] = {}
    nodes = {REFERENCE: config[REFERENCE]} if wanted.reference else {}
    theirs = config.get(SURROGATES) or {}
    surrogates = tree.get(SURROGATES)
    names = [name for name in theirs if name not in wanted.formulas] if whole and surrogates != {} else wanted.names
    nodes |= {name: theirs[name] for name in names}
    for name, node in nodes.items():
        model: RewardModel = schema.build({**config, REFERENCE: node}, REFERENCE)
        found[name] = Chosen(model, "uncertainty" in node or (own and _takes(model, made)), node)
    if own and not any(one.own for one in found.values()):
        kinds = ", ".join(type(one.model).__name__ for one in found.values())
        raise UserError(
            f"uncertainty has no effect: none of the models ({kinds}) takes {type(made).__name__}; choose another one, "
            "or leave it out"
        )
    draws = getattr(made, "draws", None) if own else None
    mixer: Mixer | None
    if whole:
        mixer = _usable(str(config["mixer"]["_target_"]), schema.build(config, "mixer"))
    else:
        mixer = mixer_of(tree.get("mixer"), config_dirs)
    reference = found.pop(REFERENCE, tree.get(REFERENCE))
    if surrogates is None and not found:
        return Models(reference, None, mixer, draws or None)
    return Models(reference, {**found, **wanted.formulas}, mixer, draws or None)


def _takes(model: RewardModel, uncertainty: Uncertainty) -> bool:
    """Whether a model takes such an uncertainty."""
    hint = signature(type(model)).get("uncertainty")
    kind = None if hint is None else component_kind(hint[0])
    return kind is not None and isinstance(uncertainty, kind)


def _registered(path: str, given: Any, config_dirs: Sequence[str], composed: bool) -> bool:
    """Whether a registered model is meant: by the name of an option; other texts are formulas.

    Args:
        composed: whether there is one already, of which single keys may be said.

    Raises:
        UserError: keys of a model, and no such option.
    """
    options = files.options("reward", config_dirs)
    if not isinstance(given, Mapping):
        return str(given) in options
    option = given.get("", given.get("option"))
    if option is not None:
        if str(option) not in options:
            raise UserError(f"{path}={option}: there is no such reward model; {nearest(str(option), options)}")
        return True
    return composed and not {*given} & {*MODEL[:1]}


def _overrides(path: str, given: Any, new: bool = False) -> list[str]:
    """Words of a run for what was said of a part, its option and its keys; `new`: there is none yet in its place."""
    if given is None:
        return []
    keys = dict(given) if isinstance(given, Mapping) else {"": given}
    option = keys.pop("", keys.pop("option", None))
    group = path if path in ("uncertainty", "mixer") else f"reward@{path}"
    words = [] if option is None else [f"{'+' if new else ''}{group}={option}"]
    return [*words, *_leaves(path, keys)]


def _leaves(path: str, keys: Mapping[str, Any]) -> list[str]:
    found = []
    for key, value in keys.items():
        at = f"{path}.{key}"
        if isinstance(value, Mapping):
            found += _leaves(at, value)
        elif isinstance(value, str):
            found.append(f"{at}={quoted(value)}")
        else:
            found.append(f"{at}={json.dumps(value)}")
    return found


def mixer_of(given: Any, config_dirs: Sequence[str]) -> Mixer | None:
    """A registered mixer, by its option and its keys."""
    if given is None:
        return None
    keys = dict(given) if isinstance(given, Mapping) else {"": given}
    option = str(keys.pop("", keys.pop("option", "relative_mse")))
    options = files.options("mixer", config_dirs)
    if option not in options:
        raise UserError(f"mixer={option}: there is no such mixer; {nearest(option, options)}")
    node = classes.node_of_option("mixer", option, config_dirs)
    cls = classes.resolve("mixer", node)
    hints = signature(cls)
    for key, value in keys.items():
        if key not in hints:
            raise UserError(f"mixer.{key}: unknown key; {nearest(key, hints)}")
        if reason := signatures.refusal(hints[key][0], value):
            raise UserError(f"mixer.{key}={value!r}: {reason}")
    return _usable(option, schema.build({"mixer": node | keys}, "mixer"))


def _usable(option: str, made: Mixer) -> Mixer:
    """A mixer that needs no more than predictions.

    Raises:
        UserError: it needs labels that a bootstrap held out.
    """
    if made.sees_label_errors:
        raise UserError(
            f"mixer={option}: it weighs models by draws that a run's bootstrap holds out, and there are none here; "
            "relative_mse, best, uniform and reference_only are for logged data"
        )
    return made
