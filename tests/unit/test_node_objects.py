# ruff: noqa: E501 - a line a message
"""Objects of nodes from Python: what may be set, what a TPDO makes of it, and what is refused."""

import math
import re
from pathlib import Path

import can
import pytest

from device_profiles import IMITATIONS
from hil_bench import ConfigError, VirtualBench, load_config
from hil_bench.abilities.live.session_feed import GetObject

IO = IMITATIONS / "analogue_io_401.eds"
DEVICE = Path(__file__).parent / "canopen_device" / "device.eds"
TPDO2 = 0x28A  # of the module: inputs 1 to 4, INTEGER16 each


def write_config(path, *, eds, objects=""):
    path.write_text(f'[nodes.io]\nnode_id = 10\neds = "{eds}"\n[nodes.io.objects]\n{objects}\n')
    return load_config(path)


@pytest.fixture
def io(tmp_path):
    """A bench of one module without an axis, its TPDO event-driven alone; OPERATIONAL."""
    config = write_config(tmp_path / "io.toml", eds=IO, objects='"0x1801.05" = 0')
    with VirtualBench(config) as bench:
        start(bench)
        yield bench


@pytest.fixture
def device(tmp_path):
    """A bench of the device that has an object of each kind."""
    with VirtualBench(write_config(tmp_path / "device.toml", eds=DEVICE)) as bench:
        start(bench)
        yield bench


def start(bench):
    bench.run(0.001)
    send(bench, 0x000, b"\x01\x00")  # NMT: start all
    bench.run(0.004)
    bench.frames.clear()


def send(bench, can_id, data):
    bench.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))


def sent(bench, can_id):
    return [logged.frame.data for logged in bench.frames if logged.frame.can_id == can_id]


def test_a_bench_of_nodes_alone_has_no_axis(io):
    assert io.config.axes == io.bench.axes == ()
    assert io.signals.dtype.names == ("time",)
    assert list(io.nodes) == ["io"]


def test_a_changed_input_goes_by_event_with_the_next_tick(io):
    io.nodes["io"]["0x6401.01"] = 1234
    assert io.nodes["io"]["0x6401.01"] == 1234
    io.run(0.001)
    assert sent(io, TPDO2) == [(1234).to_bytes(2, "little") + bytes(6)]


def test_the_same_value_is_no_event(io):
    io.nodes["io"]["0x6401.01"] = 0
    io.run(0.01)
    assert sent(io, TPDO2) == []


def test_two_inputs_set_in_one_tick_go_together(io):
    io.nodes["io"]["0x6401.01"] = -1
    io.nodes["io"]["0x6401.04"] = 32767
    io.run(0.01)
    assert sent(io, TPDO2) == [bytes.fromhex("ffff00000000ff7f")]


def test_what_the_bus_writes_is_read(io):
    send(io, 0x30A, b"\x39\x30\x00\x80")  # RPDO 2: both outputs, INTEGER16
    io.run(0.001)
    assert (io.nodes["io"]["0x6411.01"], io.nodes["io"]["0x6411.02"]) == (12345, -32768)


def test_a_parameter_of_the_communication_acts_as_if_the_bus_had_written_it(io):
    io.nodes["io"]["0x1801.05"] = 2  # event timer [ms]
    io.run(0.02)
    assert len(sent(io, TPDO2)) == 10  # at 6, 8, ... 24 ms: a new timer begins with a transmission


def test_all_objects_have_names(io):
    names = list(io.nodes["io"])
    assert names == sorted(names)
    assert "0x1000.00" in names
    assert "0x6401.04" in io.nodes["io"]
    assert "0x6401" in io.nodes["io"]  # sub-index 0
    assert "0x6401.05" not in io.nodes["io"]


