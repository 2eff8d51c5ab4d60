"""A second, plain way to what the drivers work out: the same random events, the same results."""

import functools
import math
import struct
from itertools import pairwise

import pytest
from canopen.objectdictionary import ODVariable, datatypes
from hypothesis import given, settings
from hypothesis import strategies as st

from hil_drivers import DeviceMismatchError, StaleValueError
from hil_drivers.concise_dcf import INVALID, order_writes
from hil_drivers.j1939 import AuxiliaryValve, ClaimState, ExitReason, FlowState, Name
from hil_drivers.j1939.address_claim import CONTENTION, AddressClaim
from hil_drivers.j1939.identifier import join, split
from hil_drivers.modbus.device import ModbusDevice
from hil_drivers.modbus.framing import RtuFraming, TcpFraming, check_sum
from hil_drivers.modbus.register_map import Register, RegisterMap
from hil_drivers.pdo import MappedObject, PdoKind, PdoMapping, Signal, choose_carriers
from hil_drivers.protection import Protection
from hil_drivers.srdo import SafetyInput, SrdoCounters
from hil_drivers.turns import TurnCounter

COB_ID = 0x184
FEW = settings(max_examples=40)  # a third of a second each


def remainder(data, width, polynomial, initial, final):
    """The CRC of bytes as a polynomial: what division in whole leaves, the highest bit first."""
    size = 8 * len(data)
    number = int.from_bytes(data) << width ^ initial << size
    for place in reversed(range(size)):
        if number >> place + width & 1:
            number ^= (1 << width | polynomial) << place
    return number ^ final


def sealed(counter, payload=b"abc"):
    """SAE J1850: polynomial 0x1D, 0xFF before and after; over identifier, bytes and counter."""
    body = bytes([*payload, counter])
    check = remainder(COB_ID.to_bytes(2, "little") + body, 8, 0x1D, 0xFF, 0xFF)
    return body + bytes([check])


@FEW
@given(
    st.integers(0, 255),
    st.lists(st.tuples(st.integers(0, 255) | st.integers(0, 2), st.sampled_from("sssrcx"))),
)
def test_protected_frames_are_counted_as_one_counts_by_hand(first, events):
    """Sound after some steps, repeated, with a wrong check sum, or cut off."""
    protection = Protection(COB_ID)
    sent, kinds, lost = first, [], 0
    for step, kind in [(0, "s"), *events]:
        counter = (sent + step) % 256
        if kind == "s" and kinds and step == 0:
            kind = "r"  # noqa: PLW2901
        frame = sealed(sent if kind == "r" else counter)
        if kind == "c":
            frame = frame[:-1] + bytes([frame[-1] ^ 1 << step % 8])
        if kind == "x":
            frame = frame[: step % 4]  # of four, the last may be a check sum
        assert protection.open(frame) == (b"abc" if kind == "s" else None)
        if kind == "s":
            lost += step - 1 if kinds else 0
            sent = counter
        kinds.append(kind)
    counts = (protection.accepted, protection.repeated, protection.wrong_crc, protection.lost)
    assert counts == (kinds.count("s"), kinds.count("r"), kinds.count("c") + kinds.count("x"), lost)


@given(st.integers(0, 2000), st.integers(3, 1000), st.lists(st.floats(-0.999, 0.999)))
def test_a_turn_counter_follows_the_shaft(start, total, moves):
    """A move is a part of half the range; what is shown is the rest by the range."""
    counter, place = TurnCounter(), start % total
    for move in [0.0, *moves]:
        place += int(move * (total / 2))
        assert counter.count(place % total, total) == place
    counter.restart()
    assert counter.count(1, total) == 1


NUMBERS = {  # data types of CiA 301: bits, signed
    datatypes.INTEGER8: (8, True),
    datatypes.INTEGER16: (16, True),
    datatypes.INTEGER24: (24, True),
    datatypes.INTEGER32: (32, True),
    datatypes.UNSIGNED8: (8, False),
    datatypes.UNSIGNED16: (16, False),
    datatypes.UNSIGNED24: (24, False),
    datatypes.UNSIGNED32: (32, False),
}


