"""All checks of one file."""

from pathlib import Path
from typing import Final

from hil_bench.abilities.conformance.eds_check.header import check_header
from hil_bench.abilities.conformance.eds_check.object_lists import check_lists
from hil_bench.abilities.conformance.eds_check.objects import check_objects
from hil_bench.canopen_device.eds import build_objects, find_refusal, read_eds
from hil_bench.canopen_device.eds_document import EdsFinding, Severity, parse_document

_CHECKS = (check_header, check_lists, check_objects)
_ANY_NODE_ID: Final = 1


def check_eds(path: Path) -> list[EdsFinding]:
    """Return the findings on an EDS file, in the order of its lines.

    What does not work on the bench is an error: the findings of the loader are among these.
    `EdsError` where the file cannot be read, or is too long to be an EDS.
    """
    text = read_eds(path)
    document = parse_document(text)
    refusal = find_refusal(document, text)
    if refusal is not None:
        return [EdsFinding(1, "", refusal, Severity.ERROR)]
    findings = [*build_objects(document, _ANY_NODE_ID, str(path)).findings]
    for check in _CHECKS:
        findings += check(document)
    return sorted(findings, key=lambda finding: finding.line)
