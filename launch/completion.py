"""`credit completion`: what lets a shell complete commands, options and keys."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["completion", *sys.argv[1:]]))
