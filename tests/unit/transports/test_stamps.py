"""Stamps of frames while the wall clock is set. The expected ones are those without a step."""

import can
import pytest

from hil_bench.abilities.common.stamps import SteadyStamps

HOUR = 3600.0


class Clocks:
    """A machine of which one second has passed 1000 s after its start."""

    def __init__(self):
        self.steady, self.offset = 1000.0, 1.7e9
        self.stamps = SteadyStamps(lambda: self.steady + self.offset, lambda: self.steady)

    def hear(self, at, stamp):
        """Hear, at a moment of the steady clock, a frame with a stamp."""
        self.steady = at
        return self.stamps.straighten(can.Message(timestamp=stamp)).timestamp


@pytest.mark.parametrize("step", [-HOUR, HOUR, -0.5, 0.5])
@pytest.mark.parametrize("late", [0.0, 0.02])
def test_a_clock_that_is_set_moves_no_frame(step, late):
    """Frames come each 10 ms; those read 20 ms late were stamped before a step that is seen."""
    clocks = Clocks()
    found = []
    for k in range(100):
        moment = 1000.0 + k * 0.01
        was_set = k >= 50
        stamp = 1.7e9 + moment + step * was_set
        clocks.offset = 1.7e9 + step * (moment + late >= 1000.5)
        found.append(clocks.hear(moment + late, stamp) - 1.7e9 - 1000.0)
    assert found == pytest.approx([k * 0.01 for k in range(100)], abs=1e-6)


def test_the_stamps_of_an_adapter_with_its_own_clock_stay_as_they_are():
    clocks = Clocks()
    for k in range(20):
        clocks.offset = 1.7e9 - HOUR * (k >= 10)
        assert clocks.hear(1000.0 + k, 5.0 + k) == 5.0 + k


def test_a_backlog_and_a_clock_that_is_slewed_are_no_steps():
    """Ten frames of one second are read at once, while NTP slews by 500 ppm (adjtimex(2))."""
    clocks = Clocks()
    for k in range(1000):
        clocks.offset = 1.7e9 + k * 5e-4
        stamp = 1.7e9 + 1000.0 + k * 1.0005
        assert clocks.hear(1000.0 + 10 * (k // 10 + 1), stamp) == stamp
