"""The surroundings of a device when it is built: the axes of the bench, its tick and its seed."""

from collections.abc import Mapping
from typing import NamedTuple

from hil_bench.devices.measurement.chain import MeasuringChain
from hil_bench.devices.measurement.low_pass import ChainParameters, random_stream
from hil_bench.plants.plant import AxisConfig


class Surroundings(NamedTuple):
    """The bench as a device sees it.

    Attributes:
        tick_ns: time between two ticks [ns].
        seed: of every random generator.
        axes: by name.
        full_scales: the command of 100 % of each axis [SI].
    """

    tick_ns: int
    seed: int
    axes: Mapping[str, AxisConfig]
    full_scales: Mapping[str, float]

    def chain(self, parameters: ChainParameters, name: str) -> MeasuringChain | None:
        """Return the measuring chain of the sensor of a name, None where it is ideal."""
        if parameters.is_ideal:
            return None
        return MeasuringChain(parameters, self.tick_ns, random_stream(self.seed, name))
