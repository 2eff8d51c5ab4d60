"""`python -m hil_bench.abilities.controllers.library` prints the folder of `hil_controller.h`."""

import sys
from pathlib import Path

sys.stdout.write(f"{Path(__file__).parent / 'include'}\n")
