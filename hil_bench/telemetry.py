"""What is recorded of a bench: one row of SI values a tick.

The spool is in fractions of the valve's full opening, as on the bus.
"""

from hil_bench.bench import Bench
from hil_bench.recording.channels import Channel

AXIS_QUANTITIES = (
    ("position", "m"),
    ("speed", "m/s"),
    ("P_A", "Pa"),
    ("P_B", "Pa"),
    ("spool_setpoint", "-"),
    ("spool_position", "-"),
)


def bench_channels(bench: Bench) -> tuple[Channel, ...]:
    """Return the channels of a row of `sample`, named `AXIS.QUANTITY`."""
    return tuple(
        Channel(f"{axis.name}.{quantity}", unit)
        for axis in bench.axes
        for quantity, unit in AXIS_QUANTITIES
    )


def sample(bench: Bench) -> list[float]:
    """Return the present values of all `bench_channels`, in their order."""
    row: list[float] = []
    for axis, u in zip(bench.axes, bench.commands, strict=True):
        output, full = axis.plant.output, axis.valve.full_opening
        row += (output.x, output.v, output.P_A, output.P_B, u / full, output.nu / full)
    return row
