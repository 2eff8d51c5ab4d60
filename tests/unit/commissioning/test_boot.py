"""The NMT master on virtual benches; letters, order and objects by CiA 302-2 and 302-3."""

import pytest
from support.eds_sections import VERIFY_CONFIGURATION

from device_profiles import PRESSURE_404
from hil_bench.canopen_device.frame import Frame
from hil_drivers import Network, NmtState
from hil_drivers.boot import NetworkManager
from hil_drivers.boot_records import BootError, Configured, Loss, Slave, Start, Startup
from hil_drivers.concise_dcf import ConciseEntry

BENCH = """
[nodes]
valve = { profile = "valve_408", node_id = 1, serial_number = 7, objects = { "0x1017" = 50 } }
pressure_a = { profile = "pressure_404", node_id = 2, source = "P_A" }
"""
VALVE, PRESSURE = 0x198, 0x0002_0194
HEARTBEAT = ConciseEntry(0x1017, 0, (50).to_bytes(2, "little"))


@pytest.fixture
def lines():
    return []


@pytest.fixture
def make(open_bench, lines):
    """Returns bench and master: make(slaves); without a bench's text, of valve and pressure_a."""

    def make_it(*slaves, text=BENCH, **startup):
        bench, network = open_bench(text)
        manager = NetworkManager(network, slaves, Startup(**startup), lines.append)
        return bench, manager

    return make_it


def commands(bench):
    """What the master has commanded: specifier and node-ID of each frame 000."""
    return [frame.data.hex(" ") for frame in sent(bench, 0)]


def sent(bench, can_id):
    bench.run(0.01)
    return [logged.frame for logged in bench.frames if logged.frame.can_id == can_id]


def states(bench):
    bench.run(0.01)  # what was sent last arrives with the next tick
    return [node.state.name for node in bench.bench.nodes]


def test_a_network_is_reset_checked_and_started(make, lines):
    bench, manager = make(
        Slave(1, "valve", device_type=VALVE, identity=(0, 0x408, 0x10000, 7)),
        Slave(2, device_type=PRESSURE),
    )
    assert manager.boot()
    assert states(bench) == ["OPERATIONAL", "OPERATIONAL"]
    # CiA 301: 130 is reset communication, of all nodes; 1 is start.
    assert commands(bench) == ["82 00", "01 01", "01 02"]
    assert lines == [
        "node 1 (valve): booted, nothing to configure",
        "node 2: booted, nothing to configure",
    ]


@pytest.mark.parametrize(
    ("wrong", "letter", "reason"),
    [
        ({"device_type": 0x191}, "C", "it is 0x00000198; 0x00000191 is right"),
        ({"identity": (0x2D, 0, 0, 0)}, "D", "it is 0x00000000; 0x0000002D is right"),
        ({"identity": (0, 0x409, 0, 0)}, "M", "it is 0x00000408; 0x00000409 is right"),
        ({"identity": (0, 0, 0x20000, 0)}, "N", "it is 0x00010000; 0x00020000 is right"),
        ({"identity": (0, 0, 0, 8)}, "O", "it is 0x00000007; 0x00000008 is right"),
    ],
)
def test_another_device_is_named_and_not_started(make, wrong, letter, reason):
    bench, manager = make(Slave(1, **wrong), Slave(2))
    assert not manager.boot()
    result = manager.results[1]
    assert (result.error, result.reason) == (BootError[letter], reason)
    assert states(bench) == ["PRE_OPERATIONAL", "OPERATIONAL"]


def test_a_missing_mandatory_slave_is_waited_for_until_the_boot_time_is_over(make, lines):
    bench, manager = make(Slave(1), Slave(2), start=Start.ALL, boot_time=5.0)
    bench.faults.silence("pressure_a")
    start = bench.now()
    assert not manager.boot()
    assert 5.0 <= bench.now() - start < 7.0
    assert states(bench)[0] == "PRE_OPERATIONAL"
    (line,) = lines[1:]
    assert line == (
        "node 2: error B, no answer to 0x1000 (device type): no SDO answer within 0.5 s"
    )


