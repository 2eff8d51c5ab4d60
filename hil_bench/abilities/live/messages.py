"""The messages of the feed: JSON, one object a line, in UTF-8. See docs/watching.md.

A request comes from outside and is hostile until `parse_request` has checked it: its size, its
syntax, its action, and the name and type of each field.
"""

import json
import math
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, NamedTuple, NoReturn

from hil_bench.ability import given_to
from hil_bench.errors import BusError, ConfigError, ControllerError, printable

VERSION = 1
"""Version of the messages; it changes where a reader of the one before would err."""

MOST_REQUEST = 1 << 16
"""Longest request [byte]."""

ROW, FRAMES, STATE, HEALTH, ANSWER, EVENT, ACTED = range(1, 8)
"""Kinds of messages from the loop to the server."""

WANTS, COMMAND = range(1, 3)
"""Kinds of messages from the server to the loop."""

WANTS_STATE, WANTS_ROWS, WANTS_FRAMES = 1, 2, 4
"""What clients want, as bits of a byte."""

MOST_MARK = 200
"""Longest text of a mark [character]."""

_MOST_TEXT = 80  # of a wrong value that a message repeats


class RequestError(ConfigError):
    """A request is wrong.

    Args:
        number: its number; None where it has none.
        text: what is wrong, and what would be right.
    """

    def __init__(self, number: int | None, text: str) -> None:
        super().__init__(text)
        self.number = number


class Request(NamedTuple):
    """A checked request.

    Attributes:
        number: the client's own, which the answer repeats.
        action: what is to be done.
        fields: its arguments.
    """

    number: int
    action: str
    fields: dict[str, Any]


class Field(NamedTuple):
    """A field of a request.

    Attributes:
        fits: whether a value is right.
        right: what would be right.
        is_needed: whether it must be given.
    """

    fits: Callable[[object], bool]
    right: str
    is_needed: bool = True


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _is_mark(value: object) -> bool:
    return isinstance(value, str) and 0 < len(value) <= MOST_MARK


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    return abs(value) < 1e300 if isinstance(value, int) else math.isfinite(value)


def _is_scalar(value: object) -> bool:
    return value is None or isinstance(value, (str, bool)) or _is_number(value)


def _is_value(value: object) -> bool:
    """Return True if an object may hold it: bytes are ``{"hex": "00ff"}``."""
    if isinstance(value, dict):
        try:
            return list(value) == ["hex"] and bytes.fromhex(value["hex"]) is not None
        except (TypeError, ValueError):
            return False
    return value is not None and _is_scalar(value)


def _is_table(value: object) -> bool:
    return isinstance(value, dict) and all(map(_is_scalar, value.values()))


def _is_interval(value: object) -> bool:
    return value is None or (_is_number(value) and value >= 0)  # type: ignore[operator]


Actions = Mapping[str, Mapping[str, Field]]
"""What may be asked for, with its fields."""


class AddedAction(NamedTuple):
    """Something that an ability lets people ask for; it acts at the start of a tick.

    Attributes:
        fields: of the request.
        command: ``module:name`` of what makes the command of these fields, by name.
        answer: the name of its answer in the journal; empty where that has none.
        part: ``module:class`` of the part of the feed that begins it in place of a command: it
            takes longer than a tick, and is not in the journal.
        patience: longest wait for its answer where that is longer than others [s].
    """

    fields: Mapping[str, Field]
    command: str = ""
    answer: str = ""
    part: str = ""
    patience: float = 0.0


@cache
def added_actions() -> Mapping[str, AddedAction]:
    """Return the actions that abilities add."""
    return {name: action for each in given_to("feed") for name, action in each.ACTIONS.items()}


TEXT = Field(_is_text, "a text")
TABLE = Field(_is_table, "a table of numbers and texts")
SWITCH = Field(lambda value: isinstance(value, bool), "true or false")
NUMBER = Field(_is_number, "a number")

_ACTIONS: Actions = {
    "status": {},
    "watch": {
        "rows_every_s": Field(_is_interval, "seconds, 0 for every tick, or null", is_needed=False),
        "frames": SWITCH._replace(is_needed=False),
    },
    "get_object": {"node": TEXT, "name": TEXT},
    "set_object": {
        "node": TEXT,
        "name": TEXT,
        "value": Field(_is_value, 'a number, a text, true, false or {"hex": "00ff"}'),
    },
    "set_plant": {
        "axis": TEXT,
        "quantity": TEXT,
        "value": NUMBER._replace(right="a number in SI"),
    },
    "histograms": {},
    "journal": {},
    "mark": {"text": Field(_is_mark, f"a text of up to {MOST_MARK} characters")},
    "stop": {},
}


