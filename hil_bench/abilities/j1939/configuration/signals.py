"""Signals of J1939 devices: by their names in a DBC file, and those of a device by table.

``x = { message = "BJM1", signal = "JoystickX" }`` stands for the parameter group, the place, the
scaling, the unit, the period and the SPN that the file has for it.

By table, ``x = { pgn = 0xFDD6, start_bit = 6, length = 10, resolution = 0.1, sine = 100 }`` says
where a signal stands, and where its value comes from: `source`, a script, `follow`, or a test.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from hil_bench.abilities.j1939.configuration.dbc_file import load_dbc
from hil_bench.abilities.j1939.kinds.signal_table import (
    SENT_KEYS,
    TAKEN_KEYS,
    SentConfig,
    TakenConfig,
)
from hil_bench.abilities.j1939.protocol.signals import Signal, split
from hil_bench.abilities.j1939.protocol.transmission import MOST_BYTES
from hil_bench.bench.configuration.axes import Axes
from hil_bench.bench.configuration.bindings import (
    SCRIPT_KEYS,
    build_course,
    find_quantity,
    find_unit,
)
from hil_bench.config.settings import (
    Given,
    Key,
    Problems,
    Settings,
    convert,
    open_table,
    read_table,
)
from hil_bench.config.values import describe, find_nearest, number, quote, text
from hil_bench.devices.scripted_objects import Course
from hil_bench.errors import ConfigError
from hil_bench.plants.plant import Quantity
from hil_bench.units import Unit

if TYPE_CHECKING:
    from cantools.database.can import Database, Message
    from cantools.database.can import Signal as DbcSignal

MESSAGE, SIGNAL = "message", "signal"

_PLACE: Final = ("pgn", "start_bit", "length", "resolution", "offset")
_OF_GROUP: Final = ("rate_ms", "priority")

LENGTHS: Final = range(2, 33)


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


def _find_message(database: "Database", given: Mapping[str, object]) -> "Message":
    wanted = given.get(MESSAGE)
    names = [message.name for message in database.messages]
    if wanted is None:
        raise ConfigError(f'{MESSAGE} is missing; give the name of a message, as "BJM1"')
    if wanted not in names:
        near = f"the nearest is {find_nearest(str(wanted), names)}" if names else "it has none"
        raise ConfigError(f"the DBC has no message {describe(wanted)}; {near}")
    if (number := names.count(str(wanted))) > 1:
        raise ConfigError(f"the DBC has {number} messages {describe(wanted)}; rename them there")
    message = database.messages[names.index(str(wanted))]
    if not message.is_extended_frame:
        right = "a message of J1939 has 29 bits"
        raise ConfigError(f"{quote(message.name)} has an 11-bit identifier; {right}")
    return message


def _find_signal(message: "Message", name: str, given: Mapping[str, object]) -> "DbcSignal":
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
    if signal.length not in LENGTHS:
        raise ConfigError(f"{shown} has {signal.length} bits; 2 to 32 can be sent")
    return signal


def _place(message: "Message", signal: "DbcSignal") -> Iterator[tuple[str, object]]:
    yield "pgn", split(message.frame_id).group
    yield "start_bit", signal.start
    yield "length", signal.length
    yield "resolution", float(signal.scale)
    yield "offset", float(signal.offset)
    if signal.unit:
        yield "unit", signal.unit


def _timing(
    message: "Message", signal: "DbcSignal", own: Mapping[str, object]
) -> Iterator[tuple[str, object]]:
    """Yield period, priority and SPN of what is sent."""
    if "sink" in own:
        return
    if message.cycle_time:
        yield "rate_ms", message.cycle_time
    yield "priority", split(message.frame_id).priority
    if signal.spn:
        yield "spn", signal.spn


# The tables ``[j1939.NAME.signals]``: what a device by table sends and takes.

SIGNALS_TABLE = "signals"

_SOURCE_KEYS = (Key("source", text, example='"axis1.P_A"'),)
_FOLLOW_KEYS = (Key("follow", text, example='"x"'),)
_MEAN = Key("mean", number(), 0.0)
_COURSES = tuple(word for word in SCRIPT_KEYS if word != "follow")
_ORIGINS = ("source", "sink", "follow", *_COURSES)
_OWN = {key.name for key in SENT_KEYS} | {"delta"}


class GivenSignal(NamedTuple):
    """A signal whose keys are right by themselves.

    Attributes:
        name: of the signal.
        table: that gives it.
        settings: the values of its keys.
        word: where its value comes from; empty for a test.
        axis: the axis that it is bound to; None for none.
        quantity: of that axis.
        unit: that its numbers are in.
        course: what moves it; None where nothing does.
    """

    name: str
    table: str
    settings: Settings
    word: str
    axis: str | None = None
    quantity: Quantity | None = None
    unit: Unit | None = None
    course: Course | None = None

    @property
    def is_sink(self) -> bool:
        """True if the signal commands the plant."""
        return self.word == "sink"

    @property
    def place(self) -> Signal:
        """The place of the signal in its message."""
        keys = ("start_bit", "length", "resolution", "offset")
        return Signal(*(self.settings[key].value for key in keys))


def read_signals(
    device: str, given: Given | None, axes: Axes, problems: Problems, dbc: Path | None = None
) -> list[GivenSignal]:
    """Return the signals of a device; one with a problem is noted and left out.

    Args:
        device: its table, as in ``j1939.NAME``.
        given: what stands in its `signals`, if anything.
        axes: of the bench.
        problems: where problems are noted.
        dbc: the DBC file that may name them; None for none.
    """
    table = f"{device}.{SIGNALS_TABLE}"
    if given is None:
        right = "give one as name = { pgn = 0xFDD6, start_bit = 6, length = 10 }"
        problems.add(problems.place(table), f"missing; {right}")
        return []
    found = []
    tables = {name: each.value for name, each in open_table(table, given, problems).items()}
    for name, signal in tables.items():
        if not isinstance(signal, dict):
            problems.add(problems.place(table, name), f"{describe(signal)} is not a table")
            continue
        try:
            keys = look_up(dbc, name, tables) if is_named(signal) else signal
        except ConfigError as error:
            problems.add(problems.place(table, name), error)
            continue
        found.append(_read_signal(f"{table}.{name}", name, keys, axes, problems))
    signals = [signal for signal in found if signal is not None]
    _check_follows(signals, problems)
    return signals


def check_groups(signals: Sequence[GivenSignal], problems: Problems) -> None:
    """Note signals that overlap, and periods and priorities of one group that differ."""
    taken: dict[tuple[int, int], str] = {}
    said: dict[tuple[int, str], tuple[Any, str]] = {}
    for signal in signals:
        if signal.is_sink:
            continue
        group, place = signal.settings["pgn"].value, signal.place
        for bit in range(place.start, place.start + place.length):
            other = taken.setdefault((group, bit), signal.name)
            if other != signal.name:
                wrong = f"bit {bit} of PGN {group} is that of {other} too; give each its own"
                problems.add(problems.place(signal.table, "start_bit"), wrong)
                break
        for key in ("rate_ms", "priority"):
            value = signal.settings[key].value
            if value is None:
                continue
            first, name = said.setdefault((group, key), (value, signal.name))
            if first != value:
                wrong = f"{value} is not that of {name}, {first}, in the same PGN; give one"
                problems.add(problems.place(signal.table, key), wrong)


def build_signals(
    signals: Sequence[GivenSignal], axes: Axes
) -> tuple[tuple[SentConfig, ...], tuple[TakenConfig, ...]]:
    """Return the records of checked signals: those that are sent, and those that are taken."""
    sent = tuple(_build_sent(signal) for signal in signals if not signal.is_sink)
    taken = tuple(_build_taken(signal, axes) for signal in signals if signal.is_sink)
    return sent, taken


def _read_signal(
    table: str, name: str, given: Mapping[str, object], axes: Axes, problems: Problems
) -> GivenSignal | None:
    words = [word for word in _ORIGINS if word in given]
    if len(words) > 1:
        wrong = f"is {' and '.join(words)} at once; give one of them"
        problems.add(problems.place(table), wrong)
        return None
    word = words[0] if words else ""
    keys = (*(TAKEN_KEYS if word == "sink" else SENT_KEYS), *_keys_of(word))
    settings = read_table(table, given, keys, problems)
    if len(settings) < len(keys):
        return None
    signal = GivenSignal(name, table, settings, word)
    if signal.place.start + signal.place.length > 8 * MOST_BYTES:
        problems.add(problems.place(table, "start_bit"), f"ends behind byte {MOST_BYTES}")
        return None
    try:
        return _with_value(signal, axes)
    except ConfigError as error:
        problems.add(problems.place(table, word), error)
        return None


def _with_value(signal: GivenSignal, axes: Axes) -> GivenSignal:
    """Return a signal with the quantity or course behind it; ConfigError where there is none."""
    word, settings = signal.word, signal.settings
    if word in {"source", "sink"}:
        axis, quantity = find_quantity(settings[word].value, axes, word)
        unit = find_unit(settings["unit"].value, quantity)
        return signal._replace(axis=axis, quantity=quantity, unit=unit)
    if word == "sine":
        settings = settings | {"offset": settings["mean"]}
    if word in _COURSES:
        return signal._replace(course=build_course(word, settings))
    return signal


def _keys_of(word: str) -> tuple[Key, ...]:
    """Return the keys of where a value comes from, but for those that stand for its place."""
    if word == "source":
        return _SOURCE_KEYS
    if word == "follow":
        return _FOLLOW_KEYS
    mean = (_MEAN,) if word == "sine" else ()
    return (*mean, *(key for key in SCRIPT_KEYS.get(word, ()) if key.name not in _OWN))


def _check_follows(signals: Sequence[GivenSignal], problems: Problems) -> None:
    """Note signals that follow what is not there, or what follows itself."""
    leaders = [each.name for each in signals if each.word not in {"follow", "sink"}]
    for signal in signals:
        if signal.word == "follow" and signal.settings["follow"].value not in leaders:
            wrong = f"{describe(signal.settings['follow'].value)} is no signal with a value"
            right = f"give one of {', '.join(leaders)}" if leaders else "give one a script"
            problems.add(problems.place(signal.table, "follow"), f"{wrong}; {right}")


def _build_sent(signal: GivenSignal) -> SentConfig:
    settings = signal.settings
    values = convert(settings, SENT_KEYS)
    spn = values["spn"]
    constant = settings["constant"].value if signal.word == "constant" else None
    sent: dict[str, Any] = {
        "name": signal.name,
        "group": values["pgn"],
        "signal": signal.place,
        "show": values["shows"],
        "neutral": values["neutral"],
        "period": values["rate_ms"],
        "priority": values["priority"],
        "trouble": None if spn is None else (spn, values["fmi"]),
        "unit": values["unit"] or "-",
        "follow": settings["follow"].value if signal.word == "follow" else None,
    }
    if constant is not None:
        sent["start"] = constant
    else:
        sent["course"] = signal.course
    if signal.quantity is not None and signal.unit is not None:
        sent |= {"axis": signal.axis, "quantity": signal.quantity.name}
        sent["scale"] = 1.0 / signal.unit.factor
    return SentConfig(**sent)


def _build_taken(signal: GivenSignal, axes: Axes) -> TakenConfig:
    values = convert(signal.settings, TAKEN_KEYS)
    axis = axes[str(signal.axis)]
    full = axis.kind.command_unit.to_si(axis.kind.full_scale(axis.settings))
    is_share = signal.quantity is not None and signal.quantity.is_share
    factor = 1.0 if signal.unit is None else signal.unit.factor
    scale = (1.0 if is_share else full) / factor
    return TakenConfig(
        name=signal.name,
        group=values["pgn"],
        signal=signal.place,
        axis=str(signal.axis),
        scale=scale,
        safe=signal.settings["safe"].value / scale,
        timeout=values["timeout_ms"],
        full_opening=full,
    )
