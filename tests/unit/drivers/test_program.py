"""Download of a program through the bench's own device, in virtual time."""

import zlib
from contextlib import ExitStack

import pytest

from device_profiles import IMITATIONS
from hil_bench.bench.virtual_bench import VirtualBench
from hil_drivers import Network, ProgramError, SdoAbortError
from hil_drivers.program import ControlCommand, ProgramDownload, ProgramState

EDS = IMITATIONS / "programmable_io_401.eds"


@pytest.fixture
def driver_of(load_bench):
    """Returns bench and driver of a node of a bench, which is closed in the end."""
    with ExitStack() as stack:

        def open_it(text, node_id):
            bench = stack.enter_context(VirtualBench(load_bench(text)))
            network = stack.enter_context(Network(bench.bus, clock=bench.now))
            node = network.add_node(node_id)
            node.await_answer()
            return bench, ProgramDownload(network, node)

        yield open_it


@pytest.fixture
def make(driver_of):
    """Returns bench and driver of a device: make('write_ms = 20')."""

    def make_it(memory=""):
        return driver_of(
            '[plant.axis1]\nkind = "none"\n'
            f'[nodes.io]\nnode_id = 10\neds = "{EDS}"\nprogram = {{ {memory} }}\n',
            10,
        )

    return make_it


# Lengths around a segment of 7 bytes and a block of 127 of them, and more than 64 KiB.
@pytest.mark.parametrize("length", [1, 4, 7, 8, 889, 890, 70_000])
@pytest.mark.parametrize("block", [True, False])
def test_a_program_arrives(make, length, block):
    _, driver = make("write_ms = 20")
    program = bytes(number % 251 for number in range(length))
    told = []
    state = driver.update(program, block=block, progress=told.append)
    assert state == ProgramState(True, zlib.crc32(program), 0)
    assert told[-1] == length


def test_a_program_may_stay_stopped(make):
    _, driver = make()
    assert driver.update(b"1234567", start=False).is_running is False


def test_a_download_while_the_program_runs_is_refused_at_once(make):
    bench, driver = make()
    before = len(bench.frames)
    for block in (True, False):
        with pytest.raises(ProgramError, match=r"0x1F50\.01: SDO abort 0x08000022"):
            driver.download(bytes(1000), block=block)
    # Not one segment has been sent: the device refuses before the first.
    requests = [each for each in list(bench.frames)[before:] if each.frame.can_id == 0x60A]
    assert len(requests) < 10


def test_a_program_that_does_not_fit_is_refused_at_once(make):
    _, driver = make("largest_bytes = 1000")
    with pytest.raises(ProgramError, match="SDO abort 0x06070012"):
        driver.update(bytes(1001))
    driver.update(bytes(1000))


def test_a_wrong_checksum_is_told_in_words(make):
    _, driver = make('checksum = "crc32"')
    driver.command(ControlCommand.STOP)
    driver.command(ControlCommand.CLEAR)
    with pytest.raises(ProgramError) as caught:
        driver.download(b"123456789" + bytes(4))
    assert "SDO abort 0x06060000" in str(caught.value)
    assert str(caught.value).endswith("0x1F57 says: data format or checksum wrong")
    driver.command(ControlCommand.CLEAR)
    driver.download(b"123456789\x26\x39\xf4\xcb")


def test_a_download_that_is_broken_off_is_aborted(make):
    bench, driver = make()
    driver.command(ControlCommand.STOP)
    driver.command(ControlCommand.CLEAR)

    def interrupt(sent):
        if sent > 100:
            raise KeyboardInterrupt

    for block in (True, False):
        with pytest.raises(KeyboardInterrupt):
            driver.download(bytes(1000), block=block, progress=interrupt)
        bench.run(0.01)
        last = [each.frame for each in bench.frames if each.frame.can_id == 0x60A][-1]
        # CiA 301: command specifier 4 is the abort of a transfer.
        assert last.data[:4] == bytes.fromhex("80 50 1f 01")
    driver.download(b"1")


def test_a_device_without_programs_says_nothing(driver_of):
    _, driver = driver_of('[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n', 1)
    assert driver.read() == ProgramState(None, None, None)
    with pytest.raises(SdoAbortError):
        driver.update(b"1")


def test_an_empty_program_is_none(make):
    _, driver = make()
    with pytest.raises(ValueError, match="an empty program"):
        driver.download(b"")
