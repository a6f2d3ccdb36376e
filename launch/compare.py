"""`python launch/compare.py …` is `credit compare …`, from a checkout."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["compare", *sys.argv[1:]]))
