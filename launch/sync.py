"""`credit sync`: upload to MLflow what it lacks of earlier sessions."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["sync", *sys.argv[1:]]))
