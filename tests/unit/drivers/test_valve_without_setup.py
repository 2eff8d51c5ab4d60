"""A valve that somebody else has set up: the driver commands it with what its EDS file says."""

from hil_drivers import ProportionalValve


def test_the_reference_value_is_that_of_the_eds_file_until_setup_reads_it(network, bus):
    valve = ProportionalValve(network, 1)
    valve.spool_setpoint = 0.5
    # Control word 0 and, as 0x6311.01 of our EDS file is 0x4000, a set-point of 0x2000.
    assert bus.sent == ["201#00.00.00.20"]
