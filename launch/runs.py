"""`credit runs`: the runs of an output folder: list, filter, delete."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["runs", *sys.argv[1:]]))
