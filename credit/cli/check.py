"""`credit check`: compose and check a configuration, build nothing."""

from __future__ import annotations

import sys

import yaml

from credit.cli.common import Words, help_text
from credit.cli.main import guarded
from credit.cli.train import checked_jobs, sweeps


def main(argv: list[str]) -> int:
    """Print the resolved configuration of the job, or how many jobs of a sweep are right."""
    words = Words.parse(argv, flags=("-m", "--multirun"))
    if words.help:
        print(help_text("check", "[-m] [group=option] [key=value] ...", words.config_dirs))
        return 0
    multirun = sweeps(words)
    configs = checked_jobs(words, multirun)
    if multirun:
        for _, overrides in configs:
            print(" ".join(overrides))
        print(f"# {len(configs)} jobs, all right")
    else:
        print(yaml.safe_dump(configs[0][0], sort_keys=False, allow_unicode=True), end="")
        print("# all right")
    return 0


if __name__ == "__main__":
    sys.exit(guarded("check", sys.argv[1:]))
