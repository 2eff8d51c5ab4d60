"""A bench on two buses: who hears whom, and which bus a frame is on.

The example puts the valve with node-ID 1 on the first bus and three sensors with node-IDs 1 to 3 on
the second; identifiers are those of the predefined connection set (CiA 301).
"""

from pathlib import Path

import can
import pytest

from hil_bench import Faults, VirtualBench, load_config
from hil_bench.abilities.lockstep.lockstep import LockStep
from hil_bench.bench.assembly import build_bench
from hil_bench.bench.session import Session
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.frame import address_of
from hil_drivers import Network, PositionSensor, ProportionalValve

EXAMPLE = Path(__file__).parents[2] / "examples" / "two_buses.toml"
TICK = 1_000_000
START_ALL = b"\x01\x00"
VENDOR = bytes.fromhex("4018100100000000")  # SDO upload of 0x1018.01


@pytest.fixture
def bench():
    bench = build_bench(load_config(EXAMPLE))
    bench.start(0)
    return bench


def test_each_node_boots_on_its_own_bus(bench):
    boot = b"\x00"
    assert bench.tick([], 0) == [
        Frame(0x701, boot),
        *(Frame(0x700 + node_id, boot, bus=1) for node_id in (1, 2, 3)),
    ]


def test_nmt_reaches_the_nodes_of_its_bus_alone(bench):
    bench.tick([], 0)
    bench.tick([Frame(0, START_ALL, bus=1)], TICK)
    states = [node.state for node in bench.nodes]
    assert states == [NmtState.PRE_OPERATIONAL, *[NmtState.OPERATIONAL] * 3]


@pytest.mark.parametrize("bus", [0, 1])
def test_of_two_nodes_with_one_node_id_the_one_on_the_bus_answers(bench, bus):
    bench.tick([], 0)
    request = Frame(0x601, VENDOR, bus=bus)
    (answer,) = bench.tick([request], TICK)
    assert (answer.can_id, answer.bus) == (0x581, bus)
    assert bench.is_timeless(request)
    (served,) = bench.serve([request], TICK)
    assert (served.can_id, served.bus) == (0x581, bus)


def test_a_frame_of_a_bus_that_is_not_there_is_for_nobody(bench):
    bench.tick([], 0)
    assert bench.tick([Frame(0x601, VENDOR, bus=7)], TICK) == []
    assert bench.unrouted == 1


def test_what_it_listens_to_tells_identifier_and_bus(bench):
    bench.tick([], 0)
    requests = {0x601, address_of(0x601, 1), address_of(0x602, 1), address_of(0x603, 1)}
    assert requests <= bench.routes.keys()
    assert address_of(0x602, 0) not in bench.routes


def test_nodes_of_one_bus_do_not_overhear_the_other():
    """The position sensor would lose the heartbeat of node 1 if that of the valve did for it."""
    bench = build_bench(load_config(EXAMPLE))
    bench.start(0)
    bench.tick([], 0)
    consumer = Frame(0x603, bytes.fromhex("23161001 0a000100".replace(" ", "")), bus=1)  # node 1
    (written,) = bench.tick([consumer], TICK)
    assert written.data[0] == 0x60
    producer = Frame(0x601, bytes.fromhex("2b17100005000000"))  # the valve: each 5 ms, on bus 0
    for now in range(2, 40):
        bench.tick([producer] if now == 2 else [], now * TICK)
    # Heartbeat consumption begins with the first heartbeat, so nothing is lost and nothing said.
    position = bench.nodes[3]
    assert position.object_dictionary.find(0x1001).value == 0
    bench.tick([Frame(0x601, producer.data, bus=1)], 40 * TICK)
    for now in range(41, 60):
        bench.tick([], now * TICK)
    assert position.object_dictionary.find(0x1001).value == 0  # pressure_a is heard, and in time


def test_a_babbling_node_floods_its_own_bus(bench):
    bench.tick([], 0)
    with bench.part(Faults).babble("position", 3):
        sent = bench.tick([], TICK)
    assert [(frame.can_id, frame.bus) for frame in sent] == [(0x001, 1)] * 3


def test_a_fault_on_the_line_leaves_the_frame_on_its_bus(bench):
    bench.tick([], 0)
    with bench.part(Faults).delay("position", 0.002, direction="sent"):
        assert bench.tick([Frame(0x603, VENDOR, bus=1)], TICK) == []
        bench.tick([], 2 * TICK)
        (late,) = bench.tick([], 3 * TICK)
    assert (late.can_id, late.bus) == (0x583, 1)


def test_in_lock_step_the_sync_of_the_first_bus_counts(bench):
    lockstep = LockStep(Session(bench), tick_ns=TICK)
    bench.tick([], 0)
    lockstep.receive(Frame(0x080, bus=1))
    assert lockstep.now == 0
    lockstep.receive(Frame(0x080))
    assert lockstep.now == TICK


def test_drivers_control_an_axis_over_both_buses():
    config = load_config(EXAMPLE)
    with VirtualBench(config) as bench:
        actuators = Network(bench.buses["bus"], clock=bench.now)
        sensors = Network(bench.buses["sensors"], clock=bench.now)
        valve, position = config.nodes[0], config.nodes[3]
        with actuators, sensors, ProportionalValve(actuators, valve.node_id, valve.eds) as driver:
            encoder = PositionSensor(sensors, position.node_id, position.eds)
            driver.setup(transmission_type=254, event_timer=0.005, command_timeout=0.0)
            encoder.setup(transmission_type=254, event_timer=0.005)
            actuators.start_node(valve.node_id)
            sensors.start_node(position.node_id)
            driver.enable()
            driver.spool_setpoint = 0.6
            for _ in range(500):
                actuators.pump(0.001)
                sensors.pump(0.0)
            # 0.6 mm of spool with 0.3 mm of overlap drives the piston at some 0.1 m/s (Table I).
            assert encoder.position > 0.01
            assert encoder.position == pytest.approx(bench.values["axis1.position"], abs=1e-3)


def test_waiting_on_either_bus_lets_time_pass_for_both():
    with VirtualBench(load_config(EXAMPLE)) as bench:
        first, second = bench.buses.values()
        assert first is bench.bus
        message = second.recv(1.0)
        assert (message.arbitration_id, message.timestamp) == (0x701, 0.001)
        assert first.now() == second.now() == 0.001
        assert first.recv(0.0).arbitration_id == 0x701
        second.send(can.Message(arbitration_id=0x602, data=VENDOR, is_extended_id=False))
        assert first.recv(0.01) is None
        assert [second.recv(0.0).arbitration_id for _ in range(3)] == [0x702, 0x703, 0x582]


def test_a_bus_that_is_shut_down_leaves_the_other_alone():
    with VirtualBench(load_config(EXAMPLE)) as bench:
        first, second = bench.buses.values()
        assert first.recv(0.01).arbitration_id == 0x701
        first.send(can.Message(arbitration_id=0x601, data=VENDOR, is_extended_id=False))
        second.shutdown()
        assert first.recv(0.01).arbitration_id == 0x581
        with pytest.raises(can.CanOperationError, match="shut down"):
            second.recv(0.0)
