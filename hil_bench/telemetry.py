"""What is recorded of a bench: one row of SI values a tick.

First what each axis does, then what each of its sensors measures, with the sensor's errors, delay
and noise. The spool is in fractions of the valve's full opening, as on the bus.
"""

from datetime import UTC, datetime

import hil_bench
from hil_bench.bench import Bench
from hil_bench.config import BenchConfig
from hil_bench.recording.channels import Channel
from hil_bench.recording.formats import Heading

AXIS_QUANTITIES = (
    ("position", "m"),
    ("speed", "m/s"),
    ("P_A", "Pa"),
    ("P_B", "Pa"),
    ("spool_setpoint", "-"),
    ("spool_position", "-"),
)


def bench_channels(bench: Bench) -> tuple[Channel, ...]:
    """Return the channels of a row of `sample`: `AXIS.QUANTITY`, then `SENSOR.measured`."""
    channels = [
        Channel(f"{axis.name}.{quantity}", unit)
        for axis in bench.axes
        for quantity, unit in AXIS_QUANTITIES
    ]
    channels += [Channel(f"{sensor.name}.measured", "Pa") for sensor in bench.pressures]
    for position in bench.positions:
        channels.append(Channel(f"{position.name}.measured", "m"))
        channels.append(Channel(f"{position.name}.measured_speed", "m/s"))
    return tuple(channels)


def sample(bench: Bench) -> list[float]:
    """Return the present values of all `bench_channels`, in their order."""
    row: list[float] = []
    for axis, u in zip(bench.axes, bench.commands, strict=True):
        output, full = axis.plant.output, axis.valve.full_opening
        row += (output.x, output.v, output.P_A, output.P_B, u / full, output.nu / full)
    row += [sensor.measured for sensor in bench.pressures]
    for position in bench.positions:
        row += (position.measured, position.measured_speed)
    return row


def recording_heading(config: BenchConfig, *, is_real_time: bool) -> Heading:
    """Return what a recording of a bench says of itself."""
    comment = (
        f"hil-bench {hil_bench.__version__}, {config.path or 'built-in bench'}, seed {config.seed}"
    )
    return Heading(comment, datetime.now(UTC) if is_real_time else None)
