"""The words of the eyes by the tables of CiA 301, 303-2, 305, 404, 406 and 408, entry by entry."""

import random
import re
from types import SimpleNamespace

import pytest
from support.sdo_frames import MS

from device_profiles import ENCODER_406, PRESSURE_404, VALVE_408
from hil_bench.abilities.eyes.channels import _si_symbol
from hil_bench.abilities.eyes.explain.bus import Emergencies, ErrorFrames, Load
from hil_bench.abilities.eyes.explain.explain import explain
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.abilities.eyes.frame_words import error_text, lss_text, meaning_of
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.abilities.eyes.values import scale_of
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.frame import Frame
from hil_bench.frame import ERROR_FLAG
from hil_bench.outside.recording.channels import LoggedFrame

LSS = """04 switch state global, 11 configure node-ID, 13 configure bit timing,
15 activate bit timing, 17 store configuration, 44 switched by its address,
4C identify non-configured slave, 4F slave identified,
50 non-configured slave identified, 51 fastscan, 5A inquire vendor-ID,
5B inquire product code, 5C inquire revision number, 5D inquire serial number, 5E inquire node-ID"""
IDENTITY = ("vendor-ID", "product code", "revision number", "serial number")
BOUNDS = [f"{bound} {number}" for number in IDENTITY[2:] for bound in ("lowest", "highest")]
ADDRESSED = {
    "switch state selective": (0x40, IDENTITY),
    "identify slave": (0x46, [*IDENTITY[:2], *BOUNDS]),
}


def test_each_service_of_lss_has_its_words_and_others_their_number():
    words = {int(line[:2], 16): line[3:] for line in LSS.replace("\n", " ").split(", ")}
    for service, (first, parts) in ADDRESSED.items():
        words |= {first + n: f"{service}, {part}" for n, part in enumerate(parts)}
    for number in range(256):
        text = words.get(number, f"command {number}")
        assert lss_text(bytes([number, 9])) == text
        assert meaning_of(0x7E5, bytes([number]) + bytes(7)) == text
    assert lss_text(b"") == ""


def test_a_frame_has_just_these_words():
    overrun = "0x8110, CAN overrun, objects lost, error register 0x11"
    read_only = "0x06010002, attempt to write a read only object"
    expected = {
        (0x000, "0204"): "stop, node 4",
        (0x000, "8000"): "enter pre-operational, all nodes",
        (0x000, "8200"): "reset communication, all nodes",
        (0x000, "82"): "",
        (0x701, "04"): "STOPPED",
        (0x701, "7f"): "PRE_OPERATIONAL",
        (0x701, "0505"): "",
        (0x080, "07"): "counter 7",
        (0x080, "0707"): "",
        # 12 h and 1 ms of 4 bits unused; day 2
        (0x100, "01 2e 93 f2 02 00"): "day 2 since 1984-01-01, 43200.001 s",
        (0x100, "00 5c 26 05 02 00"): "day 2 since 1984-01-01, 0.000 s",
        (0x100, "00 5c 26 05 02"): "",
        (0x081, "10 81 11 00 00 00 00 00"): overrun,
        (0x081, "10 81 11 00 00 00 00 0a"): f"{overrun}, manufacturer 00 00 00 00 0A",
        (0x605, "8017100002000106"): f"abort 0x1017.00, {read_only}",
        (0x585, "8017100001000000"): "abort 0x1017.00, 0x00000001, unknown abort code",
        (0x605, "6017100000000000"): "segment or block",
        (0x585, "2017100000000000"): "segment or block",
        (0x585, "c017100000000000"): "segment or block",
    }
    assert {
        (can_id, data): meaning_of(can_id, bytes.fromhex(data)) for can_id, data in expected
    } == expected


# linux/can/error.h
def test_an_error_frame_says_each_of_its_bits():
    expected = {
        (0x001, ""): "transmission timed out",
        (0x002, ""): "arbitration lost",
        (0x010, ""): "transceiver",
        (0x020, ""): "no acknowledge",
        (0x040, ""): "bus-off",
        (0x080, ""): "error frame",
        (0x100, ""): "back from bus-off",
        (0x004, "0001"): "receive buffer overflow",
        (0x004, "0002"): "transmit buffer overflow",
        (0x004, "0004"): "receive warning level",
        (0x004, "0008"): "transmit warning level",
        (0x004, "0030"): "error-passive by reception, error-passive by transmission",
        (0x004, "0040"): "error-active again",
        (0x008, "000000"): "error while receiving",
        (0x008, "000081"): "bit error while sending",
        (0x008, "000006"): "form error and stuff error while receiving",
        (0x008, "000098"): "a dominant bit not sent and a recessive bit not sent while sending",
        (0x008, "000020"): "overload while receiving",
        (0x200, "000000000000 80 7f"): "TEC 128, REC 127",
        (0x20A, "0000010000000102"): "arbitration lost, bit error while receiving, TEC 1, REC 2",
        (0x000, "00ffff"): "error frame",
    }
    assert {
        (classes, data): error_text(Frame(ERROR_FLAG | classes, bytes.fromhex(data)))
        for classes, data in expected
    } == expected


