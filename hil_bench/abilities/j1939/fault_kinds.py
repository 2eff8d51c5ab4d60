"""The faults of J1939 devices: kinds, targets, and the points at which they act.

Only `faults` imports it, or what it asks.
"""

from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any, Final

from hil_bench.abilities.faults.checks import choose, count
from hil_bench.abilities.faults.effects import Acts, listed
from hil_bench.abilities.faults.fault import Effect
from hil_bench.abilities.faults.kind import UNITS, Site, fault_kind
from hil_bench.abilities.faults.points import NODES, SENSORS, VALVES, FaultPoints, Group, NodePoint
from hil_bench.abilities.j1939.protocol.diagnostics import HIGHEST_FMI, HIGHEST_SPN, Lamp
from hil_bench.abilities.j1939.protocol.ecu import Ecu
from hil_bench.abilities.j1939.protocol.signal_table import Indication, SentSignal
from hil_bench.abilities.j1939.protocol.signals import NULL
from hil_bench.config.settings import Key
from hil_bench.config.values import choice, integer
from hil_bench.errors import ConfigError

ECUS: Final[Group[Ecu]] = Group("ecus", "J1939 device")
SIGNALS: Final[Group[SentSignal]] = Group("signals", "J1939 signal")

_LAMPS = [lamp.name.lower() for lamp in Lamp]


@fault_kind(SIGNALS, keys=(Key("shows", choice(Indication), Indication.ERROR),))
def indicate(signal: Site, shows: Indication | str = Indication.ERROR) -> Effect:
    """Let a J1939 signal, as "joystick.x", show the "error" indicator or "not_available"."""
    return listed(signal.point(SIGNALS).indications, choose("shows", Indication, shows))


_CODE = (
    Key("spn", integer(0, HIGHEST_SPN), example="1907"),
    Key("fmi", integer(0, HIGHEST_FMI), example="2"),
    Key("lamp", choice(_LAMPS), Lamp.WARNING.name.lower()),
)


@fault_kind(ECUS, keys=_CODE)
def report(device: Site, spn: int, fmi: int, lamp: str = "warning") -> Effect:
    """Let a J1939 device report a trouble code by DM1, and light a lamp.

    Raises:
        ConfigError: there is no such lamp.
    """
    ecu = device.point(ECUS)
    if lamp.lower() not in _LAMPS:
        known = ", ".join(f'"{each}"' for each in _LAMPS)
        raise ConfigError(f'faults: lamp = "{lamp}" is unknown; give one of {known}')
    code = count("spn", spn, 0, HIGHEST_SPN), count("fmi", fmi, 0, HIGHEST_FMI)
    return Acts(
        lambda _now: ecu.begin_trouble(*code, Lamp[lamp.upper()]),
        lambda _now: ecu.end_trouble(*code),
    )


@fault_kind(ECUS, keys=(Key("address", integer(0, NULL - 1), example="200"),))
def readdress(device: Site, address: int) -> Effect:
    """Let a J1939 device send from an address that it has not claimed, 0 to 253.

    Raises:
        ConfigError: it is the device's own.
    """
    ecu, false = device.point(ECUS), count("address", address, 0, NULL - 1)
    if false == ecu.address:
        raise ConfigError(f"faults: address = {address} is its own; give another one")

    def use(_now: int) -> None:
        ecu.false_address = false

    def leave(_now: int) -> None:
        ecu.false_address = None

    return Acts(use, leave)


def name_targets(
    devices: Iterable[str],
    sensors: Mapping[str, str],
    valves: Iterable[str],
    signals: Iterable[str],
) -> dict[str, dict[str, Any]]:
    """Return the targets of faults by group, sensors with the units of their amounts.

    Args:
        devices: their names.
        sensors: the SI units of those signals that measure something.
        valves: the devices and signals that command an axis.
        signals: the names of all that are sent.
    """
    return {
        SENSORS.name: {name: UNITS.get(unit) for name, unit in sensors.items()},
        VALVES.name: dict.fromkeys(valves),
        NODES.name: dict.fromkeys(devices),
        ECUS.name: dict.fromkeys(devices),
        SIGNALS.name: dict.fromkeys(signals),
    }


def add_points(
    points: FaultPoints, name: str, ecu: Ecu, signals: Mapping[str, SentSignal], bus: int
) -> None:
    """Add the points of a device on a numbered bus."""
    points.of(NODES)[name] = NodePoint(ecu, partial(_stop, ecu), ecu.start, bus)
    points.of(ECUS)[name] = ecu
    points.of(SIGNALS).update({f"{name}.{each}": signal for each, signal in signals.items()})


def _stop(ecu: Ecu, _now: int) -> None:
    ecu.stop()
