"""Mixers as plain values: the class by its name, and its parameters."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any

from credit.core.errors import UserError
from credit.core.seams import Mixer
from credit.core.signatures import signature
from credit.logged.panel import plain


def saved_mixer(mixer: Mixer | None) -> dict[str, Any]:
    """A mixer as its class and its parameters; nothing for none.

    Raises:
        UserError: it cannot be found again by its name, or does not keep its parameters under their names.
    """
    if mixer is None:
        return {}
    cls = type(mixer)
    name = f"{cls.__module__}:{cls.__qualname__}"
    if "<" in name or cls.__module__ == "__main__":
        raise UserError(f"mixer {cls.__name__} cannot be saved: it stands in no module; move its class to a file")
    parameters = {}
    for key in signature(cls):
        value = getattr(mixer, key, mixer)
        if plain(value) != value:
            raise UserError(
                f"mixer {cls.__name__} cannot be saved: keep its parameter {key!r} as an attribute, plainly"
            )
        parameters[key] = value
    return {"class": name, "parameters": parameters}


def read_mixer(saved: Mapping[str, Any]) -> Mixer:
    """A mixer that was saved.

    Raises:
        UserError: its class is not there, or is no mixer.
    """
    module, _, name = str(saved["class"]).partition(":")
    try:
        cls: Any = importlib.import_module(module)
        for part in name.split("."):
            cls = getattr(cls, part)
    except (ImportError, AttributeError, ValueError):
        raise UserError(
            f"the mixer {saved['class']} cannot be imported; install what has it, or recover anew"
        ) from None
    if not (isinstance(cls, type) and issubclass(cls, Mixer)):
        raise UserError(f"{saved['class']} is no mixer; recover anew")
    made: Mixer = cls(**saved["parameters"])
    return made
