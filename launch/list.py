"""`python launch/list.py …` is `credit list …`, from a checkout."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["list", *sys.argv[1:]]))
