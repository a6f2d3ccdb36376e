"""`credit bench`: speed and memory against peers, as ratios within one run."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["bench", *sys.argv[1:]]))