def test_a_mandatory_slave_that_comes_late_is_booted(make, lines):
    bench, manager = make(Slave(1), Slave(2), start=Start.ALL, boot_time=10.0)
    bench.faults.silence("pressure_a", duration=4.0)
    assert manager.boot()
    assert states(bench) == ["OPERATIONAL", "OPERATIONAL"]
    assert lines[-1] == "node 2: booted, nothing to configure"
    assert commands(bench)[-1] == "01 00"  # by one command, to all


def test_a_missing_optional_slave_holds_nothing_up(make):
    bench, manager = make(Slave(1), Slave(2, mandatory=False), start=Start.ALL)
    bench.faults.silence("pressure_a", duration=5.0)
    assert manager.boot()
    assert bench.now() < 4.0
    assert states(bench) == ["OPERATIONAL", "PRE_OPERATIONAL"]
    assert manager.watch(5.0)
    assert manager.results[2].is_up
    assert states(bench) == ["OPERATIONAL", "OPERATIONAL"]


def test_the_application_may_start_the_slaves_itself(make):
    bench, manager = make(Slave(1), Slave(2), start=Start.NONE)
    assert manager.boot()
    assert states(bench) == ["PRE_OPERATIONAL", "PRE_OPERATIONAL"]


def test_a_refused_configuration_names_object_and_abort(make):
    ramp = ConciseEntry(0x1017, 0, bytes(4))
    bench, manager = make(Slave(1, configuration=(ramp,)), Slave(2))
    assert not manager.boot()
    result = manager.results[1]
    assert result.error is BootError.J
    # CiA 301: 0607 0012, length of service parameter too high.
    assert result.reason.startswith("cannot write 0x1017: SDO abort 0x06070012")
    assert states(bench)[0] == "PRE_OPERATIONAL"


def test_a_configuration_is_written_before_the_start(make, lines):
    bench, manager = make(Slave(2, configuration=(HEARTBEAT,), heartbeat_time=0.15), Slave(1))
    assert manager.boot()
    assert bench.nodes["pressure_a"]["0x1017"] == 50
    assert lines[0] == "node 2: booted, 1 object written"


def test_defaults_are_restored_by_a_reset_before_a_configuration_is_written(make):
    """0x1011.01 takes "load"; 81 02 resets node 2 (CiA 301), and the write comes behind it."""
    bench, manager = make(Slave(2, configuration=(HEARTBEAT,), restore=1), Slave(1))
    assert manager.boot()
    assert bench.nodes["pressure_a"]["0x1017"] == 50
    bench.run(0.01)
    words = [
        logged.frame.data.hex(" ") for logged in bench.frames if logged.frame.can_id in {0, 0x602}
    ]
    load, reset, write = (
        words.index(word)
        for word in ("23 11 10 01 6c 6f 61 64", "81 02", "2b 17 10 00 32 00 00 00")
    )
    assert load < reset < write


def test_a_slave_without_heartbeat_fails_when_error_control_starts(make):
    _, manager = make(Slave(1, heartbeat_time=0.15), Slave(2, heartbeat_time=0.15))
    assert not manager.boot()
    assert manager.results[1].error is None
    assert manager.results[2].error is BootError.K
    assert manager.results[2].reason == "not within 150 ms"


@pytest.fixture
def stamped_bench(tmp_path):
    text = PRESSURE_404.read_text(encoding="utf-8")
    count = int(text.split("[OptionalObjects]\nSupportedObjects=")[1].split("\n")[0])
    text = text.replace(
        f"[OptionalObjects]\nSupportedObjects={count}\n",
        f"[OptionalObjects]\nSupportedObjects={count + 1}\n{count + 1}=0x1020\n",
    )
    (tmp_path / "stamped.eds").write_text(text + VERIFY_CONFIGURATION, encoding="utf-8")
    return BENCH.replace('"P_A"', '"P_A", eds = "stamped.eds"')


def test_a_configuration_of_the_expected_date_is_kept(make, stamped_bench):
    slave = Slave(
        2, configuration=(HEARTBEAT,), date=15666, time=49_500_000, store=True, keep_alive=True
    )
    bench, manager = make(Slave(1), slave, text=stamped_bench)
    assert manager.boot()
    assert manager.results[2].configured is Configured.WRITTEN
    stamps = [bench.nodes["pressure_a"][name] for name in ("0x1020.01", "0x1020.02")]
    assert stamps == [15666, 49_500_000]
    manager._network.enter_pre_operational(2)
    assert manager.boot()
    assert manager.results[2].configured is Configured.KEPT
    bench.nodes["pressure_a"]["0x1017"] = 60
    manager._network.nodes[2].download(0x1017, 0, b"\x3c\0")  # which clears both (CiA 301)
    manager._network.enter_pre_operational(2)
    assert manager.boot()
    assert manager.results[2].configured is Configured.WRITTEN