@FEW
@given(st.lists(st.sampled_from(sorted(NUMBERS)), min_size=1, max_size=8), st.binary(min_size=32))
def test_a_pdo_is_one_number_whose_parts_are_its_objects(types, raw):
    entries = [0x20000000 + place << 8 | NUMBERS[each][0] for place, each in enumerate(types)]
    mapping = PdoMapping(PdoKind.TPDO, 1, 0x181, tuple(map(MappedObject.from_entry, entries)))
    size = sum(NUMBERS[each][0] for each in types) // 8
    assert mapping.length == size
    copy, shift = bytearray(size), 0
    for (key, bits), data_type in zip(mapping.objects, types, strict=True):
        variable = ODVariable("x", *key)
        variable.data_type = data_type
        signal = Signal(mapping, key, variable)
        value, lowest = int.from_bytes(raw[:size], "little") >> shift & (1 << bits) - 1, 0
        if NUMBERS[data_type][1]:
            lowest = -(1 << bits - 1)
            value -= (value >> bits - 1) << bits
        assert (signal.decode(raw), signal.lowest, signal.is_real) == (value, lowest, False)
        signal.encode(copy, value)
        shift += bits
    assert bytes(copy) == raw[:size]


def test_a_mapping_entry_has_index_subindex_and_bits():
    """CiA 301, 0x1A00: index in bits 31 to 16, sub-index in 15 to 8, bits in 7 to 0."""
    assert MappedObject.from_entry(0xFEDCBA98) == ((0xFEDC, 0xBA), 0x98)


KEYS = [(0x2000, number) for number in range(4)]


@FEW
@given(
    st.lists(st.tuples(st.sets(st.sampled_from(KEYS)), st.booleans()), max_size=4),
    st.lists(st.sampled_from(KEYS), min_size=1, unique=True),
)
def test_one_pdo_with_all_comes_first_then_one_that_exists(pdos, wanted):
    mappings = [
        PdoMapping(
            PdoKind.TPDO,
            number,
            0x180 | (0 if exists else INVALID),
            tuple(MappedObject(key, 8) for key in sorted(carried)),
        )
        for number, (carried, exists) in enumerate(pdos, 1)
    ]
    chosen = choose_carriers(mappings, wanted)
    for key in wanted:
        carriers = [
            (carried, exists, m)
            for (carried, exists), m in zip(pdos, mappings, strict=True)
            if key in carried
        ]
        if not carriers:
            assert key not in chosen
            continue
        most = max(len(carried & {*wanted}) for carried, _, _ in carriers)
        best = [(exists, m) for carried, exists, m in carriers if len(carried & {*wanted}) == most]
        existing = [m for exists, m in best if exists]
        assert chosen[key] is (existing or [m for _, m in best])[0]


class StrictDevice:
    """A device that takes the writes of a PDO in CiA 301's order only."""

    def __init__(self, values):
        self.values = dict(values)

    def write(self, key, data):
        index, sub = key
        if 0x1800 <= index < 0x1C00:
            pdo = index & ~0x200
            is_valid = not int.from_bytes(self.values[pdo, 1], "little") & INVALID
            assert not is_valid or (key == (pdo, 1) and data[3] & 0x80), f"{key} of a valid PDO"
            if index != pdo and sub:
                assert self.values[index, 0] == b"\0", f"{key} of a mapping that counts"
        self.values[key] = data


def number(value, size=4):
    return value.to_bytes(size, "little")


pdo_values = st.fixed_dictionaries(
    {},
    optional={
        (0x1800, 1): st.sampled_from([number(0x181), number(0x80000181), number(0x40000282)]),
        (0x1800, 2): st.just(b"\x01"),
        (0x1800, 5): st.just(number(10, 2)),
        (0x1A00, 0): st.sampled_from([b"\0", b"\1", b"\2"]),
        (0x1A00, 1): st.just(number(0x60410010)),
        (0x1A00, 2): st.just(number(0x63010110)),
        (0x1BFF, 0): st.just(b"\1"),
        (0x19FF, 2): st.just(b"\xff"),
        (0x1017, 0): st.just(number(100, 2)),
        (0x2000, 1): st.just(b"\7"),
    },
)


@FEW
@given(pdo_values, st.sampled_from([0x181, 0x80000181]), st.integers(0, 2))
def test_a_strict_device_takes_the_writes_and_holds_what_is_wanted(values, cob_id, count):
    defaults = {(0x1800, 1): cob_id, (0x19FF, 1): cob_id, (0x1A00, 0): count, (0x1BFF, 0): 1}
    device = StrictDevice(
        {key: number(value, 1 if key[1] == 0 else 4) for key, value in defaults.items()}
    )
    before = dict(device.values)
    writes = order_writes(values, defaults)
    for entry in writes:
        device.write((entry.index, entry.subindex), entry.data)
    mapped = int.from_bytes(device.values[0x1A00, 0])
    for key, data in (before | values).items():
        if key[0] != 0x1A00 or key[1] <= mapped:  # what is not counted need not be there
            assert device.values.get(key) == data
    is_pdo = [0x1800 <= entry.index < 0x1C00 for entry in writes]
    assert is_pdo == sorted(is_pdo)
    assert {(each.index, each.subindex) for each in writes} <= {
        *values,
        (0x1800, 1),
        (0x19FF, 1),
        (0x1A00, 0),
    }


