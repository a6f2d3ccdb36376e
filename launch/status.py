"""`credit status`: which commands run now, how far they are, and how the last ones ended."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["status", *sys.argv[1:]]))
