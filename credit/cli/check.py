"""`credit check`: compose and check a configuration, and say where its values come from; run nothing."""

from __future__ import annotations

import json
import sys
from typing import Any

import yaml

from credit.cli.common import Words, help_text
from credit.cli.main import guarded
from credit.cli.train import checked_jobs, several
from credit.core.errors import UserError

EXPLAIN = "--explain"
WIDEST = 48  # letters of a column


def main(argv: list[str]) -> int:
    """Print the resolved configuration of a job, where it comes from, or how many jobs of a sweep are right."""
    words = Words.parse(argv, flags=("-m", "--multirun", EXPLAIN))
    if words.help:
        print(help_text("check", f"[-m | {EXPLAIN}] [group=option] [key=value] ...", words.config_dirs))
        return 0
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
        print(yaml.safe_dump(configs[0][0], sort_keys=False, allow_unicode=True), end="")
        print("# all right")
    return 0


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
