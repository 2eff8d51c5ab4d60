"""The drivers of `hil_drivers.j1939` against the bench's J1939 devices."""

import math
from pathlib import Path

import can
import pytest

from hil_bench import VirtualBench, load_config
from hil_drivers import (
    AddressClaimError,
    DeviceFaultError,
    DriverTimeoutError,
    Network,
    PositionSensor,
    RequestRefusedError,
    StaleValueError,
)
from hil_drivers.j1939 import AuxiliaryValve, ClaimState, ExitReason, FlowState, J1939Port, Name

EXAMPLE = Path(__file__).parents[3] / "examples" / "j1939.toml"
OURS, VALVE = 39, 128


@pytest.fixture
def bench():
    with VirtualBench(load_config(EXAMPLE)) as bench:
        bench.run(0.3)
        yield bench


@pytest.fixture
def network(bench):
    with Network(bench.bus, clock=bench.now) as network:
        yield network


@pytest.fixture
def port(network):
    port = J1939Port(network, Name(identity=7), OURS)
    assert port.claim() == OURS
    return port


@pytest.fixture
def valve(port):
    with AuxiliaryValve(port, VALVE) as valve:
        valve.setup()
        yield valve


def test_the_valve_follows_its_set_point_while_the_caller_waits(bench, network, valve):
    valve.spool_setpoint = 0.4
    network.pump(1.0)  # longer than the valve's time-out of 300 ms

    assert bench.values["axis1.spool_setpoint"] == 0.4
    assert valve.flow == pytest.approx(0.4, abs=0.011)  # 1 % a bit
    assert (valve.state, valve.exit_reason) == (FlowState.EXTEND, ExitReason.NONE)
    valve.check_active()
    valve.spool_setpoint = -0.2
    network.pump(0.3)
    assert bench.values["axis1.spool_setpoint"] == -0.2
    assert valve.state is FlowState.RETRACT


def test_the_end_blocks_the_valve(bench, network, port):
    with AuxiliaryValve(port, VALVE) as valve:
        valve.spool_setpoint = 0.4
        network.pump(0.05)
    network.pump(0.05)
    assert bench.values["axis1.spool_setpoint"] == 0.0
    assert bench.ecus["valve"].trouble_codes == []


def test_the_name_and_what_it_is_made_of_are_asked_for(valve):
    # examples/j1939.toml: function 129, industry group 2, "HIL*AUX VALVE*0001*1*": 21 bytes come by
    # RTS and CTS.
    assert valve.name is not None
    assert (valve.name.function, valve.name.industry_group) == (129, 2)
    assert valve.component() == ("HIL", "AUX VALVE", "0001", "1")


def test_a_group_that_it_does_not_have_is_refused(valve):
    with pytest.raises(RequestRefusedError, match=r"^J1939 address 128: PGN 65262: refused$"):
        valve.request(65262)


@pytest.mark.parametrize(
    ("answer", "error", "why"),  # SAE J1939-21: the control byte of an acknowledgement
    [
        ("01 ff ff ff 27 ee fe 00", RequestRefusedError, "refused"),
        ("02 ff ff ff 27 ee fe 00", RequestRefusedError, "access denied"),
        ("03 ff ff ff ff ee fe 00", RequestRefusedError, "busy"),  # to all
        ("00 ff ff ff 27 ee fe 00", DriverTimeoutError, "not within 1.25 s"),  # positive
        ("04 ff ff ff 27 ee fe 00", DriverTimeoutError, "not within 1.25 s"),
        ("01 ff ff ff 28 ee fe 00", DriverTimeoutError, "not within 1.25 s"),  # to another one
        ("01 ff ff ff 27 ed fe 00", DriverTimeoutError, "not within 1.25 s"),  # another group
    ],
)
def test_a_refusal_says_why(network, port, answer, error, why):
    refusal = can.Message(arbitration_id=0x18E8FF05, data=bytes.fromhex(answer))
    due = network.now() + 0.1

    def refuse(now):
        nonlocal due
        if now >= due:
            due = math.inf
            network.deliver(refusal)
        return due

    network.add_service(refuse)
    with pytest.raises(error, match=f"^J1939 address 5: PGN 65262: {why}$"):
        port.request(65262, 5)


