"""`credit resume`: finish a run or a sweep from its folder alone."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["resume", *sys.argv[1:]]))