class Objects(dict):
    """Values by index and sub-index, as the eyes look them up."""

    def find(self, index, subindex=0):
        value = self.get((index, subindex))
        return None if value is None else SimpleNamespace(value=value, is_open=False)


def shown(objects, index, subindex=0):
    scale = scale_of(Objects(objects), index, subindex)
    return None if scale is None else (scale.factor, scale.unit.symbol, scale.offset)


PREFIXES = {-9: "n", -6: "µ", -3: "m", -2: "c", -1: "d", 0: ""}
PREFIXES |= {1: "da", 2: "h", 3: "k", 6: "M", 9: "G"}
"""SI Brochure, 9th edition, table 7."""


# CiA 303-2: 4E bar, AB psi, 2D degree Celsius, 22 pascal; the highest byte is a power of ten.
@pytest.mark.parametrize(
    ("code", "symbol", "base"),
    [(0x4E, "bar", 1e5), (0xAB, "psi", 6894.757293168361), (0x2D, "°C", 1.0), (0x22, "Pa", 1.0)],
)
def test_a_measured_value_has_its_unit_with_the_prefix(code, symbol, base):
    for power in range(-9, 10):
        prefix = PREFIXES.get(power)
        word = (power & 0xFF) << 24 | code << 16
        objects = Objects({(0x1000, 0): 0x30194, (0x6131, 2): word, (0x6132, 2): 3})
        scale = scale_of(objects, 0x6130, 2)
        assert (scale is None) is (prefix is None)
        if scale is not None:
            assert (scale.factor, scale.offset, scale.unit.symbol) == (1.0, 0.0, prefix + symbol)
            assert scale.unit.factor == pytest.approx(base * 10.0**power)
            assert _si_symbol(prefix + symbol) == ("°C" if code == 0x2D else "Pa")
        integer = scale_of(objects, 0x9130, 2)
        assert integer.factor == pytest.approx(1e-3)
        assert integer.unit.symbol == ("-" if prefix is None else prefix + symbol)
        assert scale_of(Objects({**objects, (0x6131, 2): word | 1}), 0x6130, 2) is None


MEASURED = (0x6124, 0x6130, 0x6133, 0x6134, 0x6135, 0x6138, 0x6140, 0x6148, 0x6149)


def test_the_process_values_of_cia_404_have_a_scale_and_their_neighbours_have_none():
    objects = {(0x1000, 0): 404, (0x6131, 1): 0x4E0000, (0x6132, 1): 2}
    found = {i: shown(objects, i, 1) for i in range(0x6100, 0x9180)}
    floats = dict.fromkeys(MEASURED, (1.0, "bar", 0.0))
    integers = {i + n * 0x1000: (0.01, "bar", 0.0) for i in MEASURED for n in (1, 2, 3)}
    assert {i: s for i, s in found.items() if s is not None} == floats | integers
    for digits, has in ((-1, False), (0, True), (9, True), (10, False)):
        assert (shown({**objects, (0x6132, 1): digits}, 0x7130, 1) is not None) is has


LINEAR = {(0x1000, 0): 406, (0x6005, 1): 5000, (0x6005, 2): 7}
ROTARY = {(0x1000, 0): 406, (0x6000, 0): 4, (0x6001, 0): 4096, (0x6501, 0): 8192,
          (0x6031, 3): 10, (0x6031, 4): 3}  # fmt: skip
VALVE = {(0x1000, 0): 408, (0x6311, 1): 16384, (0x6391, 1): 200}
MOTION = {(0x6600, 2): 1, (0x6600, 3): -6}


