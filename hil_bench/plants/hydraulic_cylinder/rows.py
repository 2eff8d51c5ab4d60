"""The parameters of a cylinder: `parameters.tsv` declares each once, for its model and its keys."""

from pathlib import Path
from typing import Final

from hil_bench.config.rows import read_rows

ROWS: Final = read_rows(Path(__file__).with_name("parameters.tsv"))
"""Those that are words have their readers in `keys`."""
