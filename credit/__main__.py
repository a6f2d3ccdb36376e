"""`python -m credit`: the command line."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
