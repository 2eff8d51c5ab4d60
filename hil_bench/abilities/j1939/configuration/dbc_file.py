"""A DBC file, read by cantools, and what is wrong in one that it refuses."""

import logging
import re
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hil_bench.config.values import quote
from hil_bench.errors import ConfigError, about_file

if TYPE_CHECKING:
    from cantools.database.can import Database

_MOST_OF_REASON: Final = 200
"""Characters of what cantools says of a file that it cannot read."""
_EXTENDED: Final = 1 << 31
"""The bit of an identifier in a DBC file that says that it has 29 bits."""
_HIGHEST: Final = 0x1FFFFFFF
"""The highest identifier of 29 bits."""

_SYNTAX: Final = re.compile(
    r'Invalid syntax at line (\d+), column (\d+): "(.*)>>!<<(.*)"', re.DOTALL
)
_IDENTIFIER: Final = re.compile(
    r"frame id 0x([0-9a-f]+) is more than (11|29) bits in message (\w+)"
)
_NO_BITS: Final = re.compile(
    r"The signal (\w+) length (-?\d+) is not greater than 0 in message (\w+)"
)
_NO_SIGNAL: Final = re.compile(r"unused (VAL_|SIG_VALTYPE_) entries in DBC:\s+\S+ (\d+) (\w+)")

_RIGHT_SYNTAX: Final = (
    (r"\s*(BO_\s+\d+|SG_)\s*", r"\d", "a name begins with a letter or _"),
    (r".*[(\[|,]", r"-?\.\d", "a number has a digit before its point, as in 0.25"),
    (r"\s*CM_\s+SG_\s+\d+\s*", r'"', "the name of the signal is missing before its comment"),
    (r"\s*CM_\s*", r"\d", "write CM_ BO_ before the identifier of a message"),
    (r"\s*", r".", "correct this line, or the end of the one before it"),
)
"""The remedy by what stands before and behind the place where cantools stops."""


def load_dbc(path: Path) -> "Database":
    """Return the content of a DBC file, read once for each of its versions.

    A file that cannot be read, and a missing extra, raise a `ConfigError`.
    """
    return _load_version(path, path.stat().st_mtime_ns if path.exists() else 0)


@lru_cache(maxsize=4)
def _load_version(path: Path, _changed: int) -> "Database":
    try:
        from cantools.database import load_string  # noqa: PLC0415 - an extra
        from cantools.errors import Error  # noqa: PLC0415
    except ImportError:
        raise ConfigError("dbc needs the extra dbc: pip install 'hil-bench[dbc]'") from None
    with about_file(f"dbc {path}", what="cannot be read", right="give a DBC file"):
        data = path.read_bytes()
    try:
        text = data.decode("utf-8-sig")
    except ValueError:
        text = data.decode("cp1252", errors="replace")  # as the format has it
    logging.getLogger("cantools").setLevel(logging.ERROR)  # it warns of names that occur twice
    try:
        database: Any = load_string(text, database_format="dbc", strict=False)
    except (Error, ValueError, KeyError, TypeError, AttributeError) as error:
        what = f"cannot be read as a DBC file: {_problem(text, error)}"
        raise ConfigError(f"dbc {path}: {what}") from None
    return database  # type: ignore[no-any-return]


def _problem(text: str, error: Exception) -> str:
    """Return the fault of a file, with its line where that is known, and what is right."""
    said = str(error)
    if found := _SYNTAX.search(said):
        line, column, before, behind = found.groups()
        rights = (
            right
            for head, rest, right in _RIGHT_SYNTAX
            if re.fullmatch(head, before) and re.match(rest, behind)
        )
        right = next(rights, "correct this line")
        rest = behind.split("\n")[0].removesuffix('"')[:40]
        return f"line {line}, column {column}: {quote(rest)} does not fit here; {right}"
    if found := _IDENTIFIER.search(said):
        value, name = int(found[1], 16), found[3]
        place = _place(text, rf"BO_\s+\d+\s+{name}\b")
        right = f"0x{_HIGHEST:X} is the highest"
        if found[2] == "11" and value <= _HIGHEST:
            right = f"one of 29 bits has bit 31 set, as {value | _EXTENDED} has"
        return (
            f"{place}{name} has the identifier 0x{value:X}, of more than {found[2]} bits; {right}"
        )
    if found := _NO_BITS.search(said):
        signal, bits, message = found.groups()
        place = _place(text, rf"BO_\s+\d+\s+{message}\b.*?\n\s*SG_\s+{signal}\b")
        return f"{place}{signal} of {message} has {bits} bits; 1 to 64 are right"
    if found := _NO_SIGNAL.search(said):
        keyword, number, signal = found.groups()
        place = _place(text, rf"{keyword}\s+{number}\s+{signal}\b")
        what = f"{keyword} is of the signal {signal}, which no message {number} has"
        return f"{place}{what}; correct its name, or delete the line"
    reason = " ".join(said.split())[:_MOST_OF_REASON]
    if not reason or isinstance(error, KeyError | TypeError | AttributeError):
        reason = f"a line names what no other line has ({type(error).__name__}: {reason})"
    return f"{reason}; save it anew with the tool that made it"


def _place(text: str, pattern: str) -> str:
    """Return the line at the end of what a pattern finds, with its colon; empty for nothing."""
    found = re.search(rf"^\s*{pattern}", text, re.MULTILINE | re.DOTALL)
    return f"line {text[: found.end()].count(chr(10)) + 1}: " if found else ""
