"""All checks of one file."""

from pathlib import Path

from hil_bench.eds_check.document import Finding, parse_document
from hil_bench.eds_check.header import check_header
from hil_bench.eds_check.object_lists import check_lists
from hil_bench.eds_check.objects import check_objects
from hil_bench.eds_check.pdos import check_pdos
from hil_bench.errors import ConfigError

LARGEST_FILE = 8 * 1024 * 1024
"""Longest file that is read [byte]; real ones are below a megabyte."""

_CHECKS = (check_header, check_lists, check_objects, check_pdos)


def check_eds(path: Path) -> list[Finding]:
    """Return what is wrong in an EDS file, in the order of its lines.

    Raises:
        ConfigError: the file cannot be read, or is too long to be an EDS.
    """
    try:
        with path.open("rb") as file:
            raw = file.read(LARGEST_FILE + 1)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}; give an EDS file") from None
    if len(raw) > LARGEST_FILE:
        raise ConfigError(f"{path}: is longer than {LARGEST_FILE} bytes; give an EDS file")
    # Latin-1 gives every byte a character: makers write their umlauts in any code page.
    document = parse_document(raw.decode("latin-1"))
    findings = list(document.findings)
    for check in _CHECKS:
        findings += check(document)
    return sorted(findings, key=lambda finding: finding.line)
