"""`credit train`: run one job; with -m a sweep over comma-separated values."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["train", *sys.argv[1:]]))
