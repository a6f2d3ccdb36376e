"""`python launch/dashboard.py …` is `credit dashboard …`, from a checkout."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["dashboard", *sys.argv[1:]]))
