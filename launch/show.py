"""`credit show`: what a method, an experiment or a part is."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["show", *sys.argv[1:]]))
