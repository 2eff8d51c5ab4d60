"""The recorded row of a bench."""

import pytest
from support.bus_side import BusSide

from hil_bench.bench.session import bench_channels, sample


def test_a_row_has_a_value_a_channel_in_si_units():
    bus = BusSide()
    bus.activate()
    bus.command(0x0007, 8192, count=30)
    row = dict(zip((c.name for c in bench_channels(bus.bench)), sample(bus.bench), strict=True))
    output = bus.plant.output
    expected = {
        "axis1.position": output.x,
        "axis1.speed": output.v,
        "axis1.P_A": output.P_A,
        "axis1.P_B": output.P_B,
        "axis1.spool_setpoint": 0.5,  # 8192 of 16384
        "axis1.spool_position": output.nu / 1.3e-3,  # of alpha + beta (Table I)
        # The built-in bench has ideal sensors.
        "pressure_a.measured": output.P_A,
        "pressure_b.measured": output.P_B,
        "position.measured": output.x,
        "position.measured_speed": output.v,
    }
    assert row == pytest.approx(expected, rel=1e-12)
