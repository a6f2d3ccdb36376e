"""What the commands share: their words, and the help that shows groups and options."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from credit.cli.main import EXAMPLES
from credit.config import files, kinds
from credit.core.errors import UserError, nearest

CFG, PARTS = "--cfg", ("job", "hydra", "all")  # Hydra's own option: print a part of the configuration, run nothing


@dataclass
class Words:
    """A command line, sorted: overrides, flags, further folders of YAML files, and the part that `--cfg` asks for."""

    overrides: list[str] = field(default_factory=list)
    flags: list[str] = field(default_factory=list)
    config_dirs: list[str] = field(default_factory=list)
    help: bool = False
    part: str = ""

    @classmethod
    def parse(cls, argv: Sequence[str], flags: tuple[str, ...] = ()) -> Words:
        """Sort the words of a command.

        Raises:
            UserError: an option that the command does not have, or words without an effect.
        """
        words, rest = cls(), list(argv)
        while rest:
            word = rest.pop(0)
            if word in ("-h", "--help"):
                words.help = True
            elif word in ("-cd", "--config-dir") or word.startswith("--config-dir="):
                _, equals, folder = word.partition("=")
                if not equals and not rest:
                    raise UserError(f"{word} needs a folder")
                words.config_dirs.append(folder if equals else rest.pop(0))
            elif CFG in flags and (word in (CFG, "-c") or word.startswith(f"{CFG}=")):
                _, equals, words.part = word.partition("=")
                if not equals:
                    words.part = rest.pop(0) if rest else ""
                if words.part not in PARTS:
                    raise UserError(f"{CFG} {words.part}: expected one of {', '.join(PARTS)}")
            elif word in flags:
                words.flags.append(word)
            elif word.startswith("-"):
                name, _, value = word.lstrip("-").partition("=")
                value = value or (rest[0] if rest and "=" not in rest[0] else "…")
                advice = nearest(word, [*flags, "--config-dir", "--help"])
                raise UserError(f"{word!r} is no option here; {advice}; settings have no dashes, write {name}={value}")
            else:
                words.overrides.append(word)
        require_effects(words.overrides)
        return words


def require_effects(overrides: Sequence[str]) -> None:
    """Refuse words that nothing would come of: a key that is given twice, and Hydra's settings of its own.

    Raises:
        UserError: with all of them.
    """
    last = {_key(word): word for word in overrides}
    problems = [
        f"{word!r} has no effect, since {last[_key(word)]!r} is given, too; leave one of them out"
        for word, *behind in (overrides[place:] for place in range(len(overrides)))
        if _key(word) in map(_key, behind) and _key(word) != "sweep"
    ]
    problems += [
        f"{word!r} has no effect: of Hydra's settings only those of its launchers are used (hydra/launcher=…, "
        "hydra.launcher.KEY=…); output=DIR says where runs lie, and a session's folder has the logs of its jobs"
        for key, word in last.items()
        if key.startswith("hydra") and not key.startswith(("hydra/launcher", "hydra.launcher."))
    ]
    if problems:
        raise UserError("\n".join(problems))


def _key(word: str) -> str:
    return word.partition("=")[0].lstrip("+~")


def help_text(command: str, arguments: str, config_dirs: Sequence[str]) -> str:
    """Usage, every group with its options, and examples."""
    lines = [
        f"usage: credit {command} {arguments} [--config-dir DIR]",
        "",
        "what can be chosen (group=option)",
    ]
    groups = {**kinds.CHOICES, **{name: kind.help for name, kind in kinds.KINDS.items() if kind.slots}}
    for group, line in groups.items():
        options = files.options(group, config_dirs)
        if not options:
            continue
        lines += [f"  {group:<12} {line}", f"  {'':<12}   {', '.join(options)}"]
    lines += [
        "",
        "what can be set (key=value): seed, replicas, device, output, rerun, trainer.steps, trainer.log_every, …",
        "and every parameter of a component, as `credit list KIND` shows them: mixer.alpha=.3",
        "",
        EXAMPLES,
    ]
    return "\n".join(lines)
