"""`credit new`: a component of your own to start from."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["new", *sys.argv[1:]]))