WIDTHS = {  # SAE J1939-81, from the lowest bit on
    "identity": 21,
    "manufacturer": 11,
    "ecu_instance": 3,
    "function_instance": 5,
    "function": 8,
    "": 1,
    "vehicle_system": 7,
    "vehicle_system_instance": 4,
    "industry_group": 3,
    "arbitrary_address": 1,
}
names = st.builds(
    Name, **{field: st.integers(0, 2**bits - 1) for field, bits in WIDTHS.items() if field}
)


@FEW
@given(names)
def test_a_name_is_its_fields_side_by_side(name):
    digits = "".join(
        f"{getattr(name, field) if field else 0:0{bits}b}"
        for field, bits in reversed(WIDTHS.items())
    )
    assert name.pack() == int(digits, 2).to_bytes(8, "little")
    assert Name.parse(name.pack()) == name


@pytest.mark.parametrize(("field", "bits"), [each for each in WIDTHS.items() if each[0]])
def test_a_field_of_a_name_has_its_width(field, bits):
    Name(**{"identity": 0, field: 2**bits - 1}).pack()
    for value in (-1, 2**bits):
        with pytest.raises(ValueError, match=f"{value} does not fit into {bits} bits"):
            Name(**{"identity": 0, field: value}).pack()


@given(st.integers(0, 7), st.integers(0, 0x3FFFF), st.integers(0, 255), st.integers(0, 255))
def test_an_identifier_by_its_digits(priority, group, source, destination):
    """Priority, two bits of pages, PDU format, PDU specific, source (SAE J1939-21)."""
    specific = group & 0xFF
    is_to_all = (group >> 8 & 0xFF) >= 240
    if not is_to_all:
        group, specific = group & ~0xFF, destination
    bits = f"{priority:03b}{group >> 8:010b}{specific:08b}{source:08b}"
    can_id = int(bits, 2)
    assert join(priority, group, source, destination) == can_id
    assert split(can_id) == (group, source, 255 if is_to_all else destination)


@FEW
@given(
    st.dictionaries(
        st.integers(0, 2**21 - 1),
        st.tuples(st.sampled_from([10, 127, 128, 129, 130, 247]), st.booleans()),
        max_size=6,
    )
)
def test_of_two_that_want_one_address_the_smaller_name_has_it(stations):
    """All claim one after the other on a bus without delay."""
    claims, queue = {}, []
    for identity, (address, may_move) in stations.items():
        name = Name(identity, arbitrary_address=may_move)
        say = functools.partial(lambda name, source: queue.append((source, name.pack())), name)
        claims[name] = AddressClaim(name, address, say)
        claims[name].begin(0.0)
        while queue:
            source, data = queue.pop(0)
            others = [claim for other, claim in claims.items() if other.pack() != data]
            assert all(claim.take(source, data, 0.0) for claim in others)
    for claim in claims.values():
        early, late = claim.serve(CONTENTION - 1e-6), claim.serve(CONTENTION)
        assert (early, late) == (math.inf if claim.address == 254 else CONTENTION, math.inf)
    wanted = dict(zip(claims, (address for address, _ in stations.values()), strict=True))
    used = [claim.address for claim in claims.values() if claim.state is ClaimState.CLAIMED]
    assert len(used) == len({*used})
    smallest = sorted(claims, key=lambda name: int.from_bytes(name.pack(), "little"))[:1]
    assert all(claims[name].address == wanted[name] for name in smallest)
    for name, claim in claims.items():
        if claim.address == wanted[name] or name.arbitrary_address:
            assert claim.state is ClaimState.CLAIMED
            assert claim.address == wanted[name] or 128 <= claim.address < 248
        else:
            assert (claim.state, claim.address) == (ClaimState.LOST, 254)
            assert wanted[name] in used


TYPES = {"int16": (1, 16), "uint16": (1, 0), "int32": (2, 32), "uint32": (2, 0)}


