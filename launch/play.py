"""`credit play`: one episode of a run's policy, as text or as a video."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["play", *sys.argv[1:]]))