def test_a_device_without_0x1020_cannot_keep_a_date(make):
    _, manager = make(Slave(2, configuration=(HEARTBEAT,), date=1))
    assert not manager.boot()
    # CiA 301: 0602 0000, object does not exist.
    assert manager.results[2].reason.startswith("cannot write 0x1020.01: SDO abort 0x06020000")


def test_a_running_slave_that_is_kept_alive_is_not_reset(make, lines):
    bench, manager = make(Slave(1, keep_alive=True, heartbeat_time=0.15), Slave(2))
    manager._network.start_node(1)
    bench.run(0.1)
    before = manager._network.nodes[1].boot_ups
    assert manager.boot()
    assert manager.results[1].error is BootError.L
    assert manager._network.nodes[1].boot_ups == before
    assert commands(bench) == ["01 01", "82 02", "01 02"]
    assert lines[0] == "node 1: error L, was OPERATIONAL already, and is left so"


def test_a_slave_that_is_kept_alive_and_not_running_is_booted(make):
    bench, manager = make(Slave(2, keep_alive=True))
    assert manager.boot()
    assert manager.results[2].error is None
    assert states(bench) == ["PRE_OPERATIONAL", "OPERATIONAL"]


def test_a_slave_kept_alive_whose_state_nobody_tells(make_network, device):
    device.answer(0x602, "4000100000000000", (0x582, "4300100094010200"))
    for slave, error in (
        (Slave(2, keep_alive=True), BootError.F),
        (Slave(2, keep_alive=True, heartbeat_time=0.1), BootError.E),
    ):
        manager = NetworkManager(make_network(device), [slave])
        assert not manager.boot()
        assert manager.results[2].error is error


@pytest.mark.parametrize("text", [BENCH, BENCH.partition("pressure_a")[0]])  # alone: a dead bus
def test_a_lost_slave_is_booted_anew(make, lines, text):
    bench, manager = make(Slave(1, "valve", heartbeat_time=0.15), text=text)
    assert manager.boot()
    heard_at = manager._nodes[1].heard_at
    bench.faults.silence("valve", duration=1.0)
    assert manager.watch(4.0)
    assert lines[-2:] == [
        "node 1 (valve): no heartbeat for 150 ms",
        "node 1 (valve): booted, nothing to configure",
    ]
    assert states(bench)[0] == "OPERATIONAL"
    (reset,) = [each for each in bench.frames if each.frame.data == b"\x82\1"]
    assert 1e-9 * reset.now == pytest.approx(heard_at + 0.15, abs=0.002)
    assert commands(bench) == ["82 00", "01 01", "82 01", "01 01"]


def test_a_slave_that_resets_is_booted_anew(make, lines):
    bench, manager = make(Slave(1), Slave(2))
    assert manager.boot()
    bench.faults.reset("pressure_a", at=bench.now() + 0.1)
    assert manager.watch(1.0)
    assert lines[-2:] == ["node 2: has booted up", "node 2: booted, nothing to configure"]
    assert states(bench) == ["OPERATIONAL", "OPERATIONAL"]
    assert commands(bench) == ["82 00", "01 01", "01 02", "01 02"]


@pytest.mark.parametrize(
    ("loss", "state", "told"),
    [
        (Loss.STOP_ALL, "STOPPED", "all nodes are stopped"),
        (Loss.RESET_ALL, "PRE_OPERATIONAL", "all nodes are reset"),
    ],
)
def test_the_loss_of_a_mandatory_slave_may_end_it_all(make, lines, loss, state, told):
    slaves = Slave(1, heartbeat_time=0.15), Slave(2)
    bench, manager = make(*slaves, start=Start.ALL, loss=loss, boot_time=3.0)
    assert manager.boot()
    bench.faults.silence("valve")
    assert not manager.watch(6.0)
    bench.run(0.01)
    assert told in lines
    assert states(bench)[1] == state