@pytest.mark.usefixtures("port")
@pytest.mark.parametrize(("asked", "answers"), [("00 ee 00", 1), ("00 ee 01", 0), ("00 ed 00", 0)])
def test_our_address_is_said_where_it_is_asked_for(bench, network, asked, answers):
    network.pump(0.01)
    before = len(list(bench.frames))
    network.deliver(can.Message(arbitration_id=0x18EA2705, data=bytes.fromhex(asked)))
    network.pump(0.01)
    said = [each.frame.can_id for each in list(bench.frames)[before:]]
    assert said.count(0x18EEFF00 | OURS) == answers


@pytest.mark.parametrize(
    ("lamps", "names"),  # SAE J1939-73: two bits each, 01 is on, 11 not available
    [
        (0x01, {"protect"}),
        (0x04, {"warning"}),
        (0x10, {"stop"}),
        (0x40, {"malfunction"}),
        (0xFF, set()),
        (0xAA, set()),
        (0x55, {"protect", "warning", "stop", "malfunction"}),
    ],
)
def test_a_dm1_shows_lamps_and_codes_and_when_it_came(network, valve, lamps, names):
    # SPN 0x7_1234, FMI 9, conversion method 4 with its bit 0, 5 occurrences; the rest is empty.
    data = bytes([lamps, 0xFF, 0x34, 0x12, 0xE9, 0x05])
    network.deliver(can.Message(arbitration_id=0x18FECA80, data=data))
    assert valve.lamps == names
    assert valve.trouble_codes == ((0x71234, 9, 5),)
    assert valve.reported_at == network.now()


def test_nobody_answers(port):
    with pytest.raises(
        DriverTimeoutError, match=r"^J1939 address 5: PGN 60928: not within 1\.25 s$"
    ):
        AuxiliaryValve(port, 5).setup()


def test_a_time_out_is_told_by_message_and_code(network, valve):
    valve.spool_setpoint = 0.4
    network.pump(0.1)
    valve._due = math.inf  # a program that hangs
    network.pump(0.6)

    assert valve.exit_reason is ExitReason.TIMEOUT
    assert [code[:2] for code in valve.trouble_codes] == [(1907, 9)]
    assert valve.lamps == {"warning"}
    with pytest.raises(DeviceFaultError, match="TIMEOUT; it reports SPN 1907 FMI 9"):
        valve.check_active()


def test_several_codes_come_by_transport(bench, network, valve):
    with (
        bench.faults.report("valve", spn=100, fmi=3),
        bench.faults.report("valve", spn=0x7FFFF, fmi=1),
    ):
        network.pump(0.3)
        assert [code[:2] for code in valve.trouble_codes] == [(100, 3), (0x7FFFF, 1)]
    network.pump(2.2)
    assert valve.trouble_codes == ()


def test_a_dead_valve_makes_its_values_stale(bench, network, valve):
    network.pump(0.2)
    assert valve.flow == 0.0
    with bench.faults.silence("valve"):
        network.pump(0.5)
        with pytest.raises(StaleValueError, match=r"estimated flow 0\.\d+ s old, 0\.3 s allowed"):
            _ = valve.flow


def test_a_set_point_beyond_the_full_flow_is_refused(valve):
    with pytest.raises(ValueError, match="a fraction from -1 to 1 is right"):
        valve.spool_setpoint = 1.1


def test_sixteen_valves_have_numbers(bench, network, port):
    """Their commands are FE30h to FE3Fh (ISO 11783-7)."""
    AuxiliaryValve(port, VALVE, number=15).spool_setpoint = 0.1
    network.pump(0.01)
    assert 0x0CFE3F00 | OURS in {each.frame.can_id for each in bench.frames}
    with pytest.raises(ValueError, match="auxiliary valve 16: 0 to 15 is right"):
        AuxiliaryValve(port, VALVE, number=16)


