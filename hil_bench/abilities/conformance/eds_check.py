"""Check of an EDS file, line by line (CiA 306), beyond the checks of loaders; `check-eds`.

>>> for finding in check_eds(Path("vendor.eds")):
...     print(finding)
"""

import argparse
import json
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from hil_bench.canopen_device.eds import build_objects, find_refusal, read_eds
from hil_bench.canopen_device.eds_document import (
    OBJECT_LISTS,
    Document,
    EdsFinding,
    Section,
    Severity,
    listed_indices,
    parse_document,
    parse_integer,
)
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.results import add_json_argument, print_lines

# Checks of the EDS header: FileInfo, DeviceInfo, DummyUsage (CiA 306).

_TIME: Final = re.compile(r"(0[1-9]|1[0-2]):[0-5][0-9](AM|PM)")
_DATE: Final = re.compile(r"(0[1-9]|1[0-2])-(0[1-9]|[12][0-9]|3[01])-[0-9]{4}")
_BIT_RATES: Final = (10, 20, 50, 125, 250, 500, 800, 1000)
_FLAGS: Final = (
    *(f"BaudRate_{rate}" for rate in _BIT_RATES),
    "SimpleBootUpMaster",
    "SimpleBootUpSlave",
    "DynamicChannelsSupported",
    "LSS_Supported",
)
_PDO_COUNTS: Final = {"NrOfRXPDO": range(0x1400, 0x1600), "NrOfTXPDO": range(0x1800, 0x1A00)}
_MISSPELT: Final = {"devicecommissioning": "DeviceComissioning, with one m, is CiA 306's spelling"}


def check_header(document: Document) -> Iterator[EdsFinding]:
    """Yield what is wrong in the sections that are no objects and no lists of them."""
    for name, check in (
        ("FileInfo", _check_file_info),
        ("DeviceInfo", _check_device_info),
        ("DummyUsage", _check_dummy_usage),
    ):
        section = document.section(name)
        if section is None:
            yield EdsFinding(1, name, "the section is missing; CiA 306 asks for it")
        else:
            yield from check(section)
    device = document.section("DeviceInfo")
    if device is not None:
        yield from _check_pdo_counts(document, device)
    for wrong, right in _MISSPELT.items():
        if (section := document.section(wrong)) is not None:
            yield EdsFinding(section.line, section.name, right)


def _check_file_info(section: Section) -> Iterator[EdsFinding]:
    for key in ("FileName", "CreatedBy", "Description"):
        if section.text(key) is None:
            yield section.finding(key, "is missing; any text is right")
    yield from _check_numbers(section, ("FileVersion", "FileRevision"), range(256))
    if section.text("EDSVersion") not in {"3.0", "4.0"}:
        yield section.finding("EDSVersion", f"is {section.text('EDSVersion')}; 4.0 is right")
    for event in ("Creation", "Modification"):
        yield from _check_form(section, f"{event}Time", _TIME, "hh:mmAM or hh:mmPM")
        yield from _check_form(section, f"{event}Date", _DATE, "mm-dd-yyyy")


def _check_form(
    section: Section, key: str, form: re.Pattern[str], right: str
) -> Iterator[EdsFinding]:
    text = section.text(key)
    if text is None and key.startswith("Creation"):
        yield section.finding(key, f"is missing; {right} is right")
    elif text is not None and not form.fullmatch(text):
        yield section.finding(key, f"is {text}; {right} is right")


def _check_device_info(section: Section) -> Iterator[EdsFinding]:
    for key in ("VendorName", "ProductName"):
        if section.text(key) is None:
            yield section.finding(key, "is missing; any text is right")
    for key in ("VendorNumber", "ProductNumber", "RevisionNumber"):
        yield from _check_numbers(section, (key,), range(1 << 32))
    yield from _check_numbers(section, _FLAGS, range(2))
    yield from _check_numbers(section, ("Granularity",), range(65))
    if not any(section.text(f"BaudRate_{rate}") not in {None, "0"} for rate in _BIT_RATES):
        yield EdsFinding(section.line, section.name, "no BaudRate_... is 1; one at least is right")


def _check_dummy_usage(section: Section) -> Iterator[EdsFinding]:
    keys = tuple(f"Dummy{code:04d}" for code in range(1, 8))
    yield from _check_numbers(section, keys, range(2))


def _check_pdo_counts(document: Document, section: Section) -> Iterator[EdsFinding]:
    for key, parameters in _PDO_COUNTS.items():
        there = sum(index in parameters for index in document.objects)
        text = section.text(key)
        if _number(text) != there:
            first = f"0x{parameters.start:04X}"
            yield section.finding(
                key, f"is {text}; {there} is right by the objects from {first} on"
            )


def _check_numbers(section: Section, keys: tuple[str, ...], allowed: range) -> Iterator[EdsFinding]:
    for key in keys:
        text = section.text(key)
        number = _number(text)
        if number is None or number not in allowed:
            said = "is missing" if text is None else f"is {text}"
            yield section.finding(key, f"{said}; {allowed.start} to {allowed.stop - 1} is right")


def _number(text: str | None) -> int | None:
    try:
        return parse_integer(text or "")
    except ValueError:
        return None


# The lists of objects: complete, counted, each object in one of them (CiA 306).

_MANDATORY: Final = (0x1000, 0x1001, 0x1018)
_MANUFACTURER: Final = range(0x2000, 0x6000)