@pytest.mark.parametrize(
    ("name", "value", "held"),
    [
        ("0x2002", -1 & 0xFFFFFF, 0xFFFFFF),  # UNSIGNED24
        ("0x2003", True, True),  # BOOLEAN
        ("0x2003", 0, False),
        ("0x2012", 1.5, 1.5),  # REAL32
        ("0x2012", 3, 3.0),
        ("0x2012", math.inf, math.inf),
        ("0x2012", 0.1, 0.10000000149011612),  # the nearest REAL32, as the bus shows it
        ("0x2020", "Zylinder", "Zylinder"),  # VISIBLE_STRING
        ("0x2021", b"\x00\xff", b"\x00\xff"),  # DOMAIN
        ("0x2027", "µm", "µm"),  # UNICODE_STRING
    ],
)
def test_each_data_type_is_set_and_read(device, name, value, held):
    device.nodes["io"][name] = value
    assert device.nodes["io"][name] == held
    assert type(device.nodes["io"][name]) is type(held)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("0x2011", 32768, '0x2011.00 "Actual value" is INTEGER16, which cannot hold 32768; give -32768 to 32767'),
        ("0x2011", 1.5, '0x2011.00 "Actual value" is INTEGER16, which cannot hold 1.5; give -32768 to 32767'),
        ("0x2011", "7", "0x2011.00 \"Actual value\" is INTEGER16, which cannot hold '7'; give -32768 to 32767"),
        ("0x2011", None, '0x2011.00 "Actual value" is INTEGER16, which cannot hold None; give -32768 to 32767'),
        ("0x2013", 2, '0x2013.00 "Contact" is BOOLEAN, which cannot hold 2; give True or False'),
        ("0x2012", "1.5", "0x2012.00 \"Measured value\" is REAL32, which cannot hold '1.5'; give a number"),
        ("0x2012", 1e39, '0x2012.00 "Measured value" is REAL32, which cannot hold 1e+39; give a number'),
        ("0x2020", "µm", "0x2020.00 \"Text\" is VISIBLE_STRING, which cannot hold 'µm'; give text"),
        ("0x2020", "a\nb", "0x2020.00 \"Text\" is VISIBLE_STRING, which cannot hold 'a\\nb'; give text"),
        ("0x2021", "abc", "0x2021.00 \"File\" is DOMAIN, which cannot hold 'abc'; give bytes"),
        ("0x1800.02", 245, '0x1800.02 "Transmission type" refuses 245: invalid value for parameter; give 0 to 255'),
        ("0x1018.01", 7, '0x1018.01 "Vendor-ID" is const; give it as power-on value in [nodes.io.objects]'),
        ("0x2f00", 7, '0x2f00 is not in'),
        ("2011", 7, '"2011" is no object; write index and sub-index in hexadecimal, as in "0x1400.05" or "0x6042"'),
        (0x2011, 7, '8209 is no object; write index and sub-index in hexadecimal, as in "0x1400.05" or "0x6042"'),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_by_name_and_changes_nothing(device, name, value, message):
    before = {key: device.nodes["io"][key] for key in device.nodes["io"]}
    with pytest.raises(ConfigError, match=f"^nodes.io: {re.escape(message)}"):
        device.nodes["io"][name] = value
    assert {key: device.nodes["io"][key] for key in device.nodes["io"]} == before


def test_a_limit_of_the_eds_file_holds(tmp_path):
    eds = tmp_path / "limited.eds"
    text = IO.read_text()
    at = text.index("[6401sub1]")
    limited = text[at:].replace("AccessType=ro", "AccessType=ro\nLowLimit=-100\nHighLimit=100", 1)
    eds.write_text(text[:at] + limited)
    with VirtualBench(write_config(tmp_path / "limited.toml", eds=eds)) as bench:
        bench.nodes["io"]["0x6401.01"] = 100
        with pytest.raises(ConfigError, match=r"refuses 101: .* too high; give -100 to 100$"):
            bench.nodes["io"]["0x6401.01"] = 101
        assert bench.nodes["io"]["0x6401.01"] == 100


def test_an_object_that_shows_the_plant_is_not_set_by_hand(make_file):
    path = make_file(
        "bound.toml",
        f'[nodes.io]\nnode_id = 10\neds = "{IO}"\n[nodes.io.objects]\n'
        '"0x6401.01" = { source = "axis1.P_A" }\n"0x6411.01" = { sink = "axis1.spool_setpoint" }\n',
    )
    with VirtualBench(load_config(path)) as bench:
        with pytest.raises(
            ConfigError,
            match=r'^nodes\.io: 0x6401\.01 "Analogue input 1" shows axis1\.P_A in each tick; '
            r"give it no source, or disturb it by bench\.faults$",
        ):
            bench.nodes["io"]["0x6401.01"] = 1
        bench.nodes["io"]["0x6401.02"] = 1  # the one beside it


def test_a_node_that_is_not_there_is_named_with_those_that_are():
    with VirtualBench() as bench:
        right = "valve, pressure_a, pressure_b, position"
        with pytest.raises(
            ConfigError, match=f'^nodes: there is no node "oi"; give one of {right}$'
        ):
            bench.nodes["oi"]
        assert bench.nodes["position"]["0x1000"] == 0x00080196


def test_a_valve_obeys_a_control_word_from_python():
    with VirtualBench() as bench:
        bench.run(0.002)
        bench.nodes["valve"]["0x6040"] = 1
        bench.run(0.001)
        # Bits R M H D: 1001 is DISABLED, where D = 1 leads from INIT (CiA 408).
        assert bench.nodes["valve"]["0x6041"] & 0xF == 0b1001


def test_a_node_without_power_answers_nothing(io):
    with io.faults.reset("io"):
        io.run(0.001)
        for reach in (
            lambda: io.nodes["io"]["0x6401.01"],
            lambda: GetObject("io", "0x1018.01").act(io.session.controls, 0),
        ):
            with pytest.raises(ConfigError, match="is out of reach: the node has no power"):
                reach()
        with pytest.raises(ConfigError, match="is out of reach: the node has no power"):
            io.nodes["io"]["0x6401.01"] = 1
    io.run(0.001)
    assert io.nodes["io"]["0x6401.01"] == 0
