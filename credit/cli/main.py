"""`credit <command>`: dispatch, help, and the one place where errors become exit codes."""

from __future__ import annotations

import importlib
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from credit.cli.modules import findable
from credit.cli.output import surviving
from credit.core.errors import UserError, nearest
from credit.core.version import __version__

COMMANDS = {
    "train": ("[overrides]", "run one job; with -m a sweep over comma-separated values"),
    "tune": ("[overrides]", "search for a method's best setting, and compare it with the default on other seeds"),
    "recover": ("DATA [words]", "per-step credit from a table with labels on windows: no simulator"),
    "resume": ("DIR", "finish a run or a sweep from its folder alone"),
    "status": ("", "which commands run now, how far they are, and how the last ones ended"),
    "runs": ("[filters]", "the runs of an output folder: list, filter, delete"),
    "compare": ("[overrides]", "tables, intervals and figures from finished runs"),
    "evaluate": ("RUN...", "what finished runs' policies are worth, also in a changed environment"),
    "play": ("RUN", "one episode of a run's policy, as text or as a video"),
    "export": ("RUN FILE", "a run's policy as an ONNX file, to act where there is no credit"),
    "list": ("[KIND]", "every registered component: name, one line, parameters with their defaults"),
    "show": ("KIND=OPTION...", "what a method, an experiment or a part is: equations, parts, keys, differences"),
    "check": ("[overrides]", "compose and check a configuration, write nothing"),
    "new": ("KIND NAME", "a component of your own to start from: class, YAML, test and package"),
    "sync": ("[DIR]", "upload to MLflow what it lacks of earlier sessions"),
    "dashboard": ("", "MLflow's UI on the project's store, on 127.0.0.1"),
    "completion": ("SHELL", "what lets bash, zsh or fish complete commands, options and keys"),
    "bench": ("[NAME]", "speed and memory against peers, as ratios within one run"),
}
EXAMPLES = """\
examples
  credit train experiment=advertiser method=disagreement seed=0 replicas=20
  credit train -m experiment=advertiser method=delayed,reference,disagreement replicas=20
  credit train method=reference bonus.count.scale=.2 trainer.steps=7000
  credit compare experiment=advertiser
  credit list bonus
  credit dashboard"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; 0 is success, 1 a failed run, 2 a request that cannot be met, 130 an interruption."""
    with surviving():
        return dispatched(list(sys.argv[1:] if argv is None else argv))


def dispatched(words: list[str]) -> int:
    """Run the command that some words begin with."""
    if not words or words[0] in ("-h", "--help", "help"):
        print(usage())
        return 0
    if words[0] in ("-V", "--version"):
        print(f"credit {__version__}")
        return 0
    return guarded(words[0], words[1:])


@contextmanager
def nothing_begun(command: str) -> Iterator[None]:
    """As long as nothing is made, Ctrl-C ends the process at once.

    Libraries that are being imported may swallow a KeyboardInterrupt, and the command would go on.
    """

    def end(number: int, frame: Any) -> None:
        os.write(2, f"credit {command}: interrupted\n".encode())
        os._exit(130)

    usual = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if not usual or threading.current_thread() is not threading.main_thread():
        yield
        return
    signal.signal(signal.SIGINT, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def guarded(command: str, words: Sequence[str]) -> int:
    """Run a command and turn its errors into messages and exit codes."""
    try:
        if command not in COMMANDS:
            raise UserError(f"{command!r} is no command; {nearest(command, COMMANDS)}")
        with findable(Path.cwd()):
            status: int = importlib.import_module(f"credit.cli.{command}").main(list(words))
        return status
    except UserError as error:
        lines = str(error).splitlines()
        print(
            f"credit {command}: " + ("\n  ".join(["", *lines]) if len(lines) > 1 else lines[0]),
            file=sys.stderr,
        )
        return 2
    except KeyboardInterrupt:
        print(f"credit {command}: interrupted", file=sys.stderr)
        return 130
    except OSError as error:
        print(f"credit {command}: {error}", file=sys.stderr)
        return 1


def usage() -> str:
    """The help text of `credit --help`."""
    width = max(len(f"{name} {words}") for name, (words, _) in COMMANDS.items())
    rows = [f"  credit {f'{name} {words}':<{width}}  {line}" for name, (words, line) in COMMANDS.items()]
    return "\n".join(
        [
            "credit: reinforcement learning when rewards come late",
            "",
            "commands",
            *rows,
            "",
            EXAMPLES,
            "",
            "`credit <command> --help` says more.",
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
