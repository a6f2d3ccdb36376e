"""`credit check`: compose and check a configuration, and say where its values come from; run nothing."""

from __future__ import annotations

import json
import sys
from typing import Any

import yaml

from credit.cli.common import CFG, PARTS, Words, help_text
from credit.cli.main import guarded
from credit.cli.train import checked_jobs, several
from credit.config import registry
from credit.core.errors import UserError

EXPLAIN = "--explain"
WIDEST = 48  # letters of a column


def main(argv: list[str]) -> int:
    """Print the resolved configuration of a job, where it comes from, or how many jobs of a sweep are right."""
    words = Words.parse(argv, flags=("-m", "--multirun", EXPLAIN, CFG))
    if words.help:
        arguments = f"[-m | {EXPLAIN} | {CFG} {'|'.join(PARTS)}] [group=option] [key=value] ..."
        print(help_text("check", arguments, words.config_dirs))
        return 0
    if words.part:
        return configuration(words)
    explain = EXPLAIN in words.flags
    words.flags = [flag for flag in words.flags if flag != EXPLAIN]
    multirun = several(words)
    if multirun and explain:
        raise UserError(f"{EXPLAIN} is of one job; leave out {' '.join(words.flags) or 'the sweep'}")
    configs = checked_jobs(words, multirun)
    if multirun:
        for _, overrides in configs:
            print(" ".join(overrides))
        print(f"# {len(configs)} jobs, all right")
    elif explain:
        print(explanation(*configs[0], words.config_dirs))
        print("# all right")
    else:
        print(_yaml(configs[0][0]))
        print("# all right")
    return 0


def configuration(words: Words) -> int:
    """Print what `--cfg` asks for: the checked configuration of the job, Hydra's own part, or both.

    Raises:
        UserError: the words are wrong, or are those of a sweep.
    """
    if several(words):
        raise UserError(f"{CFG} is of one job; leave out {' '.join(words.flags) or 'the sweep'}")
    job = {} if words.part == "hydra" else checked_jobs(words, multirun=False)[0][0]
    own = {} if words.part == "job" else {"hydra": registry.hydra_node(words.overrides, words.config_dirs)}
    print(_yaml({**own, **job}))
    return 0


def _yaml(config: dict[str, Any]) -> str:
    return yaml.safe_dump(config, sort_keys=False, allow_unicode=True).rstrip()


def explanation(config: dict[str, Any], overrides: list[str], config_dirs: list[str]) -> str:
    """Key, value and origin in columns."""
    from credit.config.origins import explained

    rows = [
        (path, value if isinstance(value, str) else json.dumps(value, ensure_ascii=False), origin)
        for path, value, origin in explained(config, overrides, config_dirs)
    ]
    widths = [min(max(len(row[column]) for row in rows), WIDEST) for column in (0, 1)]
    return "\n".join(f"{path:<{widths[0]}}  {value:<{widths[1]}}  {origin}" for path, value, origin in rows)


if __name__ == "__main__":
    sys.exit(guarded("check", sys.argv[1:]))
