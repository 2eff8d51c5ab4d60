"""The LSS address of a device (CiA 305: the four entries of 0x1018) stays when its node-ID changes.

A master that finds its devices by their identity finds them again under any node-ID.
"""

import struct
import zlib

import pytest
from support.bus_side import BusSide

from device_profiles import ENCODER_406, IMITATIONS, PRESSURE_404, VALVE_408
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.frame import Frame

FILES = [VALVE_408, PRESSURE_404, ENCODER_406, *sorted(IMITATIONS.glob("*.eds"))]
WAITING, CONFIGURATION = "04 00", "04 01"


class Lss(BusSide):
    """A bench, and a master that speaks LSS to it."""

    def ask(self, *messages):
        """Send LSS messages, a tick each; return the answers of the last."""
        for text in messages:
            frames = self.tick(Frame(0x7E5, bytes.fromhex(text).ljust(8, b"\0")))
        return [frame.data for frame in frames if frame.can_id == 0x7E4]

    def select(self, address):
        """Select a device by its address; return whether one says that it is."""
        numbers = [
            f"{0x40 + part:02x} {number.to_bytes(4, 'little').hex()}"
            for part, number in enumerate(address)
        ]
        return self.ask(WAITING, *numbers) == [b"\x44".ljust(8, b"\0")]

    def scan(self):
        """Return the address that the fastscan finds (CiA 305), None where nobody answers."""
        if not self.ask(WAITING, "51 00000000 80"):
            return None
        return tuple(self._scan_part(part) for part in range(4))

    def _scan_part(self, part):
        number = 0
        for bit in reversed(range(32)):
            step = struct.pack("<BIBBB", 0x51, number, bit, part, part).hex()
            number |= 0 if self.ask(step) else 1 << bit
        assert self.ask(struct.pack("<BIBBB", 0x51, number, 0, part, (part + 1) % 4).hex())
        return number

    def read_address(self, node_id):
        """Return 0x1018.01 to .04 by SDO."""
        numbers = []
        for part in range(1, 5):
            request = struct.pack("<BHB4x", 0x40, 0x1018, part)
            sent = self.tick(Frame(0x600 + node_id, request))
            answer = next(frame.data for frame in sent if frame.can_id == 0x580 + node_id)
            numbers.append(int.from_bytes(answer[4:], "little"))
        return tuple(numbers)


@pytest.fixture
def make_bench(load_bench):
    def make(text):
        bench = Lss(load_bench(text))
        bench.tick()
        return bench

    return make


def node(name, node_id, eds=IMITATIONS / "analogue_io_401.eds", more=""):
    return f'[nodes.{name}]\nnode_id = {node_id}\neds = "{eds}"\n{more}\n'


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_no_serial_number_of_our_files_follows_the_node_id(path):
    numbers = {load_eds(path, node_id).number(0x1018, 4) for node_id in (1, 2, 127)}
    assert numbers == {0}  # CiA 301: 0 says that the file gives none, so a master checks none


def test_two_devices_of_a_kind_have_serial_numbers_of_their_own(make_bench):
    bench = make_bench(node("left", 10) + node("right", 11))
    left, right = bench.read_address(10), bench.read_address(11)
    assert left[:3] == right[:3]
    assert (left[3], right[3]) == (zlib.crc32(b"left"), zlib.crc32(b"right"))


def test_a_name_keeps_its_serial_number_wherever_it_stands(make_bench):
    one = make_bench(node("left", 10)).read_address(10)
    other = make_bench(node("new", 10) + node("left", 99)).read_address(99)
    assert one == other


def test_selective_finds_a_device_again_under_its_new_node_id(make_bench):
    bench = make_bench(node("left", 10) + node("right", 11))
    address = bench.read_address(10)
    assert bench.select(address)
    assert bench.ask("11 14") == [b"\x11".ljust(8, b"\0")]  # node-ID := 20
    bench.ask(WAITING)
    assert [frame.can_id for frame in bench.tick(Frame(0x000, b"\x82\x0a"))] == [0x714]
    assert bench.read_address(20) == address
    assert bench.select(address)
    assert bench.ask("5e") == [b"\x5e\x14".ljust(8, b"\0")]  # inquire node-ID: 20
    assert bench.ask("5d") == [b"\x5d" + address[3].to_bytes(4, "little") + bytes(3)]


def test_fastscan_finds_a_device_by_the_address_that_it_had(make_bench):
    bench = make_bench(node("left", 10) + node("right", 11))
    address = bench.read_address(10)
    assert bench.select(address)
    bench.ask("11 ff", WAITING)  # no node-ID
    bench.tick(Frame(0x000, b"\x82\x0a"))
    assert bench.scan() == address
    bench.ask("11 15", WAITING)
    assert bench.read_address(0x15) == address


def test_unconfigured_devices_of_a_kind_are_found_one_by_one(make_bench):
    bench = make_bench(node("left", 255) + node("right", 255))
    found = set()
    for node_id in (30, 31):
        address = bench.scan()
        bench.ask(f"11 {node_id:02x}", WAITING)
        assert bench.read_address(node_id) == address
        found.add(address[3])
    assert found == {zlib.crc32(b"left"), zlib.crc32(b"right")}
    assert bench.scan() is None


def test_a_serial_number_of_the_configuration_wins(make_bench):
    bench = make_bench(node("left", 10, more="serial_number = 7"))
    assert bench.read_address(10)[3] == 7


@pytest.mark.parametrize(
    ("default", "right"),
    [("0x4D2", 1234), ("0", zlib.crc32(b"left")), ("$NODEID+0x100", zlib.crc32(b"left"))],
)
def test_a_serial_number_of_the_eds_file_counts_unless_it_is_none(
    make_bench, tmp_path, default, right
):
    eds = tmp_path / "own.eds"
    text = (IMITATIONS / "analogue_io_401.eds").read_text()
    at = text.index("[1018sub4]")
    eds.write_text(text[:at] + text[at:].replace("DefaultValue=0x0", f"DefaultValue={default}", 1))
    bench = make_bench(node("left", 10, eds))
    assert bench.read_address(10)[3] == right
