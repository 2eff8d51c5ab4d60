"""SYNC from a master whose clock is its own: now none meets a tick, now two or three do.

Every SYNC has its synchronous PDOs (CiA 301), whatever makes the ticks.
"""

import itertools
import struct

import can
import numpy as np
import pytest
from support.bus_side import POSITION, SYNC, VALVE, BusSide, valve_command

from device_profiles import IMITATIONS
from hil_bench import Faults, load_config
from hil_bench.abilities.lockstep.lockstep import LockStep
from hil_bench.bench.assembly import build_bench, embedded_bus
from hil_bench.bench.paced import run_paced
from hil_bench.bench.session import Session
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.realtime.clock import VirtualClock
from hil_bench.outside.realtime.pacer import Pacer
from hil_bench.outside.transports.transport import TransportCounters

TICK = 1_000_000  # [ns]
MINUTE = 60_000  # SYNCs of 1 kHz
START_ALL = Frame(0x000, b"\x01\x00")
TPDOS = (0x28A, 0x28B)
SENDERS = (0x181, 0x182, 0x183, 0x184)


@pytest.fixture(scope="module")
def io_config(tmp_path_factory):
    """Two modules that answer each SYNC, and no axis."""
    path = tmp_path_factory.mktemp("io") / "io.toml"
    eds = IMITATIONS / "analogue_io_401.eds"
    path.write_text(
        "\n".join(
            f'[nodes.io{n}]\nnode_id = {n}\neds = "{eds}"\nobjects = {{ "0x1801.02" = 1 }}'
            for n in (10, 11)
        )
    )
    return load_config(path)


def sync_times(count):
    """Return times [ns] of a 1 kHz clock that is 0.01 % fast and late by up to 0.9 ms at random."""
    late = np.random.default_rng(1).uniform(0.0, 900_000, count)
    return [10 * TICK + round(k * 999_900 + late[k]) for k in range(count)]


class Master:
    """The bus of a paced run, on which SYNCs arrive by a clock; counts what comes back."""

    description = "master"
    has_exact_wait = False

    def __init__(self, clock, times):
        self._clock = clock
        self._arriving = [(0, Frame(0)), (5 * TICK, START_ALL), *((time, SYNC) for time in times)]
        self._next = 0
        self.counts = []
        self.sent = []

    def receive(self, limit):
        now, first = self._clock.now(), self._next
        while self._next - first < limit and self._next < len(self._arriving):
            if self._arriving[self._next][0] > now:
                break
            self._next += 1
        self.counts.append(self._next - first)
        return [frame for _, frame in self._arriving[first : self._next]]

    def send(self, frames):
        self.sent += [frame.can_id for frame in frames]

    def listen_to(self, can_ids):
        pass

    def counters(self):
        return TransportCounters()


@pytest.mark.long  # a minute at 1 kHz
def test_a_paced_bench_answers_every_sync(io_config):
    clock = VirtualClock()
    master = Master(clock, sync_times(MINUTE))
    pacer = Pacer(clock, TICK)
    bench = build_bench(io_config)
    run_paced(Session(bench), master, pacer, stopped=lambda: pacer.statistics.ticks > MINUTE + 50)
    assert {0, 1, 2} <= set(master.counts)  # the clocks do beat
    assert [master.sent.count(can_id) for can_id in TPDOS] == [MINUTE, MINUTE]


@pytest.mark.long  # a minute at 1 kHz
def test_a_bench_in_lockstep_answers_every_sync(io_config):
    bench = build_bench(io_config)
    bench.start(0)
    bench.tick([], 0)
    lockstep = LockStep(Session(bench), tick_ns=TICK)
    lockstep.receive(START_ALL)
    sent = [frame.can_id for _ in range(MINUTE) for frame in lockstep.receive(SYNC)]
    assert [sent.count(can_id) for can_id in TPDOS] == [MINUTE, MINUTE]


@pytest.mark.long  # a minute at 1 kHz
def test_an_embedded_bench_answers_every_sync(io_config):
    received = []
    with embedded_bus(io_config) as bus:

        def receive_until(time):
            while (message := bus.recv(max(time * 1e-9 - bus.now(), 0.0))) is not None:
                received.append(message.arbitration_id)

        receive_until(2 * TICK)
        bus.send(can.Message(arbitration_id=0, data=b"\x01\x00", is_extended_id=False))
        for time in sync_times(MINUTE):
            receive_until(time)
            bus.send(can.Message(arbitration_id=0x080, is_extended_id=False))
        receive_until(time + 2 * TICK)
    assert [received.count(can_id) for can_id in TPDOS] == [MINUTE, MINUTE]


