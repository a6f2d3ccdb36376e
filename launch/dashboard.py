"""`credit dashboard`: MLflow's UI on the project's store, on 127.0.0.1."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["dashboard", *sys.argv[1:]]))
