"""From words to the checked configuration of one job, or to all that is wrong with them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from credit.config import registry, slugs
from credit.config.kinds import CHOICES, KINDS, SLOTS
from credit.core.errors import UnknownKey, UserError

NAMED = {"experiment", "method"}  # words with nothing to check but that there is such an option


def compose(
    overrides: Sequence[str] = (),
    *,
    config_dirs: Sequence[str] = (),
    say: Callable[[str], None] = lambda remark: None,
    idle: Callable[[dict[str, str]], None] | None = None,
) -> dict[str, Any]:
    """The resolved and checked configuration of one job, without what it does not use; it knows its folder.

    Args:
        overrides: as on the command line. config_dirs: further folders of YAML files.
        say: called with what is right, but a user should know.
        idle: called with words that have no effect, and the slots that they are for; None refuses them.

    Raises:
        UserError: with every problem found.

    Example:
        >>> credit.compose(["method=disagreement"])["mixer"]["alpha"]
        0.5
    """
    registry.require_words(overrides, config_dirs)
    try:
        composed = registry.compose(overrides, config_dirs)
    except UserError as error:
        unknown = _unknown(overrides, config_dirs)
        slots = {text: text.lstrip("+").partition(".")[0] for text in unknown}
        if idle and slots and {*slots.values()} <= SLOTS.keys():  # of a part that this job does not have
            idle(slots)
            others = [text for text in overrides if text not in slots]
            return compose(others, config_dirs=config_dirs, say=say, idle=idle)
        raise UserError("\n".join(_wrong(error, unknown, overrides, config_dirs))) from None
    from credit.runs import effects, folders
    from credit.runs import job as jobs  # all that runs: who mistypes a word does not wait for it

    config = jobs.checked(composed, say)
    if words := effects.idle(overrides, config):
        (idle or partial(effects.refuse, overrides=overrides, config_dirs=config_dirs))(words)
    named = config | {"slug": slugs.slug(config, overrides, config_dirs)}
    return named | {"slug": folders.named(named)}


def _unknown(overrides: Sequence[str], config_dirs: Sequence[str]) -> dict[str, str]:
    """Word → what is said of it, of all whose key nothing has; Hydra tells the first alone."""
    kept = [text for text in overrides if text.partition("=")[0].partition("@")[0] in {*KINDS, *CHOICES}]
    said: dict[str, str] = {}
    keys = [text for text in overrides if text not in kept]
    for text in sorted(keys, key=lambda text: not text.startswith("env.")):  # an environment decides what else there is
        try:
            registry.compose([*kept, text], config_dirs)
        except UnknownKey as error:
            said[text] = str(error)
            continue
        except UserError:  # what else is wrong may be for want of a word that comes later
            pass
        kept.append(text)
    return said


def _wrong(
    first: UserError, unknown: dict[str, str], overrides: Sequence[str], config_dirs: Sequence[str]
) -> list[str]:
    """What is wrong with each word that cannot be composed, and with what the others come to."""
    if not unknown:
        return [str(first)]
    others = [text for text in overrides if text not in unknown]
    if {text.partition("=")[0] for text in others} <= NAMED:
        return [*dict.fromkeys(unknown.values())]
    try:
        compose(others, config_dirs=config_dirs)
    except UserError as error:
        return [*dict.fromkeys([*unknown.values(), str(error)])]
    return [*dict.fromkeys(unknown.values())]
