"""What a controller sees of each fault, with the fixtures of the pytest plugin."""

import math

import numpy as np
import pytest

from hil_drivers import DeviceFaultError, StaleValueError, ValveState

BAR = 1e5


def emcys(bench, node_id):
    """Return the error codes that a node has sent."""
    return [
        int.from_bytes(logged.frame.data[:2], "little")
        for logged in bench.frames
        if logged.frame.can_id == 0x080 + node_id and not logged.is_received
    ]


def frames(bench, can_id):
    """Return time [ms] and data of the frames that the bench has sent with an identifier."""
    return [
        (logged.now // 1_000_000, logged.frame.data)
        for logged in bench.frames
        if logged.frame.can_id == can_id and not logged.is_received
    ]


def true(bench, name):
    return bench.signals[f"axis1.{name}"][-1]


def extend(bench, valve, duration=0.2):
    valve.enable()
    valve.spool_setpoint = 0.4
    bench.run(duration)


class TestSensors:
    def test_frozen(self, bench, faults, valve, position):
        extend(bench, valve)
        with faults.freeze("position"):
            bench.run(0.01)
            frozen = position.position
            bench.run(0.2)
            assert position.position == frozen
            assert position.speed == 0.0
            assert true(bench, "position") > frozen + 0.01
        bench.run(0.01)
        assert position.position == pytest.approx(true(bench, "position"), abs=2e-3)
        assert position.speed > 0.05

    def test_offset(self, bench, faults, pressure):
        bench.run(0.05)
        with faults.offset("pressure_a", 20 * BAR):
            bench.run(0.01)
            assert pressure.pressure == pytest.approx(true(bench, "P_A") + 20 * BAR, rel=1e-6)
        bench.run(0.01)
        assert pressure.pressure == pytest.approx(true(bench, "P_A"), rel=1e-6)

    def test_drift(self, bench, faults, position):
        faults.drift("position", 0.1)
        bench.run(0.1)
        first = position.position
        bench.run(0.1)
        assert position.position - first == pytest.approx(0.01, rel=1e-3)  # 0.1 m/s for 0.1 s
        assert position.speed == pytest.approx(0.1, rel=1e-3)

    def test_noise(self, bench, faults, pressure):
        faults.noise("pressure_a", 5 * BAR)
        seen = []
        for _ in range(200):
            bench.run(0.005)
            seen.append(pressure.pressure)
        # Five standard deviations of an RMS from 200 samples: 5 / sqrt(400).
        assert np.std(seen) == pytest.approx(5 * BAR, rel=0.25)

    def test_broken_wire_without_a_value(self, bench, faults, pressure):
        with faults.break_wire("pressure_a"):
            bench.run(0.01)
            assert not pressure.is_valid
            assert math.isnan(pressure.pressure)
        bench.run(0.01)
        assert pressure.is_valid
        assert emcys(bench, 2) == [0xF001, 0x0000]

    @pytest.mark.parametrize(("reads", "status"), [("high", 0x03), ("low", 0x05)])
    def test_broken_wire_beyond_the_range(self, bench, faults, pressure, reads, status):
        faults.break_wire("pressure_a", reads)
        bench.run(0.01)
        assert not pressure.is_valid
        assert pressure.node.read_integer(0x6150, 1) == status

    def test_broken_wire_of_a_position_sensor(self, bench, faults, position):
        with faults.break_wire("position"):
            bench.run(0.01)
            assert not position.is_valid  # by the EMCY
            assert position.node.read_integer(0x6503) == 1  # alarm: position error
        bench.run(0.01)
        assert position.is_valid
        assert position.node.read_integer(0x6503) == 0
        assert emcys(bench, 4) == [0x1000, 0x0000]

    def test_slow(self, bench, faults, valve, position):
        extend(bench, valve)
        steady = true(bench, "position") - position.position
        faults.slow("position", 0.05)
        bench.run(0.5)
        # A ramp is shown a time constant late: 0.05 s times its speed.
        speed = bench.signals["axis1.speed"][-1]
        late = true(bench, "position") - position.position
        assert late - steady == pytest.approx(0.05 * speed, rel=0.1)


class TestValves:
    def test_stuck(self, bench, faults, valve):
        extend(bench, valve)
        stuck = true(bench, "spool_position")
        with faults.stick("valve"):
            valve.spool_setpoint = 0.0
            bench.run(0.2)
            assert true(bench, "spool_position") == pytest.approx(stuck, abs=1e-6)
            assert valve.spool_position == pytest.approx(stuck, abs=1e-4)
        bench.run(0.05)
        assert valve.spool_position == pytest.approx(0.0, abs=1e-3)

    def test_a_stuck_spool_trips_the_deviation_monitoring(self, bench, faults, valve):
        valve.node.write(0x6351, 0, 1)  # monitoring on
        valve.node.write(0x6352, 1, 20)  # after 20 ms
        valve.node.write(0x6354, 1, 1000)
        valve.node.write(0x6355, 1, -1000)
        extend(bench, valve)
        faults.stick("valve")
        valve.spool_setpoint = -0.4
        bench.run(0.1)
        with pytest.raises(DeviceFaultError):
            valve.check_active()
        assert 0x8301 in emcys(bench, 1)

    def test_inverted(self, bench, faults, valve):
        with faults.invert("valve"):
            with faults.invert("valve"):
                extend(bench, valve)
                assert valve.spool_position == pytest.approx(0.4, rel=1e-2)  # twice is never
            bench.run(0.05)
            assert valve.spool_position == pytest.approx(-0.4, rel=1e-2)
        bench.run(0.05)
        assert valve.spool_position == pytest.approx(0.4, rel=1e-2)

    def test_sluggish(self, bench, faults, valve):
        faults.slow("valve", 0.1)
        extend(bench, valve, duration=0.1)
        # After one time constant 1 - 1/e of the step is done; the spool's own lag is 1 ms.
        assert true(bench, "spool_position") == pytest.approx(0.4 * (1 - math.exp(-1)), rel=0.05)
        bench.run(1.0)
        assert valve.spool_position == pytest.approx(0.4, rel=1e-2)

    def test_loss_of_enable(self, bench, faults, valve):
        extend(bench, valve)
        with faults.disable("valve"):
            bench.run(0.05)
            assert valve.state is ValveState.DISABLED
            assert valve.spool_position == pytest.approx(0.0, abs=1e-3)
            valve.spool_setpoint = 0.4  # control word ACTIVE does not help
            bench.run(0.05)
            assert valve.state is ValveState.DISABLED
        bench.run(0.05)
        assert valve.state is ValveState.DISABLED  # a new control word is needed
        valve.enable()
        valve.spool_setpoint = 0.4
        bench.run(0.05)
        assert valve.spool_position == pytest.approx(0.4, rel=1e-2)

    def test_supply_pressure_drop(self, bench, faults, valve):
        def travel(duration):
            start = true(bench, "position")
            bench.run(duration)
            return true(bench, "position") - start

        extend(bench, valve)
        healthy = travel(0.4)
        with faults.drop_supply("axis1", 20 * BAR):
            bench.run(0.05)
            # Flow goes with the root of the pressure: sqrt(20 / 100) is 0.45, less friction.
            assert 0.0 < travel(0.4) < 0.45 * healthy
            assert true(bench, "P_A") < 20 * BAR
        bench.run(0.05)
        assert travel(0.4) > 0.8 * healthy  # the chambers had to fill first


class TestTheBus:
    def test_a_silent_sensor_is_stale_and_comes_back(self, bench, faults, position):
        with faults.silence("position"):
            bench.run(0.2)
            with pytest.raises(StaleValueError):
                _ = position.position
        bench.run(0.02)
        assert position.age < 0.02

    def test_a_silent_valve_misses_its_controller(self, bench, faults, valve):
        """Its driver has it watch the controller's heartbeat, 200 ms."""
        extend(bench, valve)
        with faults.silence("valve"):
            bench.run(0.3)
            assert true(bench, "spool_position") == pytest.approx(0.0, abs=1e-3)
        bench.run(0.1)
        assert valve.read_state().is_fault
        valve.network.start_node(1)  # CiA 301: a lost heartbeat leads to PRE-OPERATIONAL
        valve.reset_fault()
        valve.enable()

    def test_a_reset_node_boots_and_has_forgotten(self, bench, faults, valve):
        extend(bench, valve)
        faults.reset("valve")
        bench.run(0.05)
        # Booted again; nobody has told it since to send heartbeats.
        assert [data for _, data in frames(bench, 0x701)][-1] == b"\x00"
        assert true(bench, "spool_position") == pytest.approx(0.0, abs=1e-3)
        assert valve.read_state() is ValveState.INIT

    def test_a_node_without_power_says_nothing_until_it_boots(self, bench, faults):
        bench.run(0.01)
        faults.reset("position", at=0.02, duration=0.1)
        bench.run(0.2)
        assert frames(bench, 0x704) == [(1, b"\x00"), (120, b"\x00")]

    def test_a_node_without_power_measures_nothing_and_has_no_state(self, bench, faults):
        node = bench.bench.nodes[[*bench.nodes].index("pressure_a")]
        bench.run(0.01)
        faults.reset("pressure_a", at=0.02, duration=0.1)
        bench.run(0.05)
        assert math.isnan(bench.signals["pressure_a.measured"][-1])
        assert bench.signals["pressure_b.measured"][-1] == pytest.approx(51.5e5, rel=0.01)
        assert (node.state_name, node.errors) == ("OFF", frozenset())
        bench.run(0.1)
        assert bench.signals["pressure_a.measured"][-1] == pytest.approx(48.5e5, rel=0.01)
        assert (node.state_name, node.errors) == ("PRE-OPERATIONAL", frozenset())
        assert frames(bench, 0x082) == []  # it had no error, before or after

    def test_lost_frames(self, bench, faults, position):
        faults.lose("position", 0.5, can_id=0x184)
        start = bench.now()
        bench.run(1.0)
        came = sum(1 for time, _ in frames(bench, 0x184) if time > start * 1e3)
        # The encoder sends each 5 ms. Five standard deviations: 5 sqrt(200 / 4) = 35.
        assert came == pytest.approx(100, abs=35)
        assert position.node.read_integer(0x6503) == 0  # SDO is not concerned

    def test_late_frames(self, bench, faults, valve, position):
        extend(bench, valve)
        speed = bench.signals["axis1.speed"][-1]
        before = true(bench, "position") - position.position
        faults.delay("position", 0.02, can_id=0x184)
        bench.run(0.1)
        after = true(bench, "position") - position.position
        assert after - before == pytest.approx(0.02 * speed, rel=0.1)

    def test_frames_of_a_wrong_length(self, bench, faults, position):
        """The controller takes no value from a frame that is too short."""
        with faults.truncate("position", 3, can_id=0x184):
            bench.run(0.2)
            assert {len(data) for _, data in frames(bench, 0x184)[-20:]} == {3}
            with pytest.raises(StaleValueError):
                _ = position.position
        bench.run(0.02)
        assert abs(position.position) < 1e-3

    def test_commands_of_a_wrong_length(self, bench, faults, valve):
        extend(bench, valve)
        faults.truncate("valve", 2, direction="received", can_id=0x201)
        valve.spool_setpoint = -0.4
        bench.run(0.05)
        assert 0x8210 in emcys(bench, 1)  # PDO not processed due to length
        assert valve.spool_position == pytest.approx(0.4, rel=1e-2)  # the last command counts

    def test_a_babbling_node(self, bench, faults, position):
        faults.babble("position", 3, can_id=0x010, duration=0.02)
        bench.run(0.1)
        assert len(frames(bench, 0x010)) == 3 * 20
        assert abs(position.position) < 1e-3  # the controller still gets its values
