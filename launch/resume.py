"""`python launch/resume.py …` is `credit resume …`, from a checkout."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["resume", *sys.argv[1:]]))
