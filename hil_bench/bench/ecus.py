"""The J1939 devices of a bench: built from their configuration, and set and read by tests."""

import math
from collections.abc import Iterator, Mapping, Sequence
from numbers import Real
from typing import NoReturn

from hil_bench.bench.bench import Bench
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.segment import EcuStation, Segment
from hil_bench.devices.axis import Fitting
from hil_bench.devices.faults.line import Line
from hil_bench.devices.j1939.diagnostics import TroubleCode
from hil_bench.devices.j1939.ecu import Ecu
from hil_bench.devices.j1939.identifier import COMPONENT
from hil_bench.devices.j1939.values import EcuValue
from hil_bench.errors import ConfigError
from hil_bench.kinds.surroundings import Surroundings
from hil_bench.units import ONE


def build_segments(
    config: BenchConfig, surroundings: Surroundings
) -> tuple[list[Segment], dict[str, Fitting]]:
    """Return the J1939 devices of each bus that has some, and what each does by its name."""
    stations: dict[int, list[EcuStation]] = {}
    fittings: dict[str, Fitting] = {}
    numbers = {name: number for number, name in enumerate(config.buses)}
    for each in config.ecus:
        ecu = Ecu(each.identity, each.address)
        if each.component:
            component = each.component.encode("latin-1", "replace")
            ecu.provide(COMPONENT, lambda component=component: component)  # type: ignore[misc]
        fitting, signals, values = each.kind.fit(each, ecu, surroundings)
        station = EcuStation(
            each.name, ecu, Line(ecu), fitting.advance, dict(signals), dict(values)
        )
        stations.setdefault(numbers[each.bus], []).append(station)
        fittings[each.name] = fitting
    return [Segment(number, those) for number, those in stations.items()], fittings


class EcuHandle:
    """A J1939 device of a bench in a test: ``bench.ecus["joystick"]["x"] = -50``.

    Args:
        station: the device.

    Attributes:
        ecu: its ECU, with address claim, transport and trouble codes.
    """

    def __init__(self, station: EcuStation) -> None:
        self.ecu: Ecu = station.ecu
        self._station = station

    @property
    def address(self) -> int:
        """The source address that it has claimed; 254 for none."""
        return self.ecu.address

    @property
    def trouble_codes(self) -> list[TroubleCode]:
        """The trouble codes that are active, SPN and FMI."""
        return self.ecu.diagnostics.active

    def standing(self) -> dict[str, object]:
        """Return the status of the device: address claim, address, codes as SPN and FMI."""
        codes = [[code.spn, code.fmi] for code in self.trouble_codes]
        return {"state": self.ecu.state.value, "address": self.address, "codes": codes}

    @property
    def values(self) -> Mapping[str, EcuValue]:
        """The values that the device shows, by name."""
        return self._station.values

    def __iter__(self) -> Iterator[str]:
        return iter(self._station.values)

    def __contains__(self, name: object) -> bool:
        return name in self._station.values

    def __getitem__(self, name: str) -> float:
        """Return a signal in its own unit; NaN for an error or "not available"."""
        return self._find(name).read()

    def __setitem__(self, name: str, value: float) -> None:
        """Set a signal that nothing else moves, in its own unit; NaN shows the error indicator."""
        found = self._find(name)
        self.check(name, value)
        if found.takes is not None:
            found.takes(float(value))

    def check(self, name: str, value: object) -> None:
        """Refuse what a signal cannot be set to.

        Raises:
            ConfigError: it says why.
        """
        found, place = self._find(name), f"j1939.{self._station.name}: {name}"
        if found.takes is None:
            right = "give one without source, script and follow"
            raise ConfigError(f"{place} is what the device itself shows; {right}")
        is_number = isinstance(value, Real) and not isinstance(value, str)
        if not is_number or not (math.isnan(value) or found.low <= value <= found.high):  # type: ignore[arg-type, operator]
            unit = "" if found.unit == ONE.symbol else f" {found.unit}"
            right = f"give {found.low:g} to {found.high:g}{unit}"
            raise ConfigError(f"{place} cannot be {value!r}; {right}")

    def _find(self, name: str) -> EcuValue:
        known = self._station.values
        if name not in known:
            right = f"give one of {', '.join(known)}" if known else "it has none"
            wrong = f'there is no signal "{name}"'
            raise ConfigError(f"j1939.{self._station.name}: {wrong}; {right}")
        return known[name]


class EcuTable(dict[str, EcuHandle]):
    """The J1939 devices of a bench by their names; another name is a `ConfigError`.

    Args:
        segments: the devices of each bus that has some.

    Attributes:
        segments: as passed in.
    """

    def __init__(self, segments: Sequence[Segment] = ()) -> None:
        self.segments = tuple(segments)
        stations = (station for segment in segments for station in segment.stations)
        super().__init__((station.name, EcuHandle(station)) for station in stations)

    def join(self, bench: Bench) -> None:
        """Plug the devices in."""
        for segment in self.segments:
            segment.join(bench.switchboard)
            bench.starts.append(segment.start)
            bench.acts.append(segment.advance)

    def __missing__(self, name: str) -> NoReturn:
        known = f"give one of {', '.join(self)}" if self else "this bench has none"
        raise ConfigError(f'j1939: there is no device "{name}"; {known}')


def ecus_of(bench: Bench) -> EcuTable:
    """Return the J1939 devices of a bench."""
    return bench.find(EcuTable) or EcuTable()
