"""The J1939 devices of a bench as a part of it."""

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace

from hil_bench.abilities.j1939.ecus import EcuTable, build_ecus
from hil_bench.abilities.j1939.kinds.ecu import EcuConfig
from hil_bench.bench.configuration.records import FIRST_BUS, BenchConfig
from hil_bench.kinds.surroundings import Surroundings


@dataclass(frozen=True, slots=True)
class J1939Part:
    """The part that the tables ``[j1939.NAME]`` describe.

    Attributes:
        ecus: the devices, in the order of the file.
    """

    ecus: tuple[EcuConfig, ...]

    @property
    def lines(self) -> tuple[str, ...]:
        """No line: the devices are listed with the nodes."""
        return ()

    def attached(self, session: object, config: BenchConfig) -> AbstractContextManager[object]:  # noqa: ARG002 - of every part
        """Return a context without content: the devices act in the ticks of the bench."""
        return nullcontext()

    def peers(self, config: BenchConfig, surroundings: Surroundings) -> EcuTable:
        """Return the devices, built."""
        return build_ecus(self.ecus, config.buses, surroundings)

    def seen_from(self, bus: str) -> "J1939Part":
        """Return the devices of one bus, which is then the first."""
        ecus = (replace(ecu, bus=FIRST_BUS) for ecu in self.ecus if ecu.bus == bus)
        return J1939Part(tuple(ecus))