def test_who_is_not_in_the_list_is_named(make, lines):
    bench, manager = make(Slave(1))
    assert manager.boot()
    assert "node 2: error A, it is not in the network list" in lines
    assert states(bench)[1] == "PRE_OPERATIONAL"


def test_a_slave_that_is_only_watched_is_not_started(make):
    bench, manager = make(Slave(1, boots=False, heartbeat_time=0.15), Slave(2))
    assert manager.boot()
    assert states(bench) == ["PRE_OPERATIONAL", "OPERATIONAL"]


def test_the_masters_heartbeat_tells_its_state(make):
    bench, manager = make(Slave(1), Slave(2), start=Start.ALL, boot_time=3.0)
    manager._network.start_heartbeat(127, 0.1)
    assert manager.boot()
    bench.pump(0.2)
    told = [frame.data[0] for frame in sent(bench, 0x77F)]
    assert told[0] == 0
    assert told[1] == NmtState.PRE_OPERATIONAL
    assert told[-1] == NmtState.OPERATIONAL


def test_an_answer_of_a_wrong_length_is_another_device(make_network, device):
    device.answer(0x601, "4000100000000000", (0x581, "4F00100098000000"))
    manager = NetworkManager(make_network(device), [Slave(1, device_type=VALVE)])
    assert not manager.boot()
    assert manager.results[1].reason == "came as 1 bytes; 4 are right"


def test_a_node_id_has_one_slave(make):
    with pytest.raises(ValueError, match="2 slaves have 1 node-IDs"):
        make(Slave(1), Slave(1))


@pytest.fixture
def fall(monkeypatch):
    """Returns fall(node_id): the node leaves OPERATIONAL with the next tick behind its start."""

    def fall(node_id):
        start = Network.start_node

        def start_node(network, started=0):
            start(network, started)
            network.enter_pre_operational(node_id)

        monkeypatch.setattr(Network, "start_node", start_node)

    return fall


@pytest.mark.parametrize("node_id", [1, 2])  # with a heartbeat of 50 ms, and by node guarding
@pytest.mark.parametrize("start", [Start.EACH, Start.ALL])
def test_a_mandatory_slave_that_is_not_operational_has_not_started(
    make, fall, lines, node_id, start
):
    fall(node_id)
    _bench, manager = make(Slave(1), Slave(2), start=start)
    assert manager.boot() is False
    assert [slave.node_id for slave in manager.left_out] == [node_id]
    assert manager.states == {1: NmtState.OPERATIONAL, 2: NmtState.OPERATIONAL} | {
        node_id: NmtState.PRE_OPERATIONAL
    }
    assert lines[-1] == f"node {node_id}: PRE-OPERATIONAL after its start"


def test_an_optional_slave_that_is_not_operational_does_not_hold_the_network_up(make, fall):
    fall(2)
    _bench, manager = make(Slave(1), Slave(2, mandatory=False))
    assert manager.boot() is True
    assert manager.states[2] is NmtState.PRE_OPERATIONAL


def test_a_slave_that_leaves_operational_later_ends_the_watch_as_not_started(make):
    bench, manager = make(Slave(1), Slave(2))
    assert manager.boot() is True
    bench.bench.nodes[0].receive(Frame(0, b"\x80\x01"), 0)
    assert manager.watch(0.2) is False
    assert [slave.node_id for slave in manager.left_out] == [1]


def test_a_slave_that_reports_no_state_is_not_said_to_be_operational(make, monkeypatch):
    monkeypatch.setattr(Network, "request", lambda _network, _cob_id, _length: None)
    _bench, manager = make(Slave(1), Slave(2))
    assert manager.boot() is True
    assert manager.states == {1: NmtState.OPERATIONAL, 2: None}
    assert [slave.node_id for slave in manager.unseen] == [2]


def test_node_guarding_is_not_asked_where_that_begins_life_guarding(make, monkeypatch):
    """Life guarding begins with the first remote frame: the valve would miss the next."""
    asked = []
    monkeypatch.setattr(Network, "request", lambda _network, cob_id, _length: asked.append(cob_id))
    life = '[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n{}'
    guarded = 'objects = { "0x100C" = 100, "0x100D" = 3 }\n'
    for more, right in (("", [0x701]), (guarded, [])):
        asked.clear()
        _bench, manager = make(Slave(1), text=life.format(more))
        manager.boot()
        assert asked == right
        assert manager.states == {1: None}
