"""A scan listens before it asks, and tells two devices with one node-ID apart from two clients."""

from types import SimpleNamespace

import can
import pytest

from hil_bench.abilities.commissioning import discovery
from hil_bench.abilities.commissioning.discovery import (
    BusTraffic,
    Method,
    Sighting,
    Traffic,
    discover,
    signs_of_operation,
)
from hil_bench.abilities.commissioning.identity import NodeDescription, describe
from hil_bench.abilities.commissioning.survey import survey

READ_DEVICE_TYPE = "4000100000000000"
ONE, OTHER = (0x58A, "4300100098010000"), (0x58A, "4300100094010200")


def traffic(can_id, data, **more):
    """What was heard of one identifier."""
    row = Traffic(can_id, more.pop("is_extended", False), 1, bytes.fromhex(data), **more)
    return BusTraffic(1.0, identifiers={(can_id, row.is_extended): row})


@pytest.mark.parametrize(
    ("heard", "sign"),
    [
        (traffic(0x705, "05"), "node 5 is OPERATIONAL"),
        (traffic(0x705, "85"), "node 5 is OPERATIONAL"),  # bit 7 is the toggle bit of guarding
        (traffic(0x080, ""), "SYNC"),
        (traffic(0x000, "0100"), "NMT"),
        (traffic(0x185, "00"), "TPDO1 of node 5"),
        (traffic(0x505, "00"), "RPDO4 of node 5"),
        (traffic(0x605, READ_DEVICE_TYPE), "another client reads or writes node 5"),
    ],
)
def test_a_bus_in_operation_is_known_by_its_frames(heard, sign):
    assert signs_of_operation(heard) == (sign,)


@pytest.mark.parametrize(
    "heard",
    [
        BusTraffic(1.0),
        traffic(0x705, "7f"),
        traffic(0x705, "00"),
        traffic(0x705, "04"),
        traffic(0x705, "", is_remote=True),
        traffic(0x085, "0050110000000000"),
        traffic(0x185, "00", is_extended=True),
    ],
)
def test_a_bus_that_only_waits_is_not_in_operation(heard):
    assert signs_of_operation(heard) == ()


def of_nodes(bench):
    """The frames that somebody sends to the nodes from now on."""
    bench.frames.clear()
    return lambda: [logged.frame.can_id for logged in bench.frames if logged.is_received]


@pytest.mark.parametrize("method", [Method.SDO, Method.GUARDING, Method.BOOT_UP])
@pytest.mark.parametrize("lss", [False, True])
def test_nothing_is_sent_to_a_bus_in_operation(open_bench, method, lss):
    bench, network = open_bench()
    network.start_node()
    network.pump(0.1)
    sent = of_nodes(bench)
    found = survey(network, method, lss=lss)
    assert "TPDO1 of node 1" in found.operation
    assert found.unconfigured is None
    assert sent() == []


def test_a_bus_in_operation_is_asked_by_who_insists(open_bench):
    _bench, network = open_bench()
    network.start_node()
    network.pump(0.1)
    found = survey(network, Method.SDO, insists=True)
    assert found.operation == ()
    assert [node.node_id for node in found.nodes] == [1, 2, 3, 4]


def test_a_quiet_bus_is_asked(open_bench):
    bench, network = open_bench()
    network.pump(0.1)
    sent = of_nodes(bench)
    found = survey(network, Method.SDO)
    assert (found.operation, found.unconfigured) == ((), None)
    assert [node.device_type is not None for node in found.nodes] == [True] * 4
    assert 0x601 in sent()


def test_the_answer_to_another_client_is_no_second_device(device, device_network):
    """Somebody reads 0x1000 of the same node meanwhile, and gets an answer of his own."""
    device.answer(0x60A, READ_DEVICE_TYPE, (0x60A, READ_DEVICE_TYPE), ONE, ONE)
    assert discover(device_network, Method.SDO) == [Sighting(10, None, 1)]
    device.answer(0x60A, READ_DEVICE_TYPE, (0x60A, READ_DEVICE_TYPE), ONE, OTHER, OTHER)
    assert discover(device_network, Method.SDO) == [Sighting(10, None, 2)]


@pytest.mark.parametrize(("others", "clash"), [([], True), ([(0x60A, "4018100400000000")], False)])
def test_two_serial_numbers_are_two_devices(device, device_network, others, clash):
    """Two devices of one type answer 0x1000 by one frame, and 0x1018.04 by two."""
    device.refuse_all(10)
    device.answer(0x60A, READ_DEVICE_TYPE, ONE)
    serial = (0x58A, "4318100401000000"), (0x58A, "4318100402000000")
    device.answer(0x60A, "4018100400000000", *others, *serial)
    found = describe(device_network, Sighting(10, None, 1))
    assert found.clash is clash
    assert found.device_type == (None if clash else 0x198)  # the words of two are not shown


@pytest.fixture
def ask_one(monkeypatch):
    """Survey a bus on which node 10 says its 0x1017 [ms], and these frames come at these times."""

    def ask(period, method, *frames):
        now = 0.0
        network = SimpleNamespace(observe=None, now=lambda: now)

        def discover(_network, asked_by, **_options):
            nonlocal now
            for at, message in frames if asked_by is Method.HEARTBEAT else ():
                now = at
                network.observe(message)
            return [Sighting(10, None, 1)]

        monkeypatch.setattr(discovery, "discover", discover)
        said = NodeDescription(10, None, clash=False, heartbeat_ms=period)
        monkeypatch.setattr("hil_bench.abilities.commissioning.survey.describe", lambda *_: said)
        return survey(network, method, insists=True)

    return ask


def beats(*times, data=b"\x7f", **more):
    """Frames of error control of node 10 at these times [s]."""
    return [
        (at, can.Message(arbitration_id=0x70A, data=data, is_extended_id=False, **more))
        for at in times
    ]


REMOTE = beats(0.0, data=b"", is_remote_frame=True)


@pytest.mark.parametrize(
    ("period", "frames", "problem"),
    [
        (0, beats(0.4), "a heartbeat came, though 0x1017 is 0"),
        # one each second, and another one 0.3 s later
        (1000, beats(0.0, 0.3, 1.0, 1.3, 2.0), "a heartbeat came every 500 ms, though 0x1017 is"),
        (1000, beats(0.1, 0.43, 0.76, 1.09), "a heartbeat came every 330 ms, though 0x1017 is"),
        (0, [], ""),
        (0, beats(0.4, data=b"\0"), ""),  # a boot-up
        (0, [*REMOTE, *beats(0.1)], ""),  # a master guards the node
        (1000, beats(0.0, 1.0, 2.0), ""),
        (1000, beats(0.0, 0.3), ""),  # too few to say so
        (1000, [*beats(0.0, 0.3), *beats(0.4, data=b"\0"), *beats(0.5, 1.5)], ""),
        (None, beats(0.0, 0.3, 0.6), ""),  # it does not say its period
    ],
)
def test_heartbeats_that_do_not_fit_are_perhaps_of_another(ask_one, period, frames, problem):
    found = ask_one(period, Method.SDO, *frames)
    (node,) = found.nodes
    assert node.problem.startswith(problem)
    assert bool(node.problem) is bool(problem)
    assert found.doubtful == ((10,) if problem else ())
    assert not node.clash  # nobody has seen two


def test_answers_to_guarding_are_no_heartbeats_that_do_not_fit(ask_one):
    assert ask_one(0, Method.GUARDING, *beats(0.4)).doubtful == ()
