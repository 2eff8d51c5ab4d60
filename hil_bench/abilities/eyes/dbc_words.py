"""Frames of no known node by the messages of a DBC file: in words, and as numbers."""

import argparse
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.abilities.j1939.configuration.dbc_file import load_dbc
from hil_bench.abilities.j1939.configuration.signals import LENGTHS
from hil_bench.abilities.j1939.protocol import signals as j1939
from hil_bench.cli.results import warn_of

if TYPE_CHECKING:
    from cantools.database.can import Database, Message
    from cantools.database.can import Signal as DbcSignal

_UNDECODABLE = ValueError, KeyError, OverflowError
_ANY: Final = frozenset({j1939.NULL, j1939.GLOBAL})
"""Addresses that stand for any sender in a DBC file."""
_ANY_RECEIVER: Final = _ANY | {0}
"""Addresses that stand for any receiver there; 0 is what files have that give none."""
_PROPRIETARY: Final = frozenset({0xEF00, 0x1EF00})
"""The parameter groups whose content depends on the receiver (SAE J1939-21, proprietary A)."""
_FRAME: Final = 8
"""Bytes of a frame: a longer message comes in several."""
_PROTOCOL: Final = "ProtocolType"
"""The attribute of a file that says what its messages are."""
_FORMAT: Final = "VFrameFormat"
"""The attribute of a message that says so."""


def _speaks_j1939(database: "Database") -> bool:
    """Return True if a file says of all its messages that they are those of J1939."""
    if database.dbc is None:
        return False
    given = database.dbc.attributes.get(_PROTOCOL)
    usual = database.dbc.attribute_definitions.get(_PROTOCOL)
    value = given.value if given else usual.default_value if usual else ""
    return str(value).upper().startswith("J1939")


def _is_j1939(message: "Message", *, by_file: bool) -> bool:
    """Return True if a message is one of J1939, by its frame format or else by its file."""
    has_format = message.dbc is not None and _FORMAT in message.dbc.attributes
    is_of_j1939 = message.protocol == "j1939" or (by_file and not has_format)
    return message.is_extended_frame and is_of_j1939


class _Found(NamedTuple):
    """A message that a frame is, or ends.

    Attributes:
        message: by the file.
        data: of the whole message.
        source: the address of its sender; None where it is no message of J1939.
    """

    message: "Message"
    data: bytes
    source: int | None


def add_dbc_argument(parser: argparse.ArgumentParser, what: str) -> None:
    """Add --dbc.

    Args:
        parser: of a verb.
        what: the use of the messages.
    """
    parser.add_argument(
        "--dbc",
        type=Path,
        metavar="FILE.dbc",
        help=f"read a DBC file: frames of no known node are {what} by its messages and signals "
        "(pip install 'hil-bench[dbc]')",
    )


