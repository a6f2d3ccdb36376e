"""`credit list`: every registered component: name, one line, parameters with their defaults."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["list", *sys.argv[1:]]))
