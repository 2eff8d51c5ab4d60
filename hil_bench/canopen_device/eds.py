"""EDS files (CiA 306) to object dictionaries.

Real EDS files deviate from CiA 306. What is wrong in one costs no more than the limit, the text,
the default or the PDO that it concerns, and is told as a finding with its line and what follows.
Refused is only what is no EDS at all. Parameter values of a DCF take the place of the EDS defaults.
"""

import codecs
from functools import lru_cache
from pathlib import Path
from typing import Final

from hil_bench.canopen_device.eds_document import Document, EdsFinding, parse_document
from hil_bench.canopen_device.eds_objects import add_mandatory, read_objects, settle_pdos
from hil_bench.canopen_device.errors import EdsError
from hil_bench.canopen_device.nmt import UNCONFIGURED
from hil_bench.canopen_device.object_dictionary import ObjectDictionary

LARGEST_FILE: Final = 8 * 1024 * 1024
"""Longest file that is read [byte]; real ones are below a megabyte."""

_HIGHEST_NODE_ID: Final = 127
_FILES_KEPT: Final = 8
_DEVICES_KEPT: Final = 128
_HEADERS: Final = ("FileInfo", "DeviceInfo", "MandatoryObjects")
_RIGHT: Final = "give the EDS file (CiA 306) of the device"


def load_eds(path: Path, node_id: int) -> ObjectDictionary:
    """Return the object dictionary of the EDS or DCF at `path`, for the device `node_id`.

    Its `findings` tell what is wrong in the file, and what the device has in its place.

    For a device without node-ID (255) the defaults are those of node-ID 127, until
    `ObjectDictionary.assign_node_id` tells its own.

    Raises:
        EdsError: the file is no EDS, or the node-ID is not 1 to 127 or 255; one line that names
            the file, what is wrong and what would be right.
    """
    if node_id == UNCONFIGURED:
        node_id = _HIGHEST_NODE_ID
    if not 1 <= node_id <= _HIGHEST_NODE_ID:
        raise EdsError(
            f"{path}: node-ID {node_id} is not possible; write 1 to 127, or 255 for none"
        )
    text, source = read_eds(path), str(path)
    parse_eds(text, source)
    return _template(text, node_id).copy(source)


def read_eds(path: Path) -> str:
    """Return the text of the file at `path`.

    Raises:
        EdsError: it cannot be read, or is too long.
    """
    try:
        with path.open("rb") as file:
            raw = file.read(LARGEST_FILE + 1)
    except OSError as error:
        raise EdsError(f"{path}: {error.strerror or error}; name an EDS file that exists") from None
    if len(raw) > LARGEST_FILE:
        raise EdsError(f"{path}: is longer than {LARGEST_FILE} bytes; {_RIGHT}")
    return _decode(raw)


def parse_eds(text: str, source: str) -> Document:
    """Return the sections of an EDS or DCF.

    Raises:
        EdsError: it is no EDS.
    """
    document = _parse(text)
    refusal = find_refusal(document, text)
    if refusal is not None:
        raise EdsError(f"{source}: {refusal}")
    return document


def find_refusal(document: Document, text: str) -> str | None:
    """Return why a text of these sections is no EDS and what is right, None where it is one."""
    if text.lstrip().startswith("<?xml"):
        return f"is XML, as an XDD file is; {_RIGHT}"
    if not document.objects:
        return f"is no EDS file, it has no object such as [1000]; {_RIGHT}"
    if not any(document.section(name) for name in _HEADERS):
        headers = " nor ".join(f"[{name}]" for name in _HEADERS)
        return f"is no EDS file, it has neither {headers}; {_RIGHT}"
    return None


def build_objects(document: Document, node_id: int, source: str) -> ObjectDictionary:
    """Return the object dictionary that an EDS describes, for the device `node_id`."""
    findings: list[EdsFinding] = [*document.findings]
    object_dictionary = ObjectDictionary(read_objects(document, node_id, findings), source=source)
    add_mandatory(document, object_dictionary, findings)
    settle_pdos(document, object_dictionary, findings)
    information = document.section("DeviceInfo")
    claim = information.text("LSS_Supported") if information else None
    object_dictionary.claims_lss = claim not in {None, "0", "0x0"}
    object_dictionary.findings = tuple(sorted(dict.fromkeys(findings), key=_line))
    return object_dictionary


def _line(finding: EdsFinding) -> int:
    return finding.line


def _decode(raw: bytes) -> str:
    """Return the text of a file; makers write in any code page."""
    if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return raw.decode("utf-16", errors="replace")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


@lru_cache(maxsize=_FILES_KEPT)
def _parse(text: str) -> Document:
    """Return the sections of an EDS, kept for devices of the same kind; nobody changes them."""
    return parse_document(text)


@lru_cache(maxsize=_DEVICES_KEPT)
def _template(text: str, node_id: int) -> ObjectDictionary:
    """Return the objects of a device, kept for the next bench that has it; nobody changes them."""
    return build_objects(_parse(text), node_id, "")