def test_a_device_of_a_larger_name_does_not_get_our_address(bench, network, port):
    network.deliver(claim(OURS, identity=8))
    assert (port.state, port.address) == (ClaimState.CLAIMED, OURS)
    network.pump(0.01)
    assert {frame.frame.can_id for frame in list(bench.frames)[-5:]} >= {0x18EEFF00 | OURS}


def test_a_device_of_a_smaller_name_takes_our_address(bench, network, port, valve):
    """That we have none is said by a claim from 254, the null address (SAE J1939-81)."""
    network.deliver(claim(OURS, identity=6))

    assert port.state is ClaimState.LOST
    network.pump(0.5)  # a wait does not raise it
    assert 0x18EEFFFE in {each.frame.can_id for each in bench.frames}
    with pytest.raises(AddressClaimError, match="a device of a smaller NAME has it"):
        valve.spool_setpoint = 0.1


def test_another_address_is_taken_where_the_name_allows_it(bench, network):
    # The industry group of the valve is 2, and it may move too: the smaller NAME stays.
    name = Name(identity=7, industry_group=3, arbitrary_address=1)
    port = J1939Port(network, name, VALVE)
    assert port.claim() not in {VALVE, 140, 19, 254}  # the addresses of examples/j1939.toml
    assert bench.ecus["valve"].address == VALVE


def test_an_address_of_a_smaller_name_cannot_be_had():
    tables = {"j1939": {"valve": {"arbitrary_address": False}}}
    with VirtualBench(load_config(EXAMPLE, tables=tables)) as bench:
        network = Network(bench.bus, clock=bench.now)
        bench.run(0.3)
        name = Name(identity=1, industry_group=3)  # that of the valve is 2
        with pytest.raises(AddressClaimError, match="a device of a smaller NAME has it"):
            J1939Port(network, name, VALVE).claim()


def test_nothing_is_sent_without_an_address(network):
    valve = AuxiliaryValve(J1939Port(network, Name(identity=7), OURS), VALVE)
    with pytest.raises(AddressClaimError, match="none is claimed; call claim"):
        valve.spool_setpoint = 0.1


def test_canopen_devices_are_on_the_same_network(network, valve):
    sensor = PositionSensor(network, 4)
    sensor.setup(transmission_type=255, event_timer=0.01)
    network.start_node(4)
    valve.spool_setpoint = 0.5
    network.pump(0.5)

    assert sensor.position > 0.01
    assert network.counters.malformed == 0


@pytest.mark.usefixtures("port")
def test_a_network_has_one_port(network):
    with pytest.raises(ValueError, match="has a J1939 port already"):
        J1939Port(network, Name(identity=1), 1)


@pytest.mark.usefixtures("valve")
@pytest.mark.parametrize(
    ("can_id", "data"),
    [
        (0x0CFE1080, "7d"),  # an estimated flow that is too short
        (0x18FECA80, "04 ff 01"),
        (0x18EEFF05, "01 02"),
        (0x18EA2780, "00 ee"),
        (0x18EC2780, "10 09 00"),
        (0x18EC2780, "10 00 00 02 ff ca fe 00"),  # no bytes
        (0x18EC2780, "10 09 00 07 ff ca fe 00"),  # seven packets for nine bytes
        (0x18ECFF80, "20 ff ff 01 ff ca fe 00"),  # more bytes than there can be
        (0x18EB2780, "01 00 00 00 00 00 00 00"),  # of no session
        (0x18E8FF80, "01 ff"),
    ],
)
def test_what_is_malformed_is_counted(network, can_id, data):
    before = network.counters.malformed
    network.deliver(
        can.Message(arbitration_id=can_id, data=bytes.fromhex(data), is_extended_id=True)
    )
    assert network.counters.malformed == before + 1


def claim(address, identity):
    data = Name(identity=identity).pack()
    return can.Message(arbitration_id=0x18EEFF00 | address, data=data, is_extended_id=True)
