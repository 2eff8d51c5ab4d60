"""``python -m hil_bench`` is the command ``hil-bench``."""

import sys

from hil_bench.cli import main

if __name__ == "__main__":
    sys.exit(main())
