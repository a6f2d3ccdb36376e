"""`credit evaluate`: what finished runs' policies are worth, also in a changed environment."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["evaluate", *sys.argv[1:]]))
