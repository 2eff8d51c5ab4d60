"""The point at which faults act on a J1939 device, and their effects there."""

from collections.abc import Mapping
from typing import NamedTuple

from hil_bench.devices.faults.effects import LineEffect
from hil_bench.devices.faults.line import Line, Meeting, silence
from hil_bench.devices.j1939.diagnostics import Lamp
from hil_bench.devices.j1939.ecu import Ecu
from hil_bench.devices.j1939.signal_table import Indication, SentSignal


class EcuPoint(NamedTuple):
    """The point at which a fault acts on a J1939 device.

    Attributes:
        ecu: the device.
        line: its connection.
        signals: what it sends, by name.
    """

    ecu: Ecu
    line: Line
    signals: Mapping[str, SentSignal]


class RestartEffect:
    """A device is without power, and then starts anew."""

    def __init__(self, point: EcuPoint) -> None:
        self._ecu = point.ecu
        self._off = LineEffect(point.line, Meeting(silence))

    def begin(self, now: int) -> None:
        """Forget everything, and say nothing."""
        self._ecu.stop()
        self._off.begin(now)

    def end(self, now: int) -> None:
        """Start: the address claim follows."""
        self._off.end(now)
        self._ecu.start(now)


class IndicationEffect:
    """A signal shows the error indicator or "not available"."""

    def __init__(self, signal: SentSignal, indication: Indication) -> None:
        self._signal, self._indication = signal, indication

    def begin(self, now: int) -> None:  # noqa: ARG002 - of the protocol
        """Show it."""
        self._signal.indications.append(self._indication)

    def end(self, now: int) -> None:  # noqa: ARG002 - of the protocol
        """Show the value again."""
        self._signal.indications.remove(self._indication)


class TroubleEffect:
    """A device reports a trouble code by DM1."""

    def __init__(self, ecu: Ecu, spn: int, fmi: int, lamp: Lamp) -> None:
        self._ecu, self._code, self._lamp = ecu, (spn, fmi), lamp

    def begin(self, now: int) -> None:  # noqa: ARG002 - of the protocol
        """Report it."""
        self._ecu.begin_trouble(*self._code, self._lamp)

    def end(self, now: int) -> None:  # noqa: ARG002 - of the protocol
        """Report it no more."""
        self._ecu.end_trouble(*self._code)


class AddressEffect:
    """A device sends from an address that it has not claimed."""

    def __init__(self, ecu: Ecu, address: int) -> None:
        self._ecu, self._address = ecu, address

    def begin(self, now: int) -> None:  # noqa: ARG002 - of the protocol
        """Use it."""
        self._ecu.false_address = self._address

    def end(self, now: int) -> None:  # noqa: ARG002 - of the protocol
        """Use its own again."""
        self._ecu.false_address = None