def test_a_number_has_the_scale_of_its_profile():
    rows = [
        # 406: position in 0.001 um, speed in 0.01 mm/s a step
        (LINEAR, 0x6004, (5e-3, "mm", 0.0)),
        (LINEAR, 0x6020, (5e-3, "mm", 0.0)),
        (LINEAR, 0x6030, (0.07, "mm/s", 0.0)),
        (LINEAR, 0x6005, None),
        ({(0x1000, 0): 406}, 0x6004, None),
        ({(0x1000, 0): 406}, 0x6030, None),
        (ROTARY, 0x6004, (1 / 4096, "rev", 0.0)),
        (ROTARY, 0x6020, (1 / 4096, "rev", 0.0)),
        (ROTARY | {(0x6000, 0): 3}, 0x6004, (1 / 8192, "rev", 0.0)),
        (ROTARY, 0x6030, (60.0 * 3 / 10 / 4096, "rpm", 0.0)),
        (ROTARY | {(0x6031, 3): 0}, 0x6030, None),
        (ROTARY, 0x6005, None),
        *[(VALVE, i, (100 / 16384, "%", 0.0)) for i in (
            0x6300, 0x6301, 0x6310, 0x6314, 0x6320, 0x6321, 0x6350)],
        *[(VALVE, i, (0.5, "%", 0.0)) for i in (0x6380, 0x6381, 0x6390, 0x6394)],
        *[(VALVE, i, None) for i in (0x6302, 0x6311, 0x6322, 0x6382, 0x6391, 0x6600)],
        ({(0x1000, 0): 408}, 0x6300, None),
        *[(VALVE | {(i, 2): 1, (i, 3): -6}, i, (1e-3, "mm", 0.0)) for i in (
            0x6600, 0x6601, 0x6610, 0x6614, 0x6620, 0x6621, 0x6650)],
        (VALVE | {(0x6600, 2): 2}, 0x6600, None),
        (VALVE | {(0x6602, 2): 1}, 0x6602, None),
        ({(0x1000, 0): 401, (0x6005, 1): 5}, 0x6004, None),
        ({}, 0x6004, None),
        # The encoder type in 0x1000: 1 to 7 turn, 8 to 10 are linear, whatever else they have
        (ROTARY | LINEAR | {(0x1000, 0): 0x80196}, 0x6004, (5e-3, "mm", 0.0)),
        (ROTARY | LINEAR | {(0x1000, 0): 0xA0196}, 0x6030, (0.07, "mm/s", 0.0)),
        (ROTARY | LINEAR | {(0x1000, 0): 0x20196}, 0x6004, (1 / 4096, "rev", 0.0)),
        # 408: a value with a unit of its own is no part of the reference
        (VALVE | {(0x6381, 2): 0x4E, (0x6381, 3): -3}, 0x6381, (1.0, "mbar", 0.0)),
        (VALVE | {(0x6380, 2): 0x4E, (0x6380, 3): -4}, 0x6380, None),
        (VALVE | {(0x6301, 2): 1, (0x6301, 3): -6}, 0x6301, (1e-3, "mm", 0.0)),
    ]  # fmt: skip
    found = [shown(objects, index, 0 if index == 0x6004 else 1) for objects, index, _ in rows]
    assert found == [each and (pytest.approx(each[0]), *each[1:]) for *_, each in rows]


@pytest.mark.parametrize(
    ("eds", "index", "subindex"),
    [
        *[(eds, index, 0) for eds, index in (
            (VALVE_408, 0x6300), (PRESSURE_404, 0x6130), (PRESSURE_404, 0x9130),
            (ENCODER_406, 0x6030))],
        *[(VALVE_408, index, sub) for index in (0x6300, 0x6380, 0x6600) for sub in (2, 3)],
    ],
)  # fmt: skip
def test_an_entry_beside_the_value_is_a_plain_number(eds, index, subindex):
    """CiA 301: sub-index 0 counts the entries; CiA 408: 2 is the unit, 3 the power of ten."""
    reader = KnownNode(1, "node", load_eds(eds, 1)).reader(index, subindex)
    assert reader.read(b"\3").text == "3"


@pytest.mark.parametrize(("digits", "before"), [("3", "10 bar"), ("", "10000"), (None, "10000")])
def test_digits_that_the_eds_leaves_open_are_those_that_the_device_says(tmp_path, digits, before):
    text = PRESSURE_404.read_text()
    head, _, rest = text.partition("[6132sub1]")
    line = "" if digits is None else f"DefaultValue={digits}"
    eds = tmp_path / "open.eds"
    eds.write_text(f"{head}[6132sub1]{re.sub('DefaultValue=.*', line, rest, count=1)}")
    node = KnownNode(1, "node", load_eds(eds, 1))
    node.objects.variable(0x6131, 1).value = 0x4E0000  # bar
    raw = (10_000).to_bytes(4, "little")
    assert node.reader(0x9130, 1).read(raw).text == before
    assert node.assume(0x6132, 1, b"\0") is True
    assert node.reader(0x9130, 1).read(raw).text == "10000 bar"


