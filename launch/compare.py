"""`credit compare`: tables, intervals and figures from finished runs."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["compare", *sys.argv[1:]]))
