"""EDS files as makers write them, read by canopen.

canopen refuses a file, or fails in it, for deviations from CiA 306 that many real files have. So
the sections are read here, made what canopen takes, and handed to it. What that costs is logged.
"""

import io
import logging
import pickle
import re
from functools import lru_cache
from pathlib import Path
from typing import Final

from canopen.objectdictionary import ObjectDictionary
from canopen.objectdictionary.eds import import_eds

from hil_drivers.errors import EdsError

logger = logging.getLogger(__name__)

Sections = dict[str, dict[str, str]]
"""Keys and values by section, each as canopen spells it."""

_SECTION: Final = re.compile(r"([0-9A-F]{4})(?:SUB([0-9A-F]{1,2}))?", re.IGNORECASE)
_COMMENT: Final = re.compile(r"\s;.*")
_KEYS: Final = {
    key.lower(): key
    for key in (
        "ParameterName",
        "ObjectType",
        "DataType",
        "AccessType",
        "PDOMapping",
        "CompactSubObj",
        "DefaultValue",
        "ParameterValue",
        "LowLimit",
        "HighLimit",
        "Factor",
        "Unit",
        "Description",
        "StorageLocation",
    )
}
_TEXTS: Final = ("VendorName", "ProductName", "OrderCode")
_DOMAIN, _VARIABLE, _ARRAY, _RECORD = 0x2, 0x7, 0x8, 0x9
_NUMBER_OF_ENTRIES: Final = {
    "ParameterName": "Number of entries",
    "ObjectType": "0x7",
    "DataType": "0x5",
    "AccessType": "ro",
}
_ANY_BYTES: Final = 0x0F
_LARGEST_TYPE: Final = 0x1B
_MOST_ENTRIES: Final = 254
_COMMUNICATION: Final = (range(0x1400, 0x1600), range(0x1800, 0x1A00))
_TO_MAPPING: Final = 0x200
_DEVICES_KEPT: Final = 32


def load_eds(path: Path, node_id: int) -> ObjectDictionary:
    """Return the object dictionary that an EDS or DCF describes, COB-IDs for this node-ID.

    Raises:
        EdsError: the file is missing, or is no EDS.
    """
    try:
        text = _decode(path.read_bytes())
    except OSError as error:
        raise EdsError(f"cannot read EDS {path}: {error.strerror}") from error
    sections = _read(text)
    objects = _objects(sections, str(path))
    if not objects:
        raise EdsError(f"{path} is not an EDS file: it has no object such as [1000]")
    lines = [
        line
        for name, keys in (_headers(sections) | objects).items()
        for line in (f"[{name}]", *(f"{key}={value}" for key, value in keys.items() if key))
    ]
    try:
        kept = _imported("\n".join(lines), node_id)
    except Exception as error:  # canopen lets whatever fails in a file pass
        reason = (str(error).splitlines() or [type(error).__name__])[0].strip("'\"")
        raise EdsError(f"{path} cannot be read as an EDS file: {reason}") from error
    dictionary: ObjectDictionary = pickle.loads(kept)  # noqa: S301 - of our own making
    return dictionary


@lru_cache(maxsize=_DEVICES_KEPT)
def _imported(text: str, node_id: int) -> bytes:
    """Return canopen's import of an EDS, pickled, so that each node gets its own copy."""
    return pickle.dumps(import_eds(io.StringIO(text), node_id))  # type: ignore[no-untyped-call]