@pytest.mark.parametrize("seed", range(4))
def test_the_load_is_that_of_the_busiest_hundred_milliseconds(seed):
    """Bits by hand: 47 and 8 a byte, 20 more with 29 bits, and half of the most stuff bits.

    The first frame was sent before the log begins.
    """
    dice = random.Random(seed)  # noqa: S311 - no secrets
    load, windows, shares, total = Load(10_000), {}, {}, 0.0
    now = 0
    while now < 2_000 * MS:
        window = now // (100 * MS)
        can_id = 0x100 if dice.random() < 0.5 + 0.1 * seed else dice.randrange(0x200, 0x210)
        frame = Frame(can_id, bytes(dice.randrange(9)), is_extended=dice.random() < 0.3)
        load.count(now, frame)
        head, length = 20 * frame.is_extended, 8 * len(frame.data)
        bits = 47 + head + length + (34 + head + length - 1) / 4 / 2
        before = windows.get(window, 0.0)
        windows[window] = before + bits
        total += bits if now else 0.0
        if before + bits > 500:
            shares.setdefault(window, {}).setdefault(frame._replace(data=b""), []).append(bits)
        now += dice.choice((3, 5, 20) if window % 4 else (5, 9)) * MS
    assert load.total == pytest.approx(total)
    high = {window: bits for window, bits in windows.items() if bits > 800}
    (finding,) = load.findings(now)
    assert finding.begin == min(high) * 100 * MS
    most = max(high, key=high.get)
    assert (
        f"load up to {high[most] / 1000:.0%} in 100 ms, from {min(high) / 10:.3f} s" in finding.text
    )
    sums = {frame: sum(each) for frame, each in shares[most].items()}
    frame = max(sums, key=sums.get)
    is_most = sums[frame] > 0.5 * sum(sums.values())
    assert ("most of it is" in finding.text) is is_most
    assert f"most of it is 0x{frame.can_id:03X}" in finding.text or not is_most


def test_a_load_of_exactly_eighty_percent_is_none():
    """A frame without data has 51.125 bits."""
    load = Load(10_000)
    load._bits = 748.875
    load.count(0, Frame(1))
    assert list(load.findings(0)) == []
    load._bits, load._shares = 749.375, {Frame(2): 51.125}
    load.count(1, Frame(1))
    (finding,) = load.findings(0)
    assert "most of it" not in finding.text


@pytest.mark.parametrize(("times", "load"), [(11, 0.562), (17, 0.869)])
def test_each_bus_has_a_load_of_its_own(times, load):
    """A frame without data has 51.125 bits; 100 ms at 10 kbit/s are 1000.

    The first frames were sent before the log begins.
    """
    frames = [
        LoggedFrame(Frame(1, bus=bus), tick * MS, True)
        for tick in range(times)
        for bus in (0, 1)
        if bus == 0 or tick < 10
    ] + [LoggedFrame(Frame(1, bus=1), 100 * MS, True)]
    found = explain(frames, [], 10_000)
    assert found.load == pytest.approx((times - 1) * 51.125 / 1000)
    texts = [each.text for each in found.findings if each.cause is Cause.BUS_LOAD]
    assert len(texts) == (load > 0.8)
    assert all(text.startswith(f"channel 1: load up to {load:.0%} in 100 ms") for text in texts)


def emcy(now, code, node="valve"):
    frame = Frame(0x81, code.to_bytes(2, "little") + bytes(6))
    return Sight(now, frame, Service.EMCY, "EMCY", node)


@pytest.mark.parametrize("times", [1, 2, 5])
@pytest.mark.parametrize("reset", [None, -1, 0, 1])
def test_an_emergency_says_how_often_and_whether_it_is_gone(times, reset):
    watch = Emergencies()
    for number in range(times):
        watch.hear(emcy(number * MS, 0x8130))
    if reset is not None:
        watch.hear(emcy((times - 1 + reset) * MS, 0))
    (found,) = watch.findings(0)
    assert found.text.startswith("valve reports 0x8130, life guard or heartbeat error, at 0")
    assert (f", {times} times" in found.text) is (times > 1)
    assert ("; gone at" in found.text) is (reset == 1)


def test_4096_kinds_of_errors_are_kept():
    watch = Emergencies()
    for code in range(4097):
        watch.hear(emcy(0, 0x100 + code))
    watch.hear(emcy(1, 0x100))  # of a kind that is known
    found = list(watch.findings(0))
    assert len(found) == 4096
    assert ", 2 times" in found[0].text


def test_error_frames_are_counted_and_others_are_not():
    watch = ErrorFrames()
    for now, can_id in enumerate((1, ERROR_FLAG | 0x40, 2, ERROR_FLAG | 0x100)):
        watch.hear(Sight(now * MS, Frame(can_id), Service.OTHER, "", problem=f"p{now}"))
    (found,) = watch.findings(0)
    assert found.text.startswith("2 error frames, the first at 0.001")
    assert found.text.endswith("p1")
