"""`python launch/bench.py …` is `credit bench …`, from a checkout."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["bench", *sys.argv[1:]]))
