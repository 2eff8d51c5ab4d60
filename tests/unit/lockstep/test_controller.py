"""A controller that lets a bench in lock-step move, whatever the bus between them does."""

import itertools

import can
import pytest
from support.built_in_nodes import NODES
from support.direct_lockstep import DirectLockStep

from hil_bench import BusError, Faults, load_config
from hil_bench.abilities.lockstep.controller import QUIET, LockStepController
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.transports.embedded import EmbeddedBus
from hil_drivers import BusLostError, DriverTimeoutError, Network, SdoAbortError

SYNC = Frame(0x080)
NODE_IDS = (1, 2, 3, 4)
MARK = bytes.fromhex("4018100000000000")  # upload of 0x1018.00
SYNCHRONOUS = bytes.fromhex("2f00180201000000")  # 0x1800.02 = 1: with every SYNC
START_ALL = Frame(0x000, b"\x01\x00")


@pytest.fixture
def config():
    return load_config()


def join(transport, node_ids=NODE_IDS):
    producer = LockStepController(transport, node_ids, clock=transport.clock)
    producer.join()
    return producer


def network_of(producer, config):
    bus = EmbeddedBus(producer.tick, config.sync_period_ns)
    return Network(bus, clock=bus.now)


def marks(frames):
    return [frame for frame in frames if frame.data == MARK]


def session(transport):
    """What the bench says to a controller that starts it and moves the valve."""
    producer = join(transport)
    heard = producer.tick([Frame(0x600 + node, SYNCHRONOUS) for node in NODE_IDS], 0)
    heard += producer.tick([START_ALL], 0)
    for number in range(100):
        setpoint = 0x2000 if number % 50 < 25 else 0xE000
        heard += producer.tick([Frame(0x201, b"\x07\x00" + setpoint.to_bytes(2, "little"))], 0)
    return heard


def test_each_tick_is_one_sync_and_all_that_it_brings(config):
    transport = DirectLockStep(config)
    heard = session(transport)
    assert transport.lockstep.syncs == 102
    assert transport.lockstep.now == 102 * config.tick_ns
    # With each SYNC after the start, but for that whose tick the start came in, one of each node.
    assert [sum(f.can_id == 0x180 + node for f in heard) for node in NODE_IDS] == [101] * 4
    assert not marks(heard)


@pytest.mark.parametrize("bundles", [(1,), (1, 0, 3), (2, 1)])
def test_how_the_bus_bundles_frames_changes_nothing(config, bundles):
    expected = session(DirectLockStep(config))
    # The first look of all finds nothing: that is how a bus that is awake is told.
    whole = itertools.chain((1, 64, 64, 64, 64, 64), itertools.cycle(bundles))
    assert session(DirectLockStep(config, whole)) == expected


def test_the_controllers_own_sync_is_that_of_the_tick(config):
    transport = DirectLockStep(config)
    join(transport).tick([SYNC], 0)
    assert transport.lockstep.syncs == 1


def test_a_node_in_the_middle_of_a_transfer_is_not_asked(config):
    """A second request to a server would end the first; names are longer than one message."""
    transport = DirectLockStep(config)
    network = network_of(join(transport), config)
    names = [network.add_node(node).upload(0x1008) for node in NODE_IDS]
    assert names[3] == b"HIL bench linear encoder"
    assert len(set(names)) == 3  # two of them are pressure transducers


def test_what_the_controller_asks_itself_it_is_told(config):
    network = network_of(join(DirectLockStep(config)), config)
    device_types = [network.add_node(node).upload(0x1000) for node in NODE_IDS]
    profiles = [int.from_bytes(raw[:2], "little") for raw in device_types]
    assert profiles == [408, 404, 404, 406]
    with pytest.raises(SdoAbortError):
        network.add_node(1).upload(0x1018, 5)


def test_an_answer_that_comes_late_is_nobodys(config):
    transport = DirectLockStep(config)
    producer = join(transport)
    late = transport.lockstep.receive(marks(transport.sent)[0])
    for frame in late:
        transport.put(frame)
    assert producer.tick([], 0) == []


def test_a_node_that_falls_silent_is_missed_in_bench_time_and_others_are_asked(config):
    transport = DirectLockStep(config)
    producer = join(transport)
    transport.bench.part(Faults).silence("valve")
    network = network_of(producer, config)
    before = network.now()
    with pytest.raises(DriverTimeoutError):
        network.add_node(1, sdo_timeout=0.2).upload(0x1008)
    assert network.now() - before == pytest.approx(0.2, abs=2e-3)
    asked = [frame.can_id for frame in marks(transport.sent)[len(NODE_IDS) :]]
    # At most one time-out of the machine's clock for all of them, not one for each tick.
    assert asked.count(0x601) <= 1
    assert len(asked) > 200