def patience(action: str, usual: float) -> float:
    """Return the longest wait for the answer to an action, at least the usual one [s]."""
    added = added_actions().get(action)
    return usual if added is None else max(usual, added.patience)


@cache
def known_actions() -> Actions:
    """Return all that may be asked for, with its fields."""
    added = {name: action.fields for name, action in added_actions().items()}
    first = {name: _ACTIONS[name] for name in ("status", "watch")}
    return {**first, **added, **_ACTIONS}


def parse_request(line: bytes, actions: Actions | None = None) -> Request:
    """Return the request of a line.

    Args:
        line: as it came.
        actions: what may be asked for; without it, what a bench may be.

    Raises:
        RequestError: it is wrong; its text says what would be right.
    """
    actions = known_actions() if actions is None else actions
    content = _load(line)
    number = content.pop("id", None)
    if isinstance(number, bool) or not isinstance(number, int) or abs(number) >= 1 << 63:
        raise RequestError(None, f"id = {_shown(number)}: give an integer")
    action = content.pop("do", None)
    if not isinstance(action, str) or action not in actions:
        raise RequestError(number, f"do = {_shown(action)}: give one of {', '.join(actions)}")
    known = actions[action]
    for name, value in content.items():
        if name not in known:
            right = f"give {', '.join(known)}" if known else "it takes none"
            raise RequestError(number, f"{action}: unknown field {_shown(name)}; {right}")
        if not known[name].fits(value):
            wrong = f"{action}: {name} = {_shown(value)}"
            raise RequestError(number, f"{wrong}; give {known[name].right}")
    for name, field in known.items():
        if field.is_needed and name not in content:
            raise RequestError(number, f"{action}: {name} is missing; give {field.right}")
    return Request(number, action, content)


def encode(message: Mapping[str, object]) -> bytes:
    """Return a message as a line; `ValueError` or `TypeError` where JSON cannot have it."""
    # In ASCII, for texts from outside may have lone surrogates, which UTF-8 cannot have.
    return json.dumps(message, separators=(",", ":"), allow_nan=False).encode() + b"\n"


def number_text(value: float) -> str:
    """Return a number as JSON has it; null where it is none."""
    return repr(value) if math.isfinite(value) else "null"


def pack_value(value: object) -> object:
    """Return the value of an object in a form that JSON supports."""
    if isinstance(value, bytes):
        return {"hex": value.hex()}
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def unpack_value(value: object) -> Any:  # noqa: ANN401 - what an object may hold
    """Return the value of an object from the form that `pack_value` makes."""
    return bytes.fromhex(value["hex"]) if isinstance(value, dict) else value


def _load(line: bytes) -> dict[str, Any]:
    try:
        content = json.loads(line, parse_constant=_refuse_constant)
    except (ValueError, RecursionError):
        raise RequestError(None, f"{_shown(line)} is not JSON in UTF-8") from None
    if not isinstance(content, dict):
        raise RequestError(None, f"{_shown(content)} is not a JSON object")
    return content


def _refuse_constant(name: str) -> NoReturn:
    """Refuse NaN and Infinity, which are not JSON.

    Raises:
        ValueError: always.
    """
    raise ValueError(name)


def _shown(value: object) -> str:
    text = ascii(value)
    return text if len(text) <= _MOST_TEXT else f"{text[:_MOST_TEXT]}..."


def check_version(bench: str, hello: Mapping[str, Any]) -> None:
    """Refuse a bench that speaks another version.

    Args:
        bench: its name.
        hello: its greeting.

    Raises:
        BusError: it does.
    """
    if hello.get("version") != VERSION:
        wrong = (
            f"speaks version {hello.get('version')} of the feed, and this program version {VERSION}"
        )
        raise BusError(f"bench {bench}: {wrong}; use the same version of hil-bench for both")


def value_of(answer: Mapping[str, Any]) -> Any:  # noqa: ANN401 - what a bench answers
    """Return the value in a bench's answer to a request.

    `ConfigError`: the request is wrong. `ControllerError`: the bench cannot do it.
    """
    if "error" in answer:
        kind = ConfigError if answer.get("kind") == "usage" else ControllerError
        raise kind(printable(str(answer["error"])))
    return answer.get("value")
