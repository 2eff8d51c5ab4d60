"""Signals of J1939 devices by their names in a DBC file.

``x = { message = "BJM1", signal = "JoystickX" }`` stands for the parameter group, the place, the
scaling, the unit, the period and the SPN that the file has for it.
"""

from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hil_bench.abilities.j1939.protocol.signals import split
from hil_bench.config.values import describe, find_nearest, quote
from hil_bench.errors import ConfigError, about_file

if TYPE_CHECKING:
    from cantools.database.can import Database, Message, Signal

MESSAGE, SIGNAL = "message", "signal"

_PLACE: Final = ("pgn", "start_bit", "length", "resolution", "offset")
_OF_GROUP: Final = ("rate_ms", "priority")
_MOST_OF_REASON: Final = 200
"""Characters of what the reader of DBC files says of one that it cannot read."""

_LENGTHS: Final = range(2, 33)


def is_named(given: Mapping[str, object]) -> bool:
    """Return True if a signal is given by its name in a DBC file."""
    return MESSAGE in given or SIGNAL in given


def look_up(path: Path | None, name: str, signals: Mapping[str, Any]) -> dict[str, object]:
    """Return the keys of a signal with those that a DBC file has for it; the table's own win.

    Args:
        path: the file; None where the device has none.
        name: of the signal, which is its name in the file too unless `signal` gives that.
        signals: the keys of all signals of the device: one of a message may give its period.

    Raises:
        ConfigError: the file cannot be read, it has no such signal, or one that J1939 has not.
    """
    if path is None:
        raise ConfigError(
            'is named by message, but the device has no DBC; give it dbc = "FILE.dbc"'
        )
    given = signals[name]
    for key in _PLACE:
        if key in given:
            raise ConfigError(f"{key} comes from the DBC by {MESSAGE}; give one of the two")
    message = _find_message(load_dbc(path), given)
    signal = _find_signal(message, name, given)
    own = {key: value for key, value in given.items() if key not in {MESSAGE, SIGNAL}}
    found = {**dict(_place(message, signal)), **dict(_timing(message, signal, own))}
    others = [each for each in signals.values() if isinstance(each, dict)]
    for key in _OF_GROUP:
        if any(each.get(MESSAGE) == message.name and key in each for each in others):
            found.pop(key, None)
    return {**found, **own}


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
    try:
        database: Any = load_string(text, database_format="dbc", strict=False)
    except (Error, ValueError, KeyError, TypeError, AttributeError) as error:
        reason = " ".join(str(error).split())[:_MOST_OF_REASON] or type(error).__name__
        raise ConfigError(f"dbc {path}: cannot be read as a DBC file: {reason}") from None
    return database  # type: ignore[no-any-return]


def _find_message(database: "Database", given: Mapping[str, object]) -> "Message":
    wanted = given.get(MESSAGE)
    names = [message.name for message in database.messages]
    if wanted is None:
        raise ConfigError(f'{MESSAGE} is missing; give the name of a message, as "BJM1"')
    if wanted not in names:
        near = f"the nearest is {find_nearest(str(wanted), names)}" if names else "it has none"
        raise ConfigError(f"the DBC has no message {describe(wanted)}; {near}")
    message = database.messages[names.index(str(wanted))]
    if not message.is_extended_frame:
        right = "a message of J1939 has 29 bits"
        raise ConfigError(f"{quote(message.name)} has an 11-bit identifier; {right}")
    return message


def _find_signal(message: "Message", name: str, given: Mapping[str, object]) -> "Signal":
    """Return a signal of a message.

    Raises:
        ConfigError: the message has none of this name, or one that cannot be sent.
    """
    wanted = given.get(SIGNAL, name)
    names = [signal.name for signal in message.signals]
    if wanted not in names:
        near = f"the nearest is {find_nearest(str(wanted), names)}" if names else "it has none"
        raise ConfigError(f"{quote(message.name)} has no signal {describe(wanted)}; {near}")
    signal = message.signals[names.index(str(wanted))]
    shown = f"{quote(signal.name)} of {quote(message.name)}"
    if signal.is_multiplexer or signal.multiplexer_ids:
        raise ConfigError(f"{shown} is multiplexed, which is not supported; give another signal")
    if signal.byte_order != "little_endian":
        raise ConfigError(f"{shown} is big-endian (Motorola); numbers of J1939 are little-endian")
    if signal.is_signed or signal.is_float:
        what = "a float" if signal.is_float else "signed"
        raise ConfigError(f"{shown} is {what}; numbers of J1939 are unsigned, with an offset")
    if signal.length not in _LENGTHS:
        raise ConfigError(f"{shown} has {signal.length} bits; 2 to 32 can be sent")
    return signal


def _place(message: "Message", signal: "Signal") -> Iterator[tuple[str, object]]:
    yield "pgn", split(message.frame_id).group
    yield "start_bit", signal.start
    yield "length", signal.length
    yield "resolution", float(signal.scale)
    yield "offset", float(signal.offset)
    if signal.unit:
        yield "unit", signal.unit


def _timing(
    message: "Message", signal: "Signal", own: Mapping[str, object]
) -> Iterator[tuple[str, object]]:
    """Yield period, priority and SPN of what is sent."""
    if "sink" in own:
        return
    if message.cycle_time:
        yield "rate_ms", message.cycle_time
    yield "priority", split(message.frame_id).priority
    if signal.spn:
        yield "spn", signal.spn
