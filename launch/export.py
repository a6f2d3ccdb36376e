"""`credit export`: a run's policy as an ONNX file."""

import sys

from credit.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["export", *sys.argv[1:]]))