@given(st.sampled_from(sorted(TYPES)), st.booleans(), st.data())
def test_a_register_is_the_digits_of_its_words(kind, is_little, data):
    count, signed_bits = TYPES[kind]
    words = data.draw(st.lists(st.integers(0, 0xFFFF), min_size=count, max_size=count))
    register = Register("x", "input_registers", 0, kind, 0.25, is_little)
    digits = "".join(f"{word:04x}" for word in (words[::-1] if is_little else words))
    value = int(digits, 16)
    if signed_bits and value >= 1 << signed_bits - 1:
        value -= 1 << signed_bits
    assert (register.count, register.decode(words)) == (count, value)
    assert register.encode(value * 0.25) == words
    assert register.no_value == (-(2.0 ** (signed_bits - 1)) if signed_bits else None)
    span = (
        (-(1 << signed_bits - 1), (1 << signed_bits - 1) - 1)
        if signed_bits
        else (0, (1 << 16 * count) - 1)
    )
    for beyond in (span[0] - 1, span[1] + 1):
        with pytest.raises(struct.error):
            register.encode(beyond * 0.25)


responses = st.one_of(  # MODBUS Application Protocol V1.1b3, chapter 6
    st.tuples(st.integers(1, 4), st.binary(min_size=1, max_size=250)).map(
        lambda parts: bytes([parts[0], len(parts[1]), *parts[1]])
    ),
    st.tuples(st.sampled_from([5, 6, 15, 16]), st.binary(min_size=4, max_size=4)).map(
        lambda parts: bytes([parts[0], *parts[1]])
    ),
    st.lists(st.binary(max_size=20), min_size=1, max_size=4).map(
        lambda texts: (
            bytes([0x2B, 14, 1, 1, 0, 0, len(texts)])
            + b"".join(bytes([place, len(text), *text]) for place, text in enumerate(texts))
        )
    ),
    st.integers(1, 11).map(lambda code: bytes([0x83, code])),
)


@FEW
@given(responses, st.integers(1, 247), st.lists(st.integers(1, 260)), st.booleans())
def test_a_response_is_found_in_whatever_pieces_it_comes(pdu, unit_id, cuts, is_tcp):
    framing = TcpFraming() if is_tcp else RtuFraming()
    request = framing.wrap(unit_id, bytes([pdu[0] & 0x7F, 0, 0, 0, 1]))
    if is_tcp:
        assert request == bytes([0, 1, 0, 0, 0, 6, unit_id, pdu[0] & 0x7F, 0, 0, 0, 1])
        size = len(pdu) + 1
        late = bytes([0, 0, 0, 0, 0, size, unit_id]) + pdu
        foreign = bytes([0, 1, 0, 0, 0, size, unit_id % 247 + 1]) + pdu
        stream = late + foreign + bytes([0, 1, 0, 0, 0, size, unit_id]) + pdu
    else:
        stream = bytes([unit_id]) + pdu + check_sum(bytes([unit_id]) + pdu)
    ends = sorted({0, *(cut for cut in cuts if cut < len(stream)), len(stream)})
    buffer, found = bytearray(), []
    for start, end in pairwise(ends):
        buffer += stream[start:end]
        if (response := framing.take(buffer)) is not None:
            found.append((end, response))
    assert found == [(len(stream), pdu)]
    assert buffer == b""


@given(st.binary(max_size=40))
def test_the_check_sum_is_a_remainder(data):
    """CRC-16/MODBUS: polynomial 0x8005, 0xFFFF before, each byte and the sum mirrored."""
    mirrored = bytes(int(f"{byte:08b}"[::-1], 2) for byte in data)
    crc = remainder(mirrored, 16, 0x8005, 0xFFFF, 0)
    assert check_sum(data) == int(f"{crc:016b}"[::-1], 2).to_bytes(2, "little")


class Now:
    """A network that is a clock and a list of who listens and waits."""

    def __init__(self):
        self.time = 0.0
        self.takers = {}
        self.services = []
        self.add_service, self.remove_service = self.services.append, self.services.remove

    def now(self):
        return self.time

    def subscribe(self, cob_id, take):
        self.takers[cob_id] = take


