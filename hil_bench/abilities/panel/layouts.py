"""Layouts of the page: `NAME.layout.toml` beside the bench's file, read, checked and written."""

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from hil_bench.abilities.common.files import whole_file
from hil_bench.config.document import Sort, read_document
from hil_bench.config.values import find_nearest
from hil_bench.errors import ConfigError, about_file

SUFFIX: Final = ".layout.toml"
COLUMNS: Final = 12
"""Of the grid."""

MOST_ITEMS: Final = 64
_MOST_ROWS, _TALLEST = 200, 40
_MOST_CHANNELS = 16
_LONGEST_TEXT = 400
_MOST_LISTED = 100
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,60}")

Check = Callable[[object], bool]


def _is_text(value: object) -> bool:
    return isinstance(value, str) and len(value) <= _LONGEST_TEXT and value.isprintable()


def _is_name(value: object) -> bool:
    return _is_text(value) and value != ""


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return math.isfinite(value) and abs(value) < 1e300


def _is_names(value: object) -> bool:
    return (
        isinstance(value, list)
        and 0 < len(value) <= _MOST_CHANNELS
        and all(isinstance(each, str) and _is_name(each) for each in value)
    )


def _is_seconds(value: object) -> bool:
    return _is_number(value) and 0.1 <= value <= 120.0  # type: ignore[operator]  # a number


def _is_keys(value: object) -> bool:
    return isinstance(value, dict) and all(
        _is_name(key) and (_is_text(each) or _is_number(each)) for key, each in value.items()
    )


_RIGHT: Mapping[Check, str] = {
    _is_text: f"a text of up to {_LONGEST_TEXT} printable characters",
    _is_name: "a name",
    _is_number: "a finite number",
    _is_names: f"a list of 1 to {_MOST_CHANNELS} names",
    _is_seconds: "0.1 to 120",
    _is_keys: "a table of numbers and texts",
}
_NEEDED: Mapping[str, Mapping[str, Check]] = {
    "bus": {},
    "button": {"text": _is_name, "fault": _is_name, "target": _is_name},
    "gauge": {"channel": _is_name, "low_si": _is_number, "high_si": _is_number},
    "machine": {"axis": _is_name},
    "plot": {"channels": _is_names},
    "slider": {
        "axis": _is_name,
        "quantity": _is_name,
        "low_si": _is_number,
        "high_si": _is_number,
    },
    "text": {"text": _is_text},
    "value": {"channel": _is_name},
    "verdicts": {},
}
"""The kinds of items, with the keys that each must have."""
_OPTIONAL: Mapping[str, Mapping[str, Check]] = {
    "button": {"keys": _is_keys},
    "plot": {"seconds": _is_seconds},
}
_PLACES: Mapping[str, int] = {
    "column": COLUMNS,
    "row": _MOST_ROWS,
    "width": COLUMNS,
    "height": _TALLEST,
}


def check_layout(content: Mapping[str, object], place: str) -> dict[str, Any]:
    """Return a layout whose keys and values are right; what it names may still be missing.

    Args:
        content: of the file, or of a page.
        place: how the message names it.

    Raises:
        ConfigError: it says which item, what is wrong and what would be right.
    """
    _refuse_unknown(place, content, ("title", "bench", "items"))
    for key in ("title", "bench"):
        if not _is_text(content.get(key, "")):
            raise ConfigError(f"{place}: {key}: give {_RIGHT[_is_text]}")
    items = content.get("items", [])
    if not isinstance(items, list) or len(items) > MOST_ITEMS:
        raise ConfigError(f"{place}: items: give [[items]], at most {MOST_ITEMS} of them")
    checked = [_check_item(item, f"{place}: item {n}") for n, item in enumerate(items, 1)]
    return {"title": content.get("title", ""), "bench": content.get("bench", ""), "items": checked}


def _check_item(item: object, place: str) -> dict[str, Any]:
    if not isinstance(item, dict):
        raise ConfigError(f"{place}: give a table [[items]]")
    kind = item.get("kind")
    if not isinstance(kind, str) or kind not in _NEEDED:
        raise ConfigError(f"{place}: kind {kind!a}: give one of {', '.join(_NEEDED)}")
    needed, optional = _NEEDED[kind], _OPTIONAL.get(kind, {})
    _refuse_unknown(place, item, ("kind", *_PLACES, *needed, *optional))
    for key, most in _PLACES.items():
        value = item.get(key)
        if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= most:
            raise ConfigError(f"{place}: {key}: give 1 to {most}")
    if item["column"] + item["width"] - 1 > COLUMNS:
        raise ConfigError(f"{place}: ends beyond column {COLUMNS}; make it narrower")
    for key, check in {**needed, **optional}.items():
        if (key in needed or key in item) and not check(item.get(key)):
            raise ConfigError(f"{place}: {key}: give {_RIGHT[check]}")
    if "low_si" in needed and item["low_si"] >= item["high_si"]:
        raise ConfigError(f"{place}: low_si: give less than high_si")
    return item


def _refuse_unknown(place: str, table: Mapping[str, object], known: tuple[str, ...]) -> None:
    for key in table:
        if key not in known:
            near = find_nearest(key, known)
            right = f"did you mean {near}?" if near else f"give {', '.join(known)}"
            raise ConfigError(f"{place}: key {key!a} is not known; {right}")


def read_layout(path: Path) -> dict[str, Any]:
    """Return the layout of a file; `ConfigError` where it cannot be read or is wrong."""
    return check_layout(read_document(path, Sort.LAYOUT), str(path))


def list_layouts(folder: Path) -> list[str]:
    """Return the names of the layouts in a folder, sorted."""
    try:
        names = sorted(
            path.name.removesuffix(SUFFIX) for path in folder.iterdir() if path.match(f"*{SUFFIX}")
        )
    except OSError:
        return []
    return names[:_MOST_LISTED]


def path_of(name: str, folder: Path) -> Path:
    """Return the path of a layout in a folder.

    Raises:
        ConfigError: such a name could leave the folder.
    """
    if not _NAME.fullmatch(name):
        raise ConfigError(f"layout {name!a}: give up to 61 letters, digits, _ or -")
    return folder / f"{name}{SUFFIX}"


def write_layout(layout: Mapping[str, Any], path: Path, *, replaces: bool) -> None:
    """Write a checked layout; errors are those of `write_named`."""
    text = "".join(f"{line}\n" for line in _lines(layout))
    write_named(path, text, replaces=replaces)


def write_named(path: Path, text: str, *, replaces: bool) -> None:
    """Write a file under a name that a page gives; what is there stays until the new one is whole.

    Raises:
        ConfigError: a file of this name is there, or it cannot be written.
    """
    if path.exists() and not replaces:
        raise ConfigError(f"{path} is there already; give another name, or replace it")
    with about_file(path), whole_file(path, replaces=True) as file:
        file.write_text(text, encoding="utf-8")


def _lines(layout: Mapping[str, Any]) -> Iterator[str]:
    for key in ("title", "bench"):
        if layout[key]:
            yield f"{key} = {_toml(layout[key])}"
    for item in layout["items"]:
        yield ""
        yield "[[items]]"
        for key, value in item.items():
            yield f"{key} = {_toml(value)}"


def _toml(value: object) -> str:
    """Return a checked value as TOML; JSON writes printable texts and numbers alike."""
    if isinstance(value, dict):
        pairs = (f"{_toml(key)} = {_toml(each)}" for key, each in value.items())
        return f"{{ {', '.join(pairs)} }}" if value else "{}"
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    return json.dumps(value, ensure_ascii=False)
