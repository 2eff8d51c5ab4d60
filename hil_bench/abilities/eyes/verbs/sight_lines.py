"""Sights as lines for people and for programs."""

import argparse
import os
import sys
from collections.abc import Iterable, Iterator

from hil_bench.abilities.eyes.j1939 import trouble_codes
from hil_bench.abilities.eyes.sight import J1939Message, Service, Sight
from hil_bench.abilities.j1939.protocol.signals import DM1
from hil_bench.canopen_device.frame import BRS, ESI
from hil_bench.canopen_device.words import is_error_reset
from hil_bench.cli.results import json_text

_COLOURS = {
    Service.NMT: 36,
    Service.EMCY: 31,
    Service.SDO: 33,
    Service.HEARTBEAT: 90,
    Service.SYNC: 90,
    Service.TIME: 90,
    Service.LSS: 35,
    Service.J1939: 34,
    Service.OTHER: 35,
}
_PROBLEM = 31


class SightLines:
    """Chooses which sights are shown, and writes each as a line.

    Args:
        args: of the command line, as `add_filter_arguments` has them, `json` and `quiet`.
        buses: how many buses the frames are of.
    """

    def __init__(self, args: argparse.Namespace, buses: int = 1) -> None:
        self._only = frozenset(args.only) or frozenset(Service)
        self._hidden = frozenset(args.hide)
        self._nodes = frozenset(args.node)
        self._changes = args.changes
        self._problems = args.problems
        self._has_raw = args.raw
        self._is_json = args.json
        self._buses = buses
        self._is_quiet = args.quiet
        self._last: dict[tuple[int, int, str], str] = {}
        is_terminal = sys.stdout.isatty() and "NO_COLOR" not in os.environ
        self._is_coloured = args.colour == "always" or (args.colour == "auto" and is_terminal)

    def show(self, sights: Iterable[Sight]) -> None:
        """Print the lines of sights, unless nothing is to be printed."""
        for sight in () if self._is_quiet else sights:
            line = self.of(sight)
            if line is not None:
                print(line)

    def of(self, sight: Sight) -> str | None:
        """Return the line of a sight; None where it is not shown."""
        if sight.service not in self._only or sight.service in self._hidden:
            return None
        if self._nodes and not self._nodes & {sight.node, str(sight.node_id)}:
            return None
        if self._problems and not is_problem(sight):
            return None
        if self._changes and not self._is_news(sight):
            return None
        return _as_json(sight) if self._is_json else self._as_text(sight)

    def _is_news(self, sight: Sight) -> bool:
        if sight.transfer is not None:
            return True
        key, text = (sight.frame.bus, sight.frame.can_id, sight.name), sight.text
        is_news = self._last.get(key) != text
        self._last[key] = text
        return is_news

    def _as_text(self, sight: Sight) -> str:
        frame = sight.frame
        identifier = f"{frame.can_id:08X}" if frame.is_extended else f"{frame.can_id:03X}"
        parts = [f"{sight.now * 1e-9:12.6f}", *([f"can{frame.bus}"] if self._buses > 1 else [])]
        parts += [f"{identifier:>3}", f"{sight.node:12}", f"{sight.name:9}"]
        if self._has_raw:
            parts.append(f"{frame.data.hex(' ').upper():23}")
        line = "  ".join([*parts, sight.text]).rstrip()
        colour = _PROBLEM if sight.problem else _COLOURS.get(sight.service)
        return f"\x1b[{colour}m{line}\x1b[0m" if self._is_coloured and colour else line


def is_problem(sight: Sight) -> bool:
    """Return True if a sight reports a problem."""
    code = sight.emcy_code
    if code is not None:
        return not is_error_reset(code)
    return bool(sight.problem) or _has_trouble(sight.message)


def _has_trouble(message: J1939Message | None) -> bool:
    if message is None or message.group != DM1:
        return False
    return bool(trouble_codes(message.data or b""))


def _as_json(sight: Sight) -> str:
    frame = sight.frame
    return json_text(
        {
            "time": sight.now * 1e-9,
            "bus": frame.bus,
            "id": frame.can_id,
            "is_extended": frame.is_extended,
            "is_remote": frame.is_remote,
            "is_fd": frame.fd != 0,
            "has_brs": frame.fd & BRS != 0,
            "has_esi": frame.fd & ESI != 0,
            "data": frame.data.hex(),
            "service": sight.service.value,
            "name": sight.name,
            "node": sight.node,
            "node_id": sight.node_id,
            "text": sight.words,
            "values": list(_values(sight)),
            "problem": sight.problem,
        },
        indent=None,
    )


def _values(sight: Sight) -> Iterator[dict[str, object]]:
    for reading in sight.readings:
        value = reading.value
        is_finite = isinstance(value, (str, int)) or value - value == 0.0
        yield {
            "object": reading.place,
            "name": reading.name,
            "value": value if is_finite else None,
            "unit": reading.unit,
            "text": reading.text,
        }