class Table:
    """A node that is a table of numbers, and keeps what is written."""

    def __init__(self, objects):
        self.objects, self.written = objects, []

    def read_integer(self, index, subindex=0):
        return self.objects[index, subindex]

    def write(self, index, subindex, value):
        self.objects[index, subindex] = value
        self.written.append((index, subindex, value))

    def variable(self, index, subindex):
        variable = ODVariable("x", index, subindex)
        variable.data_type = {0x6020: datatypes.INTEGER32, 0x6030: datatypes.INTEGER16}[index]
        return variable


PLAIN, INVERTED = 0x10B, 0x10C
SRDO = {  # the second one, of position and speed, as EN 50325-5 has it
    **{(0x1302, sub): value for sub, value in enumerate([6, 0, 0, 3, 254, PLAIN, INVERTED])},
    **{(0x1382, sub): 0x60200120 for sub in (1, 2)},
    **{(0x1382, sub): 0x60300110 for sub in (3, 4)},
    (0x1382, 0): 4,
}
TICK = 1 / 1024  # s, so that sums of times are exact
frames = st.binary(min_size=6, max_size=6)


@FEW
@given(
    st.lists(st.tuples(st.integers(0, 40), st.sampled_from("pppiiijx"), frames), max_size=30),
    st.integers(0, 80),
)
def test_an_srdo_is_judged_pair_by_pair(events, wait):
    """Plain (p), inverted (i), inverted but for a bit (j), cut off (x), each some ticks later."""
    network = Now()
    safety = SafetyInput(network, Table(dict(SRDO)), 2)
    safety.setup(refresh=0.02, sct=64 * TICK, srvt=16 * TICK)
    last, before, sent_at, accepted_at, accepted = bytes(6), "", 0.0, -math.inf, b""
    counts = SrdoCounters()
    for delay, kind, data in events:
        network.time += delay * TICK
        last = data if kind == "p" else last
        frame = bytearray(data if kind == "p" else (255 - byte for byte in last))
        frame[0] ^= 1 << data[0] % 8 if kind == "j" else 0
        cob_id = PLAIN if kind == "p" else INVERTED
        assert network.takers[cob_id](bytes(frame[: 5 if kind == "x" else 6]), network.time)
        if before + kind == "pp":
            counts.missing += 1
        elif before == "p" and network.time - sent_at > 16 * TICK:
            counts.late += 1
        elif before + kind == "pi":
            counts.accepted += 1
            accepted, accepted_at = last, network.time
        elif before == "p":
            counts.mismatched += 1
        before, sent_at = kind, network.time
    network.time += wait * TICK
    assert safety.counters == counts
    if network.time - accepted_at <= 64 * TICK:
        assert safety.value(0x6020, 1) == int.from_bytes(accepted[:4], "little", signed=True)
        assert safety.value(0x6030, 1) == int.from_bytes(accepted[4:], "little", signed=True)
    else:
        with pytest.raises(StaleValueError):
            safety.value(0x6020, 1)


def test_an_srdo_is_signed_by_its_parameters_and_mapping():
    """CRC-CCITT from 0 of parameters 1, 2, 3, 5 and 6, the count, and each entry with its place."""
    node = Table(dict(SRDO))
    SafetyInput(Now(), node, 2).setup(refresh=0.02, sct=0.05)
    signed = b"\1" + number(20, 2) + b"\3" + number(PLAIN) + number(INVERTED) + b"\4"
    signed += b"".join(bytes([sub]) + number(SRDO[0x1382, sub]) for sub in range(1, 5))
    signature = remainder(signed, 16, 0x1021, 0, 0)
    first = [(0x1302, 1, 1), (0x1302, 2, 20)]
    assert node.written == [*first, (0x13FF, 2, signature), (0x13FE, 0, 0xA5)]
    node.objects[0x1382, 4] = 0x60300210
    with pytest.raises(DeviceMismatchError, match="0x1382 maps other objects inverted than plain"):
        SafetyInput(Now(), node, 2).setup()


class Image(Now):
    """A Modbus client that is the registers of a device, which counts the requests."""

    def __init__(self, words):
        super().__init__()
        self.words, self.requests = words, []

    def read_registers(self, unit_id, table, address, count):
        assert (unit_id, table) == (7, "input_registers")
        self.requests.append((address, count))
        return [self.words[place] for place in range(address, address + count)]


class Anything(ModbusDevice):
    PROFILE = "anything"

    def _find_registers(self):
        names = [name for name in "abcdefgh" if self.map.find("input_registers", name)]
        return [None, *(self.map.find("input_registers", name) for name in names[::-1])]


