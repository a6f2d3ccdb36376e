"""`credit check`: compose and check a configuration, write nothing."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["check", *sys.argv[1:]]))
