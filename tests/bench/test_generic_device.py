"""An axis behind a device made from its EDS file alone, and a master of the `canopen` library."""

from itertools import pairwise
from pathlib import Path

import canopen
import numpy as np
import pytest
from support.bus_side import BusSide

from device_profiles import IMITATIONS
from hil_bench.bench.configuration import load_config
from hil_bench.canopen_device.frame import Frame

EXAMPLE = Path(__file__).parents[2] / "examples" / "vendor_io.toml"
EDS = IMITATIONS / "analogue_io_401.eds"
NODE_ID = 10
FULL_OPENING = 1.3e-3  # alpha + beta of Table I [m]
PER_BAR, PER_MM = 110.592, 69.12  # the example's scales


class Master(canopen.Network):
    """The library's network on a bench in virtual time: each frame is a tick, and so is a wait."""

    def __init__(self, bus):
        super().__init__()
        self.bus = bus

    def send_message(self, can_id, data, remote=False):
        del remote
        self._deliver(self.bus.tick(Frame(can_id, bytes(data))))

    def wait(self, milliseconds):
        for _ in range(milliseconds):
            self._deliver(self.bus.tick())

    def _deliver(self, frames):
        for frame in frames:
            self.notify(frame.can_id, bytearray(frame.data), self.bus.now * 1e-9)


@pytest.fixture
def master():
    network = Master(BusSide(load_config(EXAMPLE)))
    network.wait(2)  # boot
    return network


@pytest.fixture
def io(master):
    """The module in OPERATIONAL, its PDOs read from it and heard."""
    io = master.add_node(NODE_ID, str(EDS))
    io.tpdo.read()
    io.rpdo.read()
    io.nmt.state = "OPERATIONAL"
    master.wait(10)
    return io


def command(io, percent):
    """Send RPDO 2 with output 1."""
    io.rpdo[2]["Write analogue output 16-bit.Analogue output 1"].raw = round(percent * 327.67)
    io.rpdo[2].transmit()


def inputs(io):
    return [variable.raw for variable in io.tpdo[2]]


def test_the_plant_is_on_the_inputs(io, master):
    output = master.bus.plant.output
    # The balanced cylinder of Table I: P_A = 50 bar * 47 / 48.5, P_B = 50 bar * 50 / 48.5.
    assert inputs(io) == [round(48.4536 * PER_BAR), round(51.5464 * PER_BAR), 13824, 0]
    assert io.sdo[0x6401][1].raw == inputs(io)[0]
    assert output.x == pytest.approx(0.0, abs=1e-9)


def test_the_output_moves_the_axis(io, master):
    command(io, 50.0)
    master.wait(300)
    output = master.bus.plant.output
    assert output.nu == pytest.approx(0.5 * FULL_OPENING, rel=1e-3)
    assert output.x > 0.01
    # What the last TPDO 2 told is at most 5 ms old.
    pressure_a, _, position, spool = inputs(io)
    assert position == pytest.approx(
        13824 + output.x * 1e3 * PER_MM, abs=output.v * 5.0 * PER_MM + 1
    )
    assert pressure_a == pytest.approx(output.P_A * 1e-5 * PER_BAR, abs=0.05 * PER_BAR)
    assert spool == pytest.approx(0.5 * 27648, abs=28)


def test_the_inputs_come_each_5_ms(io, master):
    stamps = []
    io.tpdo[2].add_callback(lambda pdo: stamps.append(pdo.timestamp))
    master.wait(50)
    assert len(stamps) == 10
    steps = [later - sooner for sooner, later in pairwise(stamps)]
    assert steps == pytest.approx([0.005] * 9)


@pytest.mark.parametrize("state", ["STOPPED", "PRE-OPERATIONAL", "RESET"])
def test_the_axis_stops_when_the_node_leaves_operational(io, master, state):
    command(io, 100.0)
    master.wait(100)
    assert master.bus.plant.output.v > 0.05
    io.nmt.state = state
    master.wait(300)
    assert abs(master.bus.plant.output.v) < 1e-4
    where = master.bus.plant.output.x
    io.nmt.state = "OPERATIONAL"
    master.wait(100)
    assert master.bus.plant.output.x == pytest.approx(where, abs=1e-4)  # yesterday's word is void
    command(io, -100.0)
    master.wait(100)
    assert master.bus.plant.output.v < -0.05


def test_a_lost_controller_stops_the_axis(io, master):
    io.sdo[0x1401][5].raw = 20  # event timer of RPDO 2 [ms]
    for _ in range(100):
        command(io, 100.0)
    assert master.bus.plant.output.v > 0.05
    master.wait(300)
    assert abs(master.bus.plant.output.v) < 1e-4
    assert [error.code for error in io.emcy.log] == [0x8250]


def test_every_service_is_that_of_the_eds(io, master):
    assert io.sdo[0x1000].raw == 0x000C0191
    assert io.sdo["Manufacturer device name"].raw == "hil-bench analogue I/O"
    with pytest.raises(canopen.SdoAbortedError, match="read only"):
        io.sdo[0x6401][1].raw = 5
    io.sdo[0x1017].raw = 20
    master.wait(25)
    assert io.nmt.state == "OPERATIONAL"
    io.tpdo[2].stop()
    tpdo = io.tpdo[2]
    tpdo.clear()
    tpdo.add_variable(0x6401, 3)
    tpdo.trans_type = 1
    tpdo.save()
    tpdo.data[:] = bytes(2)
    master.sync.transmit()
    master.wait(1)
    assert (len(tpdo.data), tpdo[0].raw) == (2, 13824)


def test_no_frame_commands_more_than_full_opening_or_breaks_the_bench(master):
    bus, random = master.bus, np.random.default_rng(1)
    identifiers = [0x000, 0x080, 0x28A, 0x30A, 0x30A, 0x60A]
    commands = []
    for can_id in random.choice(identifiers, 3000):
        data = random.bytes(random.choice([0, 1, 2, 3, 4, 5, 8]))
        if can_id == 0x000 and len(data) != 2:
            data = bytes([1, NODE_ID])  # NMT start, so that it is OPERATIONAL again and again
        bus.tick(Frame(int(can_id), data))
        commands.append(bus.bench.commands[0] / FULL_OPENING)
    assert -1.0 <= min(commands) < -0.9  # it was commanded indeed
    assert 0.9 < max(commands) <= 1.0