class DbcMessages:
    """The messages of a DBC file.

    A message of J1939 is found by its parameter group and, where the file gives one, its sender;
    any other by its identifier.

    Args:
        path: the file; None for no messages.

    Attributes:
        left_out: messages of J1939 whose signals have the channel of another sender.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self.left_out = 0
        self._by_identifier: dict[tuple[int, bool], Message] = {}
        self._by_group: dict[int, list[Message]] = {}
        self._heard: dict[tuple[int, bool], list[int]] = {}
        self._strangers: set[tuple[int, int]] = set()
        self._unmarked: set[int] = set()
        self._times = Counter[str]()
        self._is_unmarked = self._is_narrowed = False
        if path is None:
            return
        database = load_dbc(path)
        self._times = Counter(each.name for each in database.messages)
        by_file = _speaks_j1939(database)
        for each in database.messages:
            if _is_j1939(each, by_file=by_file):
                self._by_group.setdefault(j1939.split(each.frame_id).group, []).append(each)
            else:
                self._by_identifier[_key(each)] = each
                if each.is_extended_frame and each.frame_id & 0xFF == j1939.NULL:
                    self._unmarked.add(j1939.split(each.frame_id).group)

    def explain(self, sight: Sight) -> Sight:
        """Return a line with message and values of its frame, where no PDO or transfer has them."""
        found = self._find(sight)
        if found is None:
            return sight
        message = found.message
        try:
            values = _decode(found, named=True)
        except _UNDECODABLE as error:
            return sight._replace(name=message.name, problem=str(error), service=Service.OTHER)
        units = {signal.name: signal.unit or "" for signal in message.signals}
        words = ", ".join(
            f"{name} {value} {'' if _is_indicator(value) else units.get(name, '')}".rstrip()
            for name, value in values.items()
        )
        sender = message.senders[0] if message.senders else ""
        if found.source is None:
            return sight._replace(name=message.name, node=sender, said=words, problem="")
        if _is_of_any(message) or not sender:
            sender = sight.node if sight.message else f"address {found.source}"
        return sight._replace(name=message.name, node=sender, said=words)

    @property
    def hint(self) -> str:
        """The reason why a message of J1939 is not found, in words; empty for none."""
        if self._is_unmarked:
            what = "it has the sender FE, and does not say that its messages are those of J1939"
            return f'{what}: give it BA_ "ProtocolType" "J1939";'
        if not self._strangers:
            return ""
        group, source = min(self._strangers)
        known = sorted({each.frame_id & 0xFF for each in self._by_group[group]})
        return (
            f"PGN {group} comes from address {source}, and the DBC file has it of "
            f"{' and '.join(map(str, known))} alone: give it the sender FE there, for any"
        )

    def warn(self) -> None:
        """Say the hint on standard error, if there is one."""
        warn_of([f"--dbc {self._path}: {self.hint}"] if self.hint else [])

    @property
    def identifiers(self) -> frozenset[int]:
        """The 11-bit identifiers of the messages."""
        return frozenset(key for key, is_extended in self._by_identifier if not is_extended)

    def note(self, sight: Sight) -> None:
        """Take down which message a frame is, for `narrow`."""
        found = self._find(sight)
        if found is not None:
            senders = self._heard.setdefault(_key(found.message), [])
            if found.source is not None and found.source not in senders:
                senders.append(found.source)

    def narrow(self) -> None:
        """Keep the signals of the noted messages alone, apart by sender where there are several."""
        self._is_narrowed = True

    def signals(self) -> Iterator[tuple[str, str, str]]:
        """Yield message, signal and unit of each signal."""
        groups = (each for some in self._by_group.values() for each in some)
        for message in (*self._by_identifier.values(), *groups):
            senders: Sequence[int | None] | None = self._heard.get(_key(message))
            if self._is_narrowed and senders is None:
                continue
            for name in {self._name(message, each): 0 for each in senders or (None,)}:
                for signal in message.signals:
                    yield name, signal.name, signal.unit or ""

    def numbers(self, sight: Sight) -> Mapping[tuple[str, str], float]:
        """Return the values of a frame by message and signal; empty where it has none."""
        found = self._find(sight)
        if found is None or not self._has_channels(found):
            return {}
        try:
            values = _decode(found, named=False)
        except _UNDECODABLE:
            return {}
        name = self._name(found.message, found.source)
        return {
            (name, signal): float(value)
            for signal, value in values.items()
            if not _is_indicator(value)
        }

    def _has_channels(self, found: _Found) -> bool:
        """Return True if a message is of the sender whose signals the channels have.

        Where nobody knows the senders beforehand, that is the first one.
        """
        if self._is_narrowed or found.source is None:
            return True
        senders = self._heard.setdefault(_key(found.message), [found.source])
        self.left_out += found.source != senders[0]
        return found.source == senders[0]

    def _name(self, message: "Message", source: int | None) -> str:
        """Return the name of a message, with what tells it from others of this name or senders."""
        is_alone = self._times[message.name] < 2
        name = message.name if is_alone else f"{message.name}_{message.frame_id:X}"
        several = self._is_narrowed and len(self._heard.get(_key(message), ())) > 1
        return f"{name}_{source:02X}" if several else name

    def _find(self, sight: Sight) -> _Found | None:
        """Return the message of a frame that nothing else explains."""
        frame = sight.frame
        is_pdo = sight.service is Service.PDO and (sight.readings or sight.problem)
        if is_pdo or sight.transfer or frame.is_remote:
            return None
        message = self._by_identifier.get((frame.can_id, frame.is_extended))
        if message is not None:
            return _Found(message, frame.data, None)
        if not frame.is_extended:
            return None
        self._is_unmarked |= j1939.split(frame.can_id).group in self._unmarked
        return self._find_group(sight) if self._by_group else None

    def _find_group(self, sight: Sight) -> _Found | None:
        """Return the message of J1939 that a frame is, or ends; None for a part of one."""
        _, group, source, destination = j1939.split(sight.frame.can_id)
        data: bytes | None = sight.frame.data
        if sight.message is not None:
            group, source, destination, data, *_ = sight.message
        elif sight.service is Service.J1939:
            return None
        known = self._by_group.get(group, ())
        fitting = [each for each in known if _fits(each, source, destination)]
        if known and not fitting:
            self._strangers.add((group, source))
        if not fitting or data is None:
            return None
        message = max(fitting, key=lambda each: _closeness(each, destination))
        if message.length > _FRAME >= len(data):
            return None
        return _Found(message, data, source)


def _key(message: "Message") -> tuple[int, bool]:
    return message.frame_id, message.is_extended_frame


def _is_of_any(message: "Message") -> bool:
    return message.frame_id & 0xFF in _ANY


def _fits(message: "Message", source: int, destination: int) -> bool:
    """Return True if a message of a group is that of these addresses."""
    group, sender, receiver = j1939.split(message.frame_id)[1:]
    is_meant = group not in _PROPRIETARY or receiver in {*_ANY_RECEIVER, destination}
    return is_meant and sender in {*_ANY, source}


def _closeness(message: "Message", destination: int) -> tuple[bool, bool]:
    """Return a rank among messages of a group: those of a sender first, then of this receiver."""
    return not _is_of_any(message), j1939.split(message.frame_id).destination == destination


class _Indicator(str):
    """The word for what a signal of J1939 has in place of a value."""

    __slots__ = ()


def _is_indicator(value: object) -> bool:
    return isinstance(value, _Indicator)


def _decode(found: _Found, *, named: bool) -> dict[str, Any]:
    """Return the values of a message, those of an enumeration by name or as numbers."""
    message = found.message
    raw = message.decode(found.data, decode_choices=named, allow_truncated=True)
    values: dict[str, Any] = dict(raw)  # type: ignore[arg-type]
    if found.source is not None:
        for signal in message.signals:
            word = _indicator(signal, found.data)
            if word and isinstance(values.get(signal.name), int | float):
                values[signal.name] = _Indicator(word)
    return values


def _indicator(signal: "DbcSignal", data: bytes) -> str:
    """Return the indicator in place of a signal's value; empty where it has one.

    Up to a highest value that the file gives all are values, unless it is that of all ones.
    """
    is_number = signal.byte_order == "little_endian" and not signal.is_signed
    if not is_number or signal.is_float or signal.length not in LENGTHS:
        return ""
    place = j1939.Signal(signal.start, signal.length)
    value, ones = (
        raw * signal.scale + signal.offset for raw in (place.raw_in(data), place.not_available)
    )
    if signal.maximum is not None and value <= signal.maximum < ones:
        return ""
    return place.indicator_in(data)
