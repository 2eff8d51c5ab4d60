"""The recorded channels of a bench: one row of SI values a tick.

First what each axis does, then what each of its sensors measures, with the sensor's errors, delay
and noise. The spool is in fractions of the valve's full opening, as on the bus.
"""

from hil_bench.bench.bench import Bench
from hil_bench.outside.recording.channels import Channel


def bench_channels(bench: Bench) -> tuple[Channel, ...]:
    """Return the channels of a row of `sample`: `AXIS.QUANTITY`, then `SENSOR.measured`."""
    channels = [
        Channel(f"{axis.name}.{quantity.name}", quantity.unit)
        for axis in bench.axes
        for quantity in axis.recorded
    ]
    channels += [Channel(*channel) for sensor in bench.sensors for channel in sensor.channels]
    return tuple(channels)


def sample(bench: Bench) -> list[float]:
    """Return the present values of all `bench_channels`, in their order."""
    row: list[float] = []
    for axis, commanded in zip(bench.axes, bench.commands, strict=True):
        row += axis.row(commanded)
    for sensor in bench.sensors:
        row.append(sensor.measured / sensor.full)
        if sensor.rate_path is not None:
            row.append(sensor.measured_rate)
    return row
