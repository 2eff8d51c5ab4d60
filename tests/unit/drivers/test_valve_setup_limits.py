"""What the valve's driver refuses before it says anything on the bus, and which fault it tells."""

import pytest

from hil_drivers import ProportionalValve, ValveState


@pytest.fixture
def valve(network):
    return ProportionalValve(network, 1)


@pytest.mark.parametrize("seconds", [-0.001, 65.536, float("nan"), float("inf")])
def test_a_time_that_16_bits_of_milliseconds_cannot_hold_is_refused_at_once(valve, bus, seconds):
    with pytest.raises(ValueError, match="command time-out"):
        valve.setup(command_timeout=seconds)
    assert bus.sent == []


def test_of_several_emergencies_the_last_one_is_told(valve, network, bus):
    bus.play(
        "081#50.82.11.00.00.00.00.00",  # 8250
        "081#30.81.11.00.00.00.00.00",  # 8130
        "081#00.00.00.00.00.00.00.00",  # error reset
    )
    network.pump()
    error = valve._fault(ValveState.FAULT_HOLD)
    assert error.code == 0x8130
    assert "after emergency 0x8130" in str(error)