def check_lists(document: Document) -> Iterator[EdsFinding]:
    """Yield what is wrong between the lists and the objects' sections."""
    listed: dict[int, str] = {}
    for name in OBJECT_LISTS:
        section = document.section(name)
        if section is None:
            yield EdsFinding(1, name, "the section is missing; CiA 306 asks for it")
            continue
        yield from _check_count(section)
        for index, key in listed_indices(section):
            yield from _check_place(section, key, index, listed)
            listed.setdefault(index, section.name)
    mandatory = document.section(OBJECT_LISTS[0])
    if mandatory is not None:
        yield from _check_mandatory(mandatory, listed)
    for index, section in document.objects.items():
        if index not in listed:
            yield EdsFinding(section.line, section.name, "is in no list of objects; one is right")


def _check_count(section: Section) -> Iterator[EdsFinding]:
    keys = [key for key in section.entries if key.isdecimal()]
    text = section.text("SupportedObjects")
    if text is None or not text.isdecimal() or int(text) != len(keys):
        yield section.finding(
            "SupportedObjects", f"is {text}; {len(keys)} is right by what follows"
        )
    for expected, key in enumerate(keys, start=1):
        if int(key) != expected:
            yield section.finding(key, f"stands where {expected} is right: they count on from 1")
            return


def _check_place(
    section: Section, key: str, index: int, listed: dict[int, str]
) -> Iterator[EdsFinding]:
    """Yield what is wrong with one line of a list."""
    if not 0x1000 <= index <= 0xFFFF:
        yield section.finding(key, f"is {section.text(key)}; an index such as 0x1000 is right")
        return
    if index in listed:
        yield section.finding(key, f"0x{index:04X} is in [{listed[index]}] already; once is right")
    is_manufacturers = index in _MANUFACTURER
    if is_manufacturers != (section.name.lower() == OBJECT_LISTS[2].lower()):
        right = OBJECT_LISTS[2] if is_manufacturers else f"{OBJECT_LISTS[0]} or {OBJECT_LISTS[1]}"
        yield section.finding(key, f"0x{index:04X} belongs to {right}")


def _check_mandatory(section: Section, listed: dict[int, str]) -> Iterator[EdsFinding]:
    for index in _MANDATORY:
        if listed.get(index) != section.name:
            text = f"0x{index:04X} is not listed; CiA 301 has it in every device"
            yield EdsFinding(section.line, section.name, text)


# Checks of an object's section by CiA 306 that no loader makes.

_STRUCTURES: Final = (0x8, 0x9)
_VALUES: Final = ("LowLimit", "HighLimit", "DefaultValue", "ParameterValue")


def check_objects(document: Document) -> Iterator[EdsFinding]:
    """Yield what is wrong with the objects and their sub-indexes."""
    for index, section in document.objects.items():
        subs = document.sub_objects.get(index, {})
        yield from _check_sub_number(section, len(subs))
        for described in (section, *subs.values()):
            yield from _check_operands(described)


def _check_sub_number(section: Section, there: int) -> Iterator[EdsFinding]:
    """Yield a SubNumber that is not the number of sections."""
    if _number(section.text("ObjectType")) not in _STRUCTURES:
        return
    stated = section.text("SubNumber")
    if section.text("CompactSubObj") is None and _number(stated) != there:
        found = "missing" if stated is None else stated
        text = f"is {found}; {there} is right by the sections [{section.name}sub...]"
        yield section.finding("SubNumber", text)


def _check_operands(section: Section) -> Iterator[EdsFinding]:
    for key in _VALUES:
        text = section.text(key)
        if text and "$NODEID" in text.upper() and not text.upper().startswith("$NODEID"):
            yield section.finding(key, f"is {text}; $NODEID as the first operand is right")


# All checks of one file.

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


# The verb.

_EXAMPLES = """\
examples:
  hil-bench check-eds vendor.eds
  hil-bench check-eds *.eds --strict
  hil-bench check-eds *.eds --json

An error does not work: a value beyond its limit, a PDO of wrong length, an object that is missing.
A warning deviates from CiA 306, and works.

exit code 1 where a file has errors, with --strict also where it has warnings
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "check-eds",
        description="Check EDS files (CiA 306) more strictly than loaders do: lists and counts, "
        "formats,\ndata types, limits and defaults, PDO mappings with their targets and lengths.",
        epilog=_EXAMPLES,
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="EDS file")
    parser.add_argument("--strict", action="store_true", help="count warnings as errors")
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Check all files and print what was found."""
    found = {str(path): check_eds(path) for path in args.files}
    if args.json:
        content = {path: [finding._asdict() for finding in some] for path, some in found.items()}
        print(json.dumps(content))  # noqa: T201 - a verb's output
    else:
        for path, findings in found.items():
            print_lines(args, *(f"{path}:{f}" for f in findings), f"{path}: {_summary(findings)}")
    fails = any(
        args.strict or finding.severity is Severity.ERROR
        for findings in found.values()
        for finding in findings
    )
    return ExitCode.CHECK_FAILED if fails else ExitCode.DONE


def _summary(findings: Sequence[EdsFinding]) -> str:
    if not findings:
        return "ok"
    counts = Counter(finding.severity for finding in findings)
    errors, warnings = counts[Severity.ERROR], counts[Severity.WARNING]
    return f"{_count(errors, 'error')}; {_count(warnings, 'warning')}"


def _count(count: int, what: str) -> str:
    return f"{count or 'no'} {what}{'' if count == 1 else 's'}"
