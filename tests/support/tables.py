"""Tables of tests as text: a file or a command line as a user has it, and what is said of it.

`test_x.txt` beside `test_x.py` has a section for each such table, headed by `==== ` and the name of
its test.
An empty line parts rows, `>>` begins the next column of a row, `; ` a remark. `ROOT/` stands for
the folder of the project.
"""

import inspect
from pathlib import Path

import pytest

ROOT = f"{Path(__file__).parents[2]}/"


def from_text(*names):
    """Give a test the rows of its table, as `pytest.mark.parametrize` does."""

    def mark(test):
        path = Path(inspect.getfile(test)).with_suffix(".txt")
        return pytest.mark.parametrize(names, list(read_rows(path, test.__name__)))(test)

    return mark


def read_rows(path, section):
    """Yield the columns of each row of a section."""
    text = path.read_text(encoding="utf-8").replace("ROOT/", ROOT)
    _, _, text = text.partition(f"==== {section}\n")
    for row in text.partition("\n==== ")[0].strip("\n").split("\n\n"):
        lines = "\n".join(line for line in row.split("\n") if not line.startswith("; "))
        first, *others = f"\n{lines}".split("\n>>")
        yield [first.removeprefix("\n"), *(column.removeprefix(" ") for column in others)]