@FEW
@given(
    st.lists(st.tuples(st.integers(0, 2), st.booleans()), min_size=1, max_size=8),
    st.lists(st.integers(0, 0xFFFF), min_size=40, max_size=40),
)
def test_registers_side_by_side_are_one_request(tmp_path_factory, layout, words):
    """A gap before each register, which takes two words or one."""
    text, expected, used, address = "", {}, [], 0
    for name, (gap, is_long) in zip("abcdefgh", layout, strict=False):
        address += gap
        text += f'[input_registers.{name}]\naddress = {address}\nsource = "{name}"\n'
        text += f'type = "{"uint32" if is_long else "uint16"}"\n'
        parts = [*range(address, address + 1 + is_long)]
        used += parts
        expected[name] = int("".join(f"{words[part]:04x}" for part in parts), 16)
        address = parts[-1] + 1
    path = tmp_path_factory.mktemp("maps") / "map.toml"
    head = '[device]\nprofile = "anything"\nvendor_name = "m"\nproduct_code = "p"\n'
    path.write_text(head + text, encoding="utf-8")
    client = Image(words)
    device = Anything(client, 7, RegisterMap(path))
    client.time = 3.0
    assert device.poll() is True
    assert {register.name: value for register, value in device._values.items()} == expected
    assert [place for at, count in client.requests for place in range(at, at + count)] == used
    assert len(client.requests) == 1 + sum(after - before > 1 for before, after in pairwise(used))
    assert (device.received_at, device.age) == (3.0, 0.0)


class Port(Now):
    """A J1939 port that keeps what is sent."""

    state = ClaimState.CLAIMED

    def __init__(self):
        super().__init__()
        self.network, self.sent = self, []

    def send(self, group, data, *, priority):
        self.sent.append((group, data, priority))


def test_the_commands_of_an_auxiliary_valve_have_steps_of_a_250th():
    """ISO 11783-7, B.13: the flow in 0.4 %, the direction in bits 3 to 0 of byte 3."""
    port = Port()
    valve = AuxiliaryValve(port, 128, number=3)
    for steps in range(-250, 251):
        valve.spool_setpoint = steps / 250
        direction = 0 if not steps else 1 if steps > 0 else 2
        data = bytes([abs(steps), 0xFF, 0xF0 + direction, *b"\xff" * 5])
        assert port.sent.pop() == (0xFE33, data, 3)
    (repeat,) = port.services
    assert repeat(0.0999) == 0.1
    assert port.sent == []
    assert repeat(0.1) == 0.1  # the time of the next one is that of the clock, which stands here
    assert len(port.sent) == 1
    port.time = 5.0
    valve.close()
    assert port.sent[-1][1][:3] == b"\0\xff\xf0"
    assert (port.services, valve.spool_setpoint) == ([], 0.0)


@FEW
@given(st.integers(0, 255), st.integers(0, 255), st.integers(0, 255))
def test_the_flow_of_an_auxiliary_valve_by_its_bits(flow, state, reason):
    """ISO 11783-7, B.11: 1 % a bit from -125 %; 251 and more are no value, nor is state 14's."""
    port = Port()
    valve = AuxiliaryValve(port, 128, number=3)
    port.time = 2.0
    assert port.takers[0xFE13](128, bytes([flow, 0xFF, state, 0xFF, reason, 9, 9, 9]), 2.0)
    known = {0: "BLOCKED", 1: "EXTEND", 2: "RETRACT", 3: "FLOAT", 14: "ERROR"}
    reasons = {0: "NONE", 5: "TIMEOUT", 6: "INVALID", 9: "FAULT"}
    assert valve.state is FlowState[known.get(state % 16, "NOT_AVAILABLE")]
    assert valve.exit_reason is ExitReason[reasons.get(reason % 64, "UNKNOWN")]
    if flow > 250 or state % 16 == 14:
        assert math.isnan(valve.flow)
    else:
        assert valve.flow == pytest.approx(flow * 0.01 - 1.25)
    port.time = 2.3
    assert valve.max_age == 0.3
    assert valve.age == pytest.approx(0.3)
    port.time = 2.3001
    with pytest.raises(StaleValueError, match=r"estimated flow 0\.3 s old, 0\.3 s allowed"):
        _ = valve.flow
    assert port.takers[0xFE13](129, b"", 2.3)  # of another device
    assert not port.takers[0xFE13](128, bytes(4), 2.3)
    assert valve.received_at == 2.0
    assert port.takers[0xFE13](128, bytes(5), 2.3)
    assert valve.received_at == 2.3
