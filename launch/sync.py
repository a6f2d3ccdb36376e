"""`python launch/sync.py …` is `credit sync …`, from a checkout."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["sync", *sys.argv[1:]]))
