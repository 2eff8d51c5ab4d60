"""Frames of no known node by the messages of a DBC file: in words, and as numbers."""

import argparse
from collections.abc import Container, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.abilities.j1939.configuration.signals import load_dbc

if TYPE_CHECKING:
    from cantools.database.can import Message

_J1939, _SENDER, _ANY_SENDER = "j1939", 0xFF, 0xFE
_UNDECODABLE = ValueError, KeyError, OverflowError


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

    Args:
        path: the file; None for no messages.
        seen: the identifiers whose messages count, and whether they are extended; None for all.
    """

    def __init__(self, path: Path | None, seen: Container[tuple[int, bool]] | None = None) -> None:
        messages = () if path is None else load_dbc(path).messages
        self._senders = {each.frame_id & _SENDER for each in messages if each.protocol == _J1939}
        known = {(each.frame_id, each.is_extended_frame): each for each in messages}
        self._messages: dict[tuple[int, bool], Message] = {
            key: each for key, each in known.items() if seen is None or key in seen
        }

    def explain(self, sight: Sight) -> Sight:
        """Return a line with message and values of its frame, where no PDO or transfer has them."""
        message = self._message_of(sight)
        if message is None:
            return sight
        try:
            values = _decode(message, sight.frame.data, named=True)
        except _UNDECODABLE as error:
            return sight._replace(name=message.name, problem=str(error), service=Service.OTHER)
        sender = message.senders[0] if message.senders else ""
        units = {signal.name: signal.unit or "" for signal in message.signals}
        words = ", ".join(
            f"{name} {value} {units.get(name, '')}".rstrip() for name, value in values.items()
        )
        return sight._replace(name=message.name, node=sender, said=words, problem="")

    @property
    def hint(self) -> str:
        """The reason why messages of J1939 may not be found, in words; empty where it is none."""
        if _ANY_SENDER not in self._senders:
            return ""
        return (
            "messages of J1939 are found by priority, parameter group and sender, and this file "
            "has FE for any sender: write the sender of this bus"
        )

    @property
    def identifiers(self) -> frozenset[int]:
        """The 11-bit identifiers of the messages."""
        return frozenset(key for key, is_extended in self._messages if not is_extended)

    def signals(self) -> Iterator[tuple[str, str, str]]:
        """Yield message, signal and unit of each signal."""
        for message in self._messages.values():
            for signal in message.signals:
                yield message.name, signal.name, signal.unit or ""

    def numbers(self, sight: Sight) -> Mapping[tuple[str, str], float]:
        """Return the values of a frame by message and signal; empty where it has none."""
        message = self._message_of(sight)
        if message is None:
            return {}
        try:
            values = _decode(message, sight.frame.data, named=False)
        except _UNDECODABLE:
            return {}
        return {(message.name, name): float(value) for name, value in values.items()}

    def _message_of(self, sight: Sight) -> "Message | None":
        """Return the message of a frame that nothing else explains."""
        frame = sight.frame
        is_pdo = sight.service is Service.PDO and (sight.readings or sight.problem)
        if is_pdo or sight.transfer or frame.is_remote:
            return None
        return self._messages.get((frame.can_id, frame.is_extended))


def _decode(message: "Message", data: bytes, *, named: bool) -> dict[str, Any]:
    """Return the values of a frame, those of an enumeration by name or as numbers."""
    return dict(message.decode(data, decode_choices=named, allow_truncated=True))  # type: ignore[arg-type]
