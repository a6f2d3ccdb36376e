"""`credit export RUN FILE`: a run's policy as an ONNX file, or the windows that it learned from as a table."""

from __future__ import annotations

import sys
from pathlib import Path

from credit.cli.main import guarded
from credit.cli.words import Reader, read_words
from credit.core.errors import UserError

HELP = """\
Write what a finished run has for others, as the ending of the file says: its kept policy, to act where there is no
credit, or the labelled windows that it learned from, a row a step.

Usage: credit export RUN FILE.onnx [policy=NAME]
       credit export RUN FILE.csv|FILE.parquet

  RUN              the folder of a seed (…/seed-0), or of all seeds of a run: then the first one's policy, or the
                   windows of all, with a column seed
  FILE.onnx        a policy, once it was tried that the file does what the policy does
  policy=NAME      another of a run's policies: greedy, averaged                     (behaviour)
  FILE.csv         the windows: episode, step, observation, action, next_observation, window, and label in a window's
                   last row; `credit recover` reads it, and a run may start from it (demonstrations_from=FILE)

Inputs of a policy: observation, [1, O] float32 as gymnasium.spaces.flatten has it, or [1] int64 where it is a number;
and step, [1] int64, that of the episode. Output: action, in the environment's own space.

Example:
  credit export outputs/CartPole-v1/reference/default/seed-0 cartpole.onnx policy=greedy
  credit export outputs/advertiser/disagreement/default/seed-0 windows.csv
"""
READERS: dict[str, Reader] = {"policy": ("policy", str, "the name of a policy, such as greedy")}


def main(argv: list[str]) -> int:
    """Write the file, and say which."""
    if {"-h", "--help"} & set(argv):
        print(HELP, end="")
        return 0
    places = [word for word in argv if word.partition("=")[0] not in READERS]
    options = read_words([word for word in argv if word not in places], READERS, "export")
    if len(places) != 2:
        raise UserError(
            f"a run and a file are needed, got {' '.join(places) or 'none'}; `credit export --help` says more"
        )
    if not Path(places[0]).is_dir():
        raise UserError(f"{places[0]}: there is no such folder; give that of a run, such as …/default/seed-0")
    from credit.runs.export import SUFFIX, export
    from credit.runs.threads import limited

    with limited(1):
        file = export(places[0], places[1], **options)
    print(f"{'policy ' if file.suffix == SUFFIX else 'windows'}  {file}")
    return 0


if __name__ == "__main__":
    sys.exit(guarded("export", sys.argv[1:]))
