"""What is said of a bench while it runs, on a bench in virtual time."""

import pytest
from support.bus_side import POSITION, SYNC, VALVE, BusSide, download_request

from hil_bench import Faults, load_config
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.storage import FileStorage
from hil_bench.cli.helpers import MOST_LINES, BenchEvents


class Watched(BusSide):
    """A bench whose events are looked for after each tick."""

    def __init__(self, **options):
        super().__init__()
        self.said = []
        self.events = BenchEvents(load_config(), self.bench, self.said.append, **options)

    def tick(self, *frames, count=1):
        sent = []
        for number in range(count):
            sent += super().tick(*(frames if number == 0 else ()))
            self.events.look(self.now)
        return sent


@pytest.fixture
def bench():
    watched = Watched()
    watched.tick(count=150)
    return watched


def test_booting_is_no_news(bench):
    assert bench.said == []


def test_states_are_said_together_with_the_time(bench):
    bench.nmt(0x01)
    bench.tick(count=100)
    # Ticks of 1 ms; looks at 1, 101 and 201 ms.
    assert bench.said == ["0.201 s: valve, pressure_a, pressure_b, position: OPERATIONAL"]


def test_a_valve_that_loses_its_controller_says_state_and_error(bench):
    bench.download(VALVE, 0x1400, 5, b"\x32\x00")  # RPDO time-out 50 ms
    bench.nmt(0x01)
    bench.command(7, 0, count=200)
    bench.said.clear()
    bench.tick(count=200)
    (said,) = bench.said
    assert said.endswith(" s: valve: FAULT_HOLD, EMCY 0x8250 (RPDO time-out)")


def test_faults_have_the_time_at_which_they_begin_and_end(bench):
    bench.bench.part(Faults).freeze("pressure_a", at=0.2105, duration=0.02)
    bench.tick(count=160)
    # The first ticks at or after 210.5 and 230.5 ms of bench time, of which tick 1 is 1 ms.
    assert bench.said == [
        "0.211 s: fault freeze pressure_a begins",
        "0.231 s: fault freeze pressure_a ends, and has changed nothing",
    ]


def test_sync_that_stays_away_is_said_and_that_it_is_back(bench):
    bench.nmt(0x01)
    for _ in range(200):
        bench.tick(SYNC)
    bench.said.clear()
    bench.tick(count=1500)
    (lost,) = bench.said
    assert " s: no SYNC for 1." in lost
    assert lost.endswith("; PDOs that wait for it stand still")
    for _ in range(150):
        bench.tick(SYNC)
    assert " s: SYNC is back after 1.5 s" in bench.said[1]


def test_sync_that_one_node_alone_still_takes_is_there(bench):
    bench.nmt(0x01)
    bench.tick(SYNC)
    bench.tick(Frame(0x000, bytes([0x02, POSITION])))  # CiA 301: a stopped node takes no SYNC
    bench.said.clear()
    for _ in range(1100):
        bench.tick(SYNC)
    assert not any("SYNC" in line for line in bench.said)


def test_sync_that_never_came_is_not_missed(bench):
    bench.nmt(0x01)
    bench.tick(count=3000)
    assert not any("SYNC" in line for line in bench.said)


def test_in_lockstep_somebody_else_watches_sync():
    watched = Watched(watches_sync=False)
    watched.nmt(0x01)
    watched.tick(SYNC)
    watched.tick(count=3000)
    assert not any("SYNC" in line for line in watched.said)


def test_parameters_that_cannot_be_stored_are_said(bench, tmp_path):
    (tmp_path / "file").touch()
    node = bench.bench.nodes[3]
    node._store._storage = FileStorage(tmp_path / "file" / "position.parameters")
    bench.tick(download_request(POSITION, 0x1010, 1, b"save"))
    bench.tick(count=150)
    (said,) = bench.said
    assert "position: " in said
    assert said.endswith(
        "position.parameters: cannot be written: File exists; what was stored before stays"
    )


def test_no_flood_of_states_is_a_flood_of_lines(bench):
    for number in range(100):
        bench.tick(Frame(0x000, bytes([(0x01, 0x80)[number % 2], 0])))
        bench.tick(count=99)
    # 20 at once, then one a second of the ten.
    assert MOST_LINES <= len(bench.said) <= MOST_LINES + 11
    assert any(line.endswith(" lines left out before)") for line in bench.said)


def test_a_second_device_with_our_identifiers_is_said_once(bench):
    """Boot-up messages of nodes 1 and 4, as a second bench on the bus sends them."""
    for _ in range(3):
        bench.tick(Frame(0x701, b"\0"), Frame(0x704, b"\0"), count=100)
    (line,) = bench.said
    assert line.startswith("0.201 s: valve, position: another device sends with the same ident")
    assert [node.counters.foreign_frames for node in bench.bench.nodes] == [3, 0, 0, 3]