def _decode(raw: bytes) -> str:
    """Return the text of a file; makers write in any code page."""
    try:
        return raw.decode("utf-16" if raw[:2] in {b"\xff\xfe", b"\xfe\xff"} else "utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def _read(text: str) -> Sections:
    """Return the sections of a file; of what stands twice, the first."""
    sections: Sections = {}
    keys: dict[str, str] = {}
    for raw in re.split(r"\r\n|\r|\n", text):
        line = raw.strip()
        if line.startswith("["):
            name = line[1:].partition("]")[0].strip()
            keys = {}
            sections.setdefault(name.upper(), keys)
        elif "=" in line and line[0] not in ";#":
            key, _, value = _COMMENT.sub("", line).partition("=")
            keys.setdefault(_KEYS.get(key.strip().lower(), key.strip()), value.strip())
    return sections


def _headers(sections: Sections) -> Sections:
    """Return the sections about the device, without the numbers that are none."""
    information = {
        key: value
        for key, value in sections.get("DEVICEINFO", {}).items()
        if key in _TEXTS or _number(value) is not None
    }
    dummies = sections.get("DUMMYUSAGE", {})
    names = [f"Dummy{code:04d}" for code in range(1, 8)]
    usage = {name: "1" if _number(dummies.get(name)) == 1 else "0" for name in names}
    return {"DeviceInfo": information, "DummyUsage": usage}


def _objects(sections: Sections, source: str) -> Sections:
    """Return the sections of objects, as canopen takes them, each object before its entries."""
    objects: dict[int, dict[int, dict[str, str]]] = {}
    heads: dict[int, dict[str, str]] = {}
    for name, keys in sections.items():
        match = _SECTION.fullmatch(name)
        if match is None or (index := int(match[1], 16)) < 0x1000:
            continue
        if match[2] is None:
            heads[index] = keys
        else:
            objects.setdefault(index, {})[int(match[2], 16)] = keys
    for index in objects.keys() | heads.keys():
        objects[index] = objects.get(index, {}) or _compact(index, heads[index], sections)
        _mend_head(index, heads.setdefault(index, {}), has_entries=bool(objects[index]))
        for subindex, keys in objects[index].items():
            _mend_entry(f"{index:04X}sub{subindex:X}", keys, sections, source)
        if not objects[index]:
            _mend_entry(f"{index:04X}", heads[index], sections, source)
    _leave_out_pdos(heads, source)
    written: Sections = {}
    for index in sorted(heads):
        written[f"{index:04X}"] = heads[index]
        for subindex, keys in sorted(objects[index].items()):
            written[f"{index:04X}sub{subindex:X}"] = keys
    return written


def _compact(index: int, head: dict[str, str], sections: Sections) -> dict[int, dict[str, str]]:
    """Return the entries of an object with CompactSubObj, which canopen has for arrays only."""
    count = min(_number(head.pop("CompactSubObj", None)) or 0, _MOST_ENTRIES)
    if count < 1:
        return {}
    names, values = (sections.get(f"{index:04X}{what}", {}) for what in ("NAME", "VALUE"))
    name = head.get("ParameterName", f"{index:04X}")
    is_mapping = any(index - _TO_MAPPING in indices for indices in _COMMUNICATION)
    used = sum(str(number) in values for number in range(1, count + 1)) if is_mapping else count
    entries = {0: dict(_NUMBER_OF_ENTRIES) | {"DefaultValue": str(used)}}
    for subindex in range(1, count + 1):
        key = str(subindex)
        entry = head | {"ObjectType": "0x7"}
        entry["ParameterName"] = names.get(key) or f"{name}_{subindex:x}"
        entry["DefaultValue"] = values.get(key) or head.get("DefaultValue", "")
        entries[subindex] = entry
    return entries


def _mend_head(index: int, head: dict[str, str], *, has_entries: bool) -> None:
    """Give an object the keys without which canopen fails, and a type that its entries fit."""
    head.setdefault("ParameterName", f"{index:04X}")
    kind = _number(head.get("ObjectType"))
    structure = kind if kind in {_ARRAY, _RECORD} else _RECORD
    simple = kind if kind in {_DOMAIN, _VARIABLE} else _VARIABLE
    head["ObjectType"] = str(structure if has_entries else simple)


def _mend_entry(name: str, keys: dict[str, str], sections: Sections, source: str) -> None:
    """Give an entry the keys without which canopen fails."""
    keys.setdefault("ParameterName", name)
    keys.setdefault("AccessType", "rw")
    data_type = _number(keys.get("DataType"))
    if data_type is not None and data_type > _LARGEST_TYPE:
        # CANFestival's editor names a section whose sub-index 1 holds the data type.
        data_type = _number(sections.get(f"{data_type:X}SUB1", {}).get("DefaultValue"))
    if data_type is None or not 1 <= data_type <= _LARGEST_TYPE:
        data_type = _ANY_BYTES
        if _number(keys.get("ObjectType")) != _DOMAIN:
            given = keys.get("DataType", "missing")
            logger.warning("%s: [%s] DataType is %s; any bytes are taken", source, name, given)
    keys["DataType"] = str(data_type)
    keys["PDOMapping"] = "1" if _number(keys.get("PDOMapping")) else "0"


def _leave_out_pdos(heads: dict[int, dict[str, str]], source: str) -> None:
    """Leave out PDOs without a mapping, which no driver can use and canopen fails at."""
    for index in [index for index in heads if any(index in some for some in _COMMUNICATION)]:
        if index + _TO_MAPPING not in heads:
            text = "%s: [%04X] has no mapping [%04X]; the PDO is left out"
            logger.warning(text, source, index, index + _TO_MAPPING)
            del heads[index]


def _number(text: str | None) -> int | None:
    try:
        return int(text or "", 0)
    except ValueError:
        return None
