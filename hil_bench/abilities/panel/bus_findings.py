"""Faults on the buses of a bench, as `explain` names them, for the page's view of the bus."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from hil_bench.abilities.eyes.explain.explain import Explainer
from hil_bench.abilities.eyes.explain.finding import Finding
from hil_bench.abilities.eyes.explain.live import LiveFindings
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.logged_frame import LoggedFrame
from hil_bench.outside.transports.bus_load import USUAL_BITRATE

_NS: Final = 1_000_000_000
_MOST_BUSES: Final = 64
_MOST: Final = 20
"""Findings of a bus that are shown."""


class BusFindings:
    """Explains each bus from the frame on at which somebody begins to look.

    Args:
        devices: of the bench, as its greeting has them: node-ID and bus by name.
    """

    def __init__(self, devices: Mapping[str, Any]) -> None:
        self._devices = devices
        self._buses: dict[int, tuple[Explainer, LiveFindings]] = {}

    def take(self, frames: Iterable[Sequence[Any]]) -> dict[str, Any] | None:
        """Take frames; return the message of what is wrong where that has changed.

        Args:
            frames: as the feed has them: time, bus, way, identifier, data, extended, remote,
                CAN FD.
        """
        is_news = False
        for time, bus, _way, can_id, data, is_extended, is_remote, fd in frames:
            if bus not in self._buses and len(self._buses) >= _MOST_BUSES:
                continue
            explainer, live = self._buses.get(bus) or self._begin(bus)
            payload = bytes.fromhex(data)
            frame = Frame(can_id, payload, bool(is_remote), bool(is_extended), fd=fd)
            explainer.take(LoggedFrame(frame, round(time * _NS), None))
            is_news |= any([*live.look(explainer.now)])
        return self._message() if is_news else None

    def _begin(self, bus: int) -> tuple[Explainer, LiveFindings]:
        known = [
            KnownNode(each["node_id"], name)
            for name, each in self._devices.items()
            if each.get("bus") == bus and each.get("node_id")
        ]
        explainer = Explainer(known, USUAL_BITRATE)
        self._buses[bus] = explainer, LiveFindings(explainer)
        return self._buses[bus]

    def _message(self) -> dict[str, Any]:
        return {
            "type": "findings",
            "findings": [
                _content(bus, finding)
                for bus, (_, live) in sorted(self._buses.items())
                for finding in live.findings[:_MOST]
            ],
        }


def _content(bus: int, finding: Finding) -> dict[str, Any]:
    return {
        "bus": bus,
        "title": finding.cause.title,
        "clause": finding.cause.clause,
        "text": finding.text,
        "advice": finding.cause.advice,
        "leads_to": [each.text for each in finding.consequences[:_MOST]],
    }
