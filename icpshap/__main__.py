"""python -m icpshap: the command."""

import sys

from icpshap.cli import main

if __name__ == "__main__":
    sys.exit(main())
