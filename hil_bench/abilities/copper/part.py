"""The wire of a bus as a part of the bench's configuration."""

from collections.abc import Mapping
from dataclasses import dataclass

from hil_bench.abilities.copper.build import build_wiring
from hil_bench.abilities.copper.extension import Copper
from hil_bench.abilities.copper.wire.config import WireConfig
from hil_bench.abilities.copper.wiring import Device
from hil_bench.bench.configuration import BenchConfig


@dataclass(frozen=True, slots=True)
class CopperWire(WireConfig):
    """The wire that the table ``[bus.wire]`` describes; `WireConfig` is its data."""

    def medium(self, config: BenchConfig, devices: Mapping[str, Device]) -> Copper:
        """Return the extension for all buses of copper of a bench.

        Args:
            config: the bench.
            devices: those on its buses, by their names.
        """
        return Copper(build_wiring(config, devices))
