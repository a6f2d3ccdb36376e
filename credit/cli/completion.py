"""`credit completion SHELL`: the script that lets a shell complete commands, groups, options and keys."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator, Sequence
from itertools import chain

from credit.cli.main import COMMANDS, guarded
from credit.config import files
from credit.config.kinds import CHOICES, KINDS
from credit.core.errors import UserError, nearest

WORDS = "words"  # what the scripts ask: `credit completion words credit train meth`
COMPOSING = ("train", "check", "tune", "show")  # commands whose words are those of a job
PLAIN = (
    "seed=",
    "replicas=",
    "device=",
    "output=",
    "rerun=",
    "trainer.steps=",
    "trainer.episodes=",
    "trainer.log_every=",
)
SCRIPTS = {
    "bash": """\
_credit() {  # bash breaks words at = and :, so they are read from the line
    local IFS=$' \\t\\n' line="${COMP_LINE:0:COMP_POINT}" words word
    read -ra words <<< "$line"
    [[ $line == *' ' ]] && words+=('')
    word="${words[-1]}"
    local IFS=$'\\n' broken="${word%"${word##*[=:]}"}"
    COMPREPLY=($(credit completion words "${words[@]}" 2> /dev/null))
    COMPREPLY=("${COMPREPLY[@]#"$broken"}")
}
complete -o nospace -o default -F _credit credit""",
    "zsh": """\
#compdef credit
_credit() {
    local -a found
    found=("${(@f)$(credit completion words "${(@)words[1,CURRENT]}" 2> /dev/null)}")
    compadd -S '' -- $found
}
compdef _credit credit""",
    "fish": """\
function __credit_complete
    credit completion words (commandline -opc) (commandline -ct) 2> /dev/null
end
complete -c credit -f -a '(__credit_complete)'""",
}
WHERE = {
    "bash": "credit completion bash >> ~/.bashrc",
    "zsh": "credit completion zsh >> ~/.zshrc",
    "fish": "credit completion fish > ~/.config/fish/completions/credit.fish",
}
USAGE = "\n".join(["usage: credit completion SHELL", "", *(f"  {line}" for line in WHERE.values())])


def main(argv: list[str]) -> int:
    """Print the script of a shell, or, for a script, what its words may go on with."""
    if argv[:1] == [WORDS]:
        print("\n".join(candidates(argv[2:])))
        return 0
    if not argv or {"-h", "--help"} & set(argv):
        print(USAGE)
        return 0
    if len(argv) > 1 or argv[0] not in SCRIPTS:
        raise UserError(f"{' '.join(argv)!r} is no shell here; {nearest(argv[0], SCRIPTS)}")
    print(SCRIPTS[argv[0]])
    return 0


def candidates(words: Sequence[str]) -> list[str]:
    """What the last word may become.

    Args:
        words: those after `credit`; the last is being typed, and may be empty.
    """
    *before, last = words or [""]
    if not before:
        found: Iterator[str] = iter(COMMANDS)
    elif before[0] == "list":
        found = iter([*CHOICES, *KINDS])
    elif before[0] in COMPOSING:
        found = chain(_of_a_job(before[1:], last, before[0] == "show"), _keys_of(before[0]))
    else:
        found = _keys_of(before[0])
    return sorted({word for word in found if word.startswith(last)})


def _of_a_job(before: Sequence[str], last: str, shown: bool) -> Iterator[str]:
    """Groups, their options once a group is typed, and the keys of what is chosen."""
    group, equals, value = last.partition("=")
    kind = group.lstrip("+").partition("@")[0]
    if equals and kind in {**CHOICES, **KINDS}:
        listed = value.rpartition(",")[0]
        head = f"{group}={listed}," if listed else f"{group}={'[' if value.startswith('[') else ''}"
        yield from (f"{head}{option}" for option in files.options(kind))
        return
    yield from (f"{kind}=" for kind in {**CHOICES, **KINDS})
    if shown:
        return
    yield from PLAIN
    chosen = dict(word.partition("=")[::2] for word in before if "=" in word)
    for kind, entry in KINDS.items():
        for slot in entry.slots:
            for option in chosen.get(kind, "").strip("[]").split(","):
                if (path := files.options(kind).get(option)) is not None:
                    prefix = f"{slot}.{option}" if entry.several else slot
                    yield from (f"{prefix}.{key}=" for key in files.read(path) if key not in ("_target_", "defaults"))


def _keys_of(command: str) -> Iterator[str]:
    """The KEY= words of a command that has them."""
    if command in COMMANDS:
        yield from (f"{key}=" for key in getattr(importlib.import_module(f"credit.cli.{command}"), "READERS", {}))


if __name__ == "__main__":
    sys.exit(guarded("completion", sys.argv[1:]))