def synchronous_bench(transmission_type=1):
    """A bench of one axis whose four devices follow SYNC."""
    bus = BusSide()
    bus.tick()
    for node_id in (1, 2, 3, 4):
        bus.download(node_id, 0x1800, 2, bytes([transmission_type]))
    bus.nmt(0x01)
    return bus


def test_twenty_syncs_two_a_tick_give_twenty_pdos():
    bus = synchronous_bench()
    sent = [frame.can_id for _ in range(10) for frame in bus.tick(SYNC, SYNC)]
    assert [sent.count(can_id) for can_id in SENDERS] == [20] * 4


@pytest.mark.parametrize("together", [1, 2, 3])
def test_every_third_sync_has_its_pdos_within_a_tick_too(together):
    bus = synchronous_bench(transmission_type=3)
    sent, syncs = [], 0
    for _ in range(30):
        sent += [frame.can_id for frame in bus.tick(*[SYNC] * together)]
        syncs += together
        assert [sent.count(can_id) for can_id in SENDERS] == [syncs // 3] * 4


def test_the_pdos_of_one_sync_come_before_those_of_the_next():
    bus = synchronous_bench()
    assert [frame.can_id for frame in bus.tick(SYNC, SYNC, SYNC)] == [*SENDERS] * 3


def test_the_first_has_the_values_that_the_tick_found_and_the_last_those_that_it_made():
    bus = synchronous_bench()
    bus.command(0x0007, 16384, count=20)  # opens the valve: the piston moves
    positions = [
        struct.unpack_from("<i", frame.data)[0]  # TPDO 1 of the encoder: position, in um
        for _ in range(5)
        for frame in bus.tick(valve_command(7, 16384), SYNC, SYNC)
        if frame.can_id == 0x180 + POSITION
    ]
    now = [round(bus.plant.output.x * 1e6)]
    assert positions[-1:] == now
    assert positions[2::2] == positions[1:-1:2]  # what a tick makes, the next one finds
    assert all(earlier < later for earlier, later in itertools.pairwise(positions[1::2]))


def test_each_control_word_acts_with_its_own_sync():
    """A synchronous RPDO acts with the SYNC after it (CiA 301): two commands, two states."""
    bus = BusSide()
    bus.tick()
    bus.download(VALVE, 0x1800, 2, b"\x01")
    bus.download(VALVE, 0x1400, 2, b"\x01")
    bus.nmt(0x01)
    bus.tick(valve_command(7, 0), SYNC, valve_command(1, 0), SYNC)
    last = [frame.data for frame in bus.tick(SYNC) if frame.can_id == 0x180 + VALVE]
    # Bits R M H D: 1001 is DISABLED, where M = H = 0 leads from ACTIVE (CiA 408).
    assert [struct.unpack_from("<H", data)[0] & 0xF for data in last] == [0b1001]


def test_syncs_that_share_a_tick_on_two_buses_answer_on_their_own(tmp_path):
    path = tmp_path / "two.toml"
    eds = IMITATIONS / "analogue_io_401.eds"
    path.write_text(
        '[bus]\ninterface = "virtual"\n[buses.second]\ninterface = "virtual"\n'
        + "\n".join(
            f'[nodes.{name}]\nnode_id = 10\neds = "{eds}"\nbus = "{name}"\n'
            'objects = { "0x1801.02" = 1 }'
            for name in ("bus", "second")
        )
    )
    bus = BusSide(load_config(path))
    bus.tick()
    bus.tick(START_ALL, START_ALL._replace(bus=1))
    second = SYNC._replace(bus=1)
    sent = bus.tick(second, SYNC, second, second)
    assert [(frame.can_id, frame.bus) for frame in sent if frame.bus] == [(0x28A, 1)] * 3
    assert [frame.can_id for frame in sent if not frame.bus] == [0x28A]


def test_a_line_that_delays_two_syncs_into_one_tick_loses_none():
    bus = synchronous_bench()
    with bus.bench.part(Faults).delay("position", 0.005, direction="received"):
        sent = bus.tick(SYNC) + bus.tick(SYNC, SYNC)
        sent += bus.tick(count=20)
    counts = [[frame.can_id for frame in sent].count(can_id) for can_id in SENDERS]
    assert counts == [3] * 4
