"""What a user's own controller meets first: dead zone, supervision, the way back after a fault."""

import re
import struct
from pathlib import Path

import pytest
from support.bus_side import CONTROLLER, VALVE, BusSide, valve_command

from hil_bench.bench.configuration import load_config
from hil_bench.canopen_device.frame import Frame

DEVICES = Path(__file__).parents[2] / "docs" / "devices.md"
HEARTBEAT = Frame(0x700 + CONTROLLER, b"\x05")
DEAD_ZONE = 3781  # 0.3 mm / 1.3 mm * 16384 = 3780.9
SUPERVISED = '"0x1016.01" = 0x007700C8\n"0x1400.05" = 100\n'
COMPENSATED = f'"0x6342" = 1\n"0x6343.01" = {DEAD_ZONE}\n"0x6344.01" = {DEAD_ZONE}\n'


@pytest.fixture
def make_bench(tmp_path):
    """A bench in OPERATIONAL whose valve has these lines in its table of objects."""

    def make(lines):
        path = tmp_path / "bench.toml"
        head = '[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n[nodes.valve.objects]\n'
        path.write_text(head + lines)
        bus = BusSide(load_config(path))
        bus.tick()
        bus.nmt(0x01)
        return bus

    return make


def status_word(bus):
    return bus.bench.nodes[0].object_dictionary.number(0x6041)


def documented_walk():
    """Control word (None for none) and status word of each row of the table."""
    text = DEVICES.read_text(encoding="utf-8")
    section = text.split("### After a fault")[1].split("###")[0]
    rows = re.findall(r"^\| (none comes|0x\w{4}) \| (0x\w{4}) \|", section, re.MULTILINE)
    return [(None if c == "none comes" else int(c, 16), int(s, 16)) for c, s in rows]


def test_by_default_the_last_set_point_stays_when_the_controller_is_gone(make_bench):
    bus = make_bench("")
    bus.command(0x0007, 8192, count=20)
    bus.tick(count=1000)
    assert bus.plant.output.nu == pytest.approx(0.5 * 1.3e-3, rel=1e-3)


@pytest.mark.parametrize("cause", ["RPDO", "heartbeat"])
def test_the_documented_walk_leads_out_of_the_fault(make_bench, cause):
    walk = documented_walk()
    assert len(walk) == 5
    bus = make_bench(SUPERVISED)
    bus.tick(HEARTBEAT)
    bus.command(0x0007, 8192, count=20)
    for _ in range(300):  # one of the two goes on
        bus.tick(HEARTBEAT if cause == "RPDO" else valve_command(0x0007, 8192))
    bus.tick(HEARTBEAT)
    if cause == "heartbeat":
        bus.nmt(0x01)
    for control_word, expected in walk:
        bus.tick(HEARTBEAT, *([] if control_word is None else [valve_command(control_word, 0)]))
        assert status_word(bus) == expected, (control_word, expected)


def test_a_restarted_controller_that_sends_no_edge_stays_in_the_fault(make_bench):
    bus = make_bench(SUPERVISED)
    bus.command(0x0007, 0)
    bus.tick(count=150)
    bus.command(0x0000, 0)
    bus.command(0x0007, 0, count=500)
    assert status_word(bus) == 0x0000
    error = bus.tick(Frame(0x600 + VALVE, bytes.fromhex("404e600000000000")))
    answer = next(f.data for f in error if f.can_id == 0x580 + VALVE)
    assert struct.unpack_from("<H", answer, 4)[0] == 0x8250  # so it is no NOT_READY


@pytest.mark.parametrize("sign", [1, -1])
def test_nothing_moves_within_the_dead_zone(make_bench, sign):
    bus = make_bench("")
    # The spool, of damping 0.7, overshoots a step by exp(-0.7 pi / sqrt(1 - 0.49)) = 4.6 %.
    bus.command(0x0007, sign * round(0.95 * DEAD_ZONE), count=500)
    assert bus.plant.output.z == 0.0
    assert abs(bus.plant.output.x) < 1e-9
    bus.command(0x0007, sign * (DEAD_ZONE + 800), count=500)
    assert sign * bus.plant.output.x > 1e-3


@pytest.mark.parametrize("sign", [1, -1])
def test_the_compensation_of_the_valve_opens_it_at_once(make_bench, sign):
    bus = make_bench(COMPENSATED)
    bus.command(0x0007, sign * 164, count=1000)  # 1 %
    assert sign * bus.plant.output.x > 1e-3
