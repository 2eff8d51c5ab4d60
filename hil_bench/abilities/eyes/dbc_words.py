"""Frames of no known node in the words of a DBC file."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from hil_bench.abilities.eyes.sight import Sight
from hil_bench.bench.configuration.dbc_signals import load_dbc

if TYPE_CHECKING:
    from cantools.database.can import Message


class DbcWords:
    """The messages of a DBC file.

    Args:
        path: the file.
    """

    def __init__(self, path: Path) -> None:
        self._messages: dict[tuple[int, bool], Message] = {
            (each.frame_id, each.is_extended_frame): each for each in load_dbc(path).messages
        }

    def explain(self, sight: Sight) -> Sight:
        """Return a line with message and values of its frame, where no PDO or transfer has them."""
        frame = sight.frame
        message = self._messages.get((frame.can_id, frame.is_extended))
        if message is None or sight.readings or sight.transfer or sight.problem or frame.is_remote:
            return sight
        try:
            values: dict[str, Any] = dict(message.decode(frame.data, allow_truncated=True))  # type: ignore[arg-type]
        except (ValueError, KeyError, OverflowError) as error:
            return sight._replace(name=message.name, problem=str(error))
        sender = message.senders[0] if message.senders else ""
        units = {signal.name: signal.unit or "" for signal in message.signals}
        words = ", ".join(
            f"{name} {value} {units.get(name, '')}".rstrip() for name, value in values.items()
        )
        return sight._replace(name=message.name, node=sender, words=words)
