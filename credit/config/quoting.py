"""A text as a value of an override, whatever is in it: a path is never a part of Hydra's grammar."""

from __future__ import annotations

import re


def quoted(text: str) -> str:
    """A text in quotes, by the rules of Hydra's overrides and of OmegaConf's interpolations.

    Example:
        >>> f"output={quoted("/it's ${here}, now")}"
        "output='/it\\\\'s \\\\${here}, now'"
    """
    text = re.sub(r"(\\*)\$\{", r"\1\1\\${", text)
    return "'" + re.sub(r"(\\*)('|\Z)", lambda found: 2 * found[1] + ("\\'" if found[2] else ""), text) + "'"
