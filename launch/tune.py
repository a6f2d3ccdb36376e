"""`credit tune`: search for a method's best setting, and compare it with the default on other seeds."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["tune", *sys.argv[1:]]))
