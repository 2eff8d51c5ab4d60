"""Checks of the EDS header: FileInfo, DeviceInfo, DummyUsage (CiA 306)."""

import re
from collections.abc import Iterator
from typing import Final

from hil_bench.canopen_device.eds_document import Document, EdsFinding, Section, parse_integer

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
        if text is None or _number(text) != there:
            first = f"0x{parameters.start:04X}"
            yield section.finding(
                key, f"is {text}; {there} is right by the objects from {first} on"
            )


def _check_numbers(section: Section, keys: tuple[str, ...], allowed: range) -> Iterator[EdsFinding]:
    for key in keys:
        text = section.text(key)
        number = None if text is None else _number(text)
        if number is None or number not in allowed:
            said = "is missing" if text is None else f"is {text}"
            yield section.finding(key, f"{said}; {allowed.start} to {allowed.stop - 1} is right")


def _number(text: str) -> int | None:
    try:
        return parse_integer(text)
    except ValueError:
        return None
