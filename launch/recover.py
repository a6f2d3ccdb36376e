"""`credit recover`: per-step credit from a table with labels on windows."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["recover", *sys.argv[1:]]))
