"""What one tick does, and in which order."""

import struct
from pathlib import Path

import pytest
from support.bus_side import CONTROLLER, POSITION, PRESSURE_A, PRESSURE_B, VALVE, BusSide

from hil_bench.bench.assembly import build_bench
from hil_bench.bench.compiled import look_at_core
from hil_bench.bench.configuration import load_config
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.node import Node

ALL = (VALVE, PRESSURE_A, PRESSURE_B, POSITION)


def test_the_first_tick_boots_every_node(bus):
    assert bus.tick() == [Frame(0x700 + node_id, b"\x00") for node_id in ALL]


def test_a_set_point_moves_the_spool_in_the_tick_it_arrives_in(bus):
    bus.activate()
    bus.tick(count=10)
    assert bus.plant.output.nu == 0.0
    bus.command(0x0007, 16384)
    # Eq. (3) from rest with u = alpha + beta = 1.3e-3 m after 1 ms, by hand:
    # nu = u (1 - e^-0.84 (cos mu + 0.84 / mu sin mu)), mu = 1.2 sqrt(1 - 0.7²) = 0.85697
    #    = 1.3e-3 (1 - 0.43171 (0.65473 + 0.98020 * 0.75587)) = 0.5167e-3 m.
    assert bus.plant.output.nu == pytest.approx(0.5167e-3, rel=2e-4)


def test_sync_samples_all_devices_in_the_same_tick(bus):
    bus.tick()
    for node_id in ALL:
        assert bus.download(node_id, 0x1800, 2, b"\x01")[0] == 0x60
    bus.nmt(0x01)
    bus.command(0x0007, 16384, count=50)
    sent = {frame.can_id: frame.data for frame in bus.tick(Frame(0x080))}
    output = bus.plant.output
    # Process values in bar (0x6131 = 0x004E0000), position in steps of 1 µm, as the EDS files say.
    assert struct.unpack_from("<f", sent[0x182])[0] == pytest.approx(output.P_A * 1e-5, rel=1e-6)
    assert struct.unpack_from("<f", sent[0x183])[0] == pytest.approx(output.P_B * 1e-5, rel=1e-6)
    assert struct.unpack_from("<i", sent[0x184])[0] == round(output.x * 1e6)
    assert struct.unpack_from("<Hh", sent[0x181])[1] == round(output.nu / 1.3e-3 * 16384)
    assert not bus.tick()  # no SYNC, no TPDO


def test_a_sync_that_one_node_produces_reaches_the_others_in_the_next_tick(bus):
    bus.tick()
    for node_id in ALL:
        assert bus.download(node_id, 0x1800, 2, b"\x01")[0] == 0x60
    bus.nmt(0x01)
    assert bus.download(VALVE, 0x1006, 0, (5000).to_bytes(4, "little"))[0] == 0x60
    assert bus.download(VALVE, 0x1005, 0, (0x40000080).to_bytes(4, "little"))[0] == 0x60
    ticks = [[frame.can_id for frame in bus.tick()] for _ in range(10)]
    # Every 5 ms; the producer's own TPDO follows its SYNC.
    assert ticks == ([[0x080, 0x181], [0x182, 0x183, 0x184], [], [], []] * 2)
    assert all(not node.counters.ignored_frames for node in bus.bench.nodes)


def test_frames_for_nobody_are_counted_and_change_nothing(bus):
    bus.activate()
    before = bus.plant.state
    strange = [
        Frame(0x123, b"\x01\x02"),
        Frame(0x601, b"\x40\x00\x10\x00\x00\x00\x00\x00", is_extended=True),
        Frame(0x67F, bytes(8)),
    ]
    bus.tick(*strange)
    assert bus.bench.unrouted == len(strange)
    assert bus.plant.state.nu == before.nu == 0.0


def test_a_node_hears_what_another_node_of_the_bench_sends(bus):
    bus.tick()
    watched = POSITION << 16 | 50
    assert bus.download(VALVE, 0x1016, 1, struct.pack("<I", watched))[0] == 0x60
    assert bus.download(POSITION, 0x1017, 0, struct.pack("<H", 20))[0] == 0x60
    bus.tick(count=100)
    assert not [frame for frame in bus.log if frame.can_id == 0x080 + VALVE]
    assert bus.download(POSITION, 0x1017, 0, struct.pack("<H", 0))[0] == 0x60
    bus.tick(count=60)
    emergency = next(frame for frame in bus.log if frame.can_id == 0x080 + VALVE)
    assert struct.unpack_from("<H", emergency.data)[0] == 0x8130


def test_routes_follow_a_changed_identifier(bus):
    bus.tick()
    assert 0x700 + CONTROLLER not in bus.bench.routes
    before = bus.bench.routes
    watched = CONTROLLER << 16 | 50
    assert bus.download(VALVE, 0x1016, 1, struct.pack("<I", watched))[0] == 0x60
    assert bus.bench.routes is not before
    assert 0x700 + CONTROLLER in bus.bench.routes


def test_routes_follow_what_changes_before_the_start():
    bench = build_bench(load_config())
    watched = CONTROLLER << 16 | 50
    bench.nodes[0].object_dictionary.variable(0x1016, 1).write(watched)
    bench.start(0)
    assert 0x700 + CONTROLLER in bench.routes


@pytest.mark.skipif(bool(look_at_core().compiler), reason="a compiled Node takes no stand-in")
def test_only_what_is_due_wakes_the_nodes(bus, monkeypatch):
    bus.tick()
    for node_id in ALL:  # a heartbeat each 50 ms, of one node after the other
        bus.download(node_id, 0x1017, 0, (50).to_bytes(2, "little"))
    bus.tick()
    woken = []
    serve = Node.serve
    monkeypatch.setattr(
        Node, "serve", lambda node, now, emit: [woken.append(now), serve(node, now, emit)]
    )
    beats = [bus.now for _ in range(100) if bus.tick()]
    assert len(beats) == 2 * len(ALL)
    assert woken == [now for now in beats for _ in ALL]


def test_the_same_frames_give_the_same_bytes():
    def session():
        bus = BusSide()
        bus.activate()
        for setpoint in (16384, -3000, 5000, 0):
            bus.command(0x0007, setpoint, count=100)
        return bus.log, bus.plant.state

    assert session() == session()


# Several axes on one bus.


TWO_AXES = Path(__file__).parents[2] / "examples" / "two_axes.toml"


def test_each_valve_moves_its_own_cylinder():
    config = load_config(TWO_AXES)
    bus = BusSide(config)
    bus.tick()
    bus.nmt(0x01)
    first, second = (next(n for n in config.nodes if n.axis == a.name) for a in config.axes)
    start = [axis.plant.state.x for axis in bus.bench.axes]
    for _ in range(200):
        bus.tick(Frame(0x200 + second.node_id, bytes.fromhex("07000020")))
    moved = [axis.plant.state.x - x for axis, x in zip(bus.bench.axes, start, strict=True)]
    assert first.profile == second.profile == "valve_408"
    assert abs(moved[0]) < 1e-6
    assert moved[1] > 1e-3