def test_a_node_that_came_back_stands_in_for_one_that_falls_silent(config):
    """Of two nodes; with one tick in between, in which the other one answers."""
    transport = DirectLockStep(config)
    producer = join(transport, (1, 2))
    for name in ("valve", "pressure_a"):
        with transport.bench.part(Faults).silence(name):
            for _ in range(3):
                producer.tick([], 0)
    assert transport.lockstep.syncs == 6


def test_a_bench_that_is_gone_is_told(config):
    transport = DirectLockStep(config)
    producer = join(transport)
    for node in ("valve", "pressure_a", "pressure_b", "position"):
        transport.bench.part(Faults).silence(node)
    with pytest.raises(can.CanOperationError, match="no answer from node 1 and 2 and 3 within 2 s"):
        producer.tick([], 0)


@pytest.mark.parametrize(
    ("node_ids", "told"), [((5, 6), "no node answers"), ((4, 5), "only node 4 answers")]
)
def test_a_bus_with_too_few_nodes_is_refused(config, node_ids, told):
    with pytest.raises(BusError, match=f"direct: {told}; lock-step needs two"):
        join(DirectLockStep(config), node_ids)


class Awake(DirectLockStep):
    """A bench that sends by itself, ten times a second."""

    def wait(self, timeout):
        if not super().wait(min(timeout, 0.1)):
            self.put(Frame(0x704, b"\x05"))
        return True


def test_a_bus_on_which_time_passes_by_itself_is_refused(config):
    with pytest.raises(BusError, match="frame 0x704 came unasked; lock-step needs a bus on which"):
        join(Awake(config))


@pytest.mark.parametrize("ticks", [0, 2])
def test_a_frame_between_two_syncs_ends_it_but_what_was_to_be_sent_is_sent(config, ticks):
    """So that on a machine that is in real time the command to close the valve still comes."""
    transport = DirectLockStep(config)
    producer = join(transport)
    for _ in range(ticks):
        producer.tick([], 0)
    transport.put(Frame(0x704, b"\x05"))
    close = Frame(0x201, bytes(4))
    with pytest.raises(can.CanOperationError, match="frame 0x704 came unasked"):
        producer.tick([close], 0)
    assert close in transport.sent


@pytest.mark.parametrize("node_id", [4, 127])
def test_real_time_shows_itself_at_the_first_heartbeat(tmp_path, node_id):
    """A bench in real time that sent nothing before: the drivers switch its heartbeat on."""
    file = tmp_path / "bench.toml"
    text = NODES.replace("node_id = 4", f"node_id = {node_id}")
    file.write_text(f"[plant.axis1]\n{text}", encoding="utf-8")
    config = load_config(file)
    transport = DirectLockStep(config)
    producer = join(transport, (1, 2, 3, node_id))
    switch_on = Frame(0x600 + node_id, bytes.fromhex("2b17100001000000"))  # 0x1017: 1 ms
    heartbeat = 0x700 + node_id

    def wait(timeout):
        if timeout == QUIET:
            transport.put(Frame(heartbeat, b"\x7f"))
        return DirectLockStep.wait(transport, timeout)

    transport.wait = wait
    network = network_of(producer, config)
    network.send(switch_on.can_id, switch_on.data)
    with pytest.raises(BusLostError, match=f"frame 0x{heartbeat:03X} came unasked"):
        network.pump(0.01)


def test_only_the_first_heartbeat_costs_a_pause(config):
    """With one a tick, as 0x1017 = 1 ms asks for, a pause each would be 300 times real time."""
    transport, pauses = DirectLockStep(config), []
    producer = join(transport)

    def wait(timeout):
        pauses.append(timeout)
        return DirectLockStep.wait(transport, timeout)

    transport.wait = wait
    producer.tick([Frame(0x604, bytes.fromhex("2b17100001000000"))], 0)
    heard = [frame for _ in range(5) for frame in producer.tick([], 0)]
    assert sum(frame.can_id == 0x704 for frame in heard) == 5
    assert pauses.count(QUIET) == 1


def test_after_an_interruption_the_rest_of_the_answers_is_no_surprise(config, monkeypatch):
    transport = DirectLockStep(config)
    producer = join(transport)

    def interrupt(_timeout):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(transport, "wait", interrupt)
        with pytest.raises(KeyboardInterrupt):
            producer.tick([START_ALL], 0)
    heard = producer.tick([Frame(0x604, bytes.fromhex("4000100000000000"))], 0)
    assert heard[-1].can_id == 0x584


def test_answers_without_end_are_refused(config):
    class Parrot(DirectLockStep):
        """Node 1 repeats its answer to the first request for ever."""

        def receive(self, limit):
            frames = super().receive(limit)
            answers = [f for f in frames if f.can_id == 0x581]
            for frame in answers[:1]:
                self.put(frame)
            self._clock += 0.01
            return frames

    with pytest.raises(BusError, match="direct: SDO answers come without end"):
        join(Parrot(config))
