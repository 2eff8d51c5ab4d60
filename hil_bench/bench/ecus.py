"""The J1939 devices of a bench: built from their configuration, and set and read by tests."""

from collections.abc import Iterator, Mapping
from typing import NoReturn

from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.segment import EcuStation, Segment
from hil_bench.devices.axis import Fitting
from hil_bench.devices.faults.line import Line
from hil_bench.devices.j1939.diagnostics import TroubleCode
from hil_bench.devices.j1939.ecu import Ecu
from hil_bench.devices.j1939.identifier import COMPONENT
from hil_bench.errors import ConfigError
from hil_bench.kinds.surroundings import Surroundings


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
        fitting, signals, inputs = each.kind.fit(each, ecu, surroundings)
        station = EcuStation(
            each.name, ecu, Line(ecu), fitting.advance, dict(signals), dict(inputs)
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

    def __iter__(self) -> Iterator[str]:
        return iter(self._station.signals)

    def __getitem__(self, name: str) -> float:
        """Return the value of a signal that it sends; NaN for the error indicator."""
        if name not in self._station.signals:
            self._refuse(name, self._station.signals)
        return self._station.signals[name].value

    def __setitem__(self, name: str, value: float) -> None:
        """Set a signal that nothing else moves; NaN shows the error indicator."""
        if name not in self._station.inputs:
            self._refuse(name, self._station.inputs)
        self._station.inputs[name].value = float(value)

    def _refuse(self, name: str, known: Mapping[str, object]) -> NoReturn:
        """Say which signals there are.

        Raises:
            ConfigError: always.
        """
        place = f"j1939.{self._station.name}"
        if name in self._station.signals:
            raise ConfigError(f"{place}: {name} shows what the file says; give it no value there")
        right = f"give one of {', '.join(known)}" if known else "it has none"
        raise ConfigError(f'{place}: there is no signal "{name}"; {right}')


class EcuTable(dict[str, EcuHandle]):
    """The J1939 devices of a bench by their names; another name is a `ConfigError`."""

    def __init__(self, segments: tuple[Segment, ...]) -> None:
        stations = (station for segment in segments for station in segment.stations)
        super().__init__((station.name, EcuHandle(station)) for station in stations)

    def __missing__(self, name: str) -> NoReturn:
        known = f"give one of {', '.join(self)}" if self else "this bench has none"
        raise ConfigError(f'j1939: there is no device "{name}"; {known}')
