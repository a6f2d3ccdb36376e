"""Where a recovery goes, never over another one's result; and what was asked, as a file that asks for it again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import yaml

from credit.cli.recovery_data import is_run
from credit.core.errors import UserError

if TYPE_CHECKING:
    from credit.cli.recovery_words import Request
    from credit.logged.panel import Panel
    from credit.logged.recovered import AnyModel

CONFIG = "recover.yaml"  # in the folder of a recovery
GUESSED = ("window", "label", "states", "actions", "stock", "label_is", "baseline", "cost", "randomised", "propensity")
OR_NONE = ("time", "group")  # which false leaves out
Tree = dict[str, Any]


def settled(asked: Request, panel: Panel, models: Sequence[AnyModel]) -> Request:
    """The same with all keys, those that were guessed and those that were typed; `from=FILE.yaml` reads them.

    Args:
        panel: the table. models: that are fitted to it.
    """
    from credit.logged.asking import REFERENCE
    from credit.logged.models import Model
    from credit.logged.panel import plain

    tree: Tree = plain(asdict(asked.ask.options))
    if _table(asked.data):
        roles = {name: plain(value) for name in GUESSED if (value := getattr(panel.roles, name))}
        tree["data"] = roles | {name: getattr(panel.roles, name) or False for name in OR_NONE}
    for number, model in enumerate(models):
        if isinstance(model, Model) and model.terms.formula:
            under = tree.setdefault("surrogates", {}) if number else tree
            under[model.name if number else REFERENCE] = {"formula": model.terms.formula}
    return replace(asked, tree=over(tree, plain(asked.tree)))


def over(under: Mapping[str, Any], typed: Mapping[str, Any]) -> Tree:
    """Keys, and over them those that were typed."""
    both = dict(under)
    for key, value in typed.items():
        below = both.get(key)
        both[key] = over(below, value) if isinstance(below, Mapping) and isinstance(value, Mapping) else value
    return both


def written(asked: Request) -> str:
    """The file: first the command that asks for the same again."""
    path = Path(asked.data)
    data = str(path.absolute()) if _table(asked.data) else asked.data
    model = f" --model {quote(str(asked.model))}" if asked.model is not None else f" from={CONFIG}"
    return f"# credit recover {quote(data)}{model}\n{yaml.safe_dump(dict(asked.tree), allow_unicode=True, width=120)}"


def parameters(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Key and value of every leaf, as they are typed."""
    for key, value in tree.items():
        name = f"{prefix}.{key}" if prefix and key else prefix or str(key)
        if isinstance(value, Mapping) and value:
            yield from parameters(value, name)
        elif value not in ({}, [], ""):
            yield name, str(value)


def placed(asked: Request, taken: Sequence[Path] = ()) -> Request:
    """The same in a folder that holds no other recovery's result: NAME, or NAME-2, NAME-3 where no name was typed.

    Args:
        asked: with all keys. taken: folders of recoveries before it.

    Raises:
        UserError: the name was typed, and another recovery has it; or something else lies there.
    """
    from credit.logged.writing import DONE, Folder

    name, number, text = asked.name, 1, written(asked)
    while True:
        one = replace(asked, name=name if number == 1 else f"{name}-{number}")
        Folder.require_free(one.folder, keep_models=one.model is not None)
        held = one.folder / CONFIG
        same = held.is_file() and held.read_text(encoding="utf-8") == text
        within = (one.folder.parent / DONE).exists()  # which would go with it
        if one.folder not in taken and not within and (same or not (one.folder / DONE).exists()):
            if number > 1:
                print(f"{asked.folder} holds another recovery; this one goes to {one.folder}")
            return one
        if asked.named or within:
            raise UserError(
                f"name={name}: {one.folder.parent if within else one.folder} holds another recovery, which would be "
                "lost; take another name, or another output=…"
            )
        number += 1


def _table(data: str) -> bool:
    """Whether this is a file, a folder or a pattern of them, and says nothing of its columns itself."""
    from credit.logged.tables import minari

    return not is_run(data) and minari.dataset(data) is None
