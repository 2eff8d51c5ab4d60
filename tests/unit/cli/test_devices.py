import dataclasses
import json
from pathlib import Path

import canopen
import pytest
from support.documents import ROOT

from hil_bench.bench.configuration import load_config
from hil_bench.cli import main
from hil_bench.cli.devices import DeviceRow, ObjectRow, PdoRow, _device_lines, read_devices

OBJECTS = (
    ObjectRow(0x6040, 0, "Control word", "UNSIGNED16"),
    ObjectRow(0x6300, 1, "Set-point", "INTEGER16"),
)


def lines(*pdos):
    device = DeviceRow("valve", 1, "valve_408", "axis1", "/eds/valve.eds", pdos)
    return list(_device_lines(device))


def test_a_device_is_told_with_its_pdos_and_their_objects():
    rpdo, tpdo = (
        PdoRow("RPDO1", 0x201, 255, 100, OBJECTS),
        PdoRow("TPDO1", 0x181, 1, 0, OBJECTS[1:]),
    )

    assert lines(rpdo, tpdo) == [
        "node 1  valve  valve_408  axis1",
        "  EDS    /eds/valve.eds",
        "  RPDO1  0x201  255 on event, time-out 100 ms   0x6040.00  Control word (UNSIGNED16)",
        "                                                0x6300.01  Set-point (INTEGER16)",
        "  TPDO1  0x181    1 every SYNC                  0x6300.01  Set-point (INTEGER16)",
    ]


@pytest.mark.parametrize(
    ("name", "transmission_type", "event_time_ms", "words"),
    [
        ("TPDO1", 0, 0, "0 on event, with SYNC"),
        ("TPDO1", 1, 0, "1 every SYNC"),
        ("TPDO1", 10, 0, "10 every 10 SYNCs"),
        ("TPDO1", 254, 10, "254 on event, timer 10 ms"),
        ("TPDO1", 255, 0, "255 on event"),
        # CiA 301: what an RPDO of type 0 to 240 received acts with the next SYNC.
        ("RPDO1", 0, 0, "0 with the next SYNC"),
        ("RPDO1", 240, 20, "240 with the next SYNC, time-out 20 ms"),
        ("RPDO1", 254, 0, "254 on event"),
    ],
)
def test_a_transmission_type_is_told_in_words(name, transmission_type, event_time_ms, words):
    line = lines(PdoRow(name, 0x181, transmission_type, event_time_ms, ()))[-1]

    assert line.split(maxsplit=2)[2] == words


def test_the_default_bench_has_the_identifiers_of_the_predefined_connection_set():
    devices = read_devices(load_config())
    found = {(d.name, pdo.name): pdo.can_id for d in devices for pdo in d.pdos}

    # CiA 301: RPDO1 at 0x200, TPDO1 at 0x180, each plus the node-ID.
    assert found["valve", "RPDO1"] == 0x201
    assert found["valve", "TPDO1"] == 0x181
    assert found["pressure_a", "TPDO1"] == 0x182
    assert found["pressure_b", "TPDO1"] == 0x183
    assert found["position", "TPDO1"] == 0x184


def test_timers_are_those_of_the_eds_in_milliseconds():
    devices = read_devices(load_config())
    found = {d.name: pdo.event_time_ms for d in devices for pdo in d.pdos if pdo.name == "TPDO1"}

    for device in devices:
        eds = canopen.import_od(device.eds, device.node_id)  # an independent reader
        assert found[device.name] == eds[0x1800][5].default


def test_the_valves_pdos_carry_what_a_controller_needs():
    valve = read_devices(load_config())[0]
    found = {pdo.name: [(o.index, o.subindex) for o in pdo.objects] for pdo in valve.pdos}

    # Issue: RPDO1 = control word + set-point, TPDO1 = status word + actual value.
    assert found["RPDO1"] == [(0x6040, 0), (0x6300, 1)]
    assert found["TPDO1"] == [(0x6041, 0), (0x6301, 1)]


def test_a_node_without_node_id_has_no_identifiers_yet(tmp_path, cli):
    path = tmp_path / "bench.toml"
    path.write_text(
        '[nodes.v]\nprofile = "valve_408"\nnode_id = "unconfigured"\nserial_number = 1\n'
    )
    lines = cli(["devices", str(path)]).out.splitlines()
    assert lines[0] == "node unconfigured  v  valve_408  axis1"
    assert [line.split()[0] for line in lines[1:]] == ["EDS"]


def test_the_table_stands_in_the_order_of_node_ids_and_in_100_columns(cli):
    text = cli("devices").out.splitlines()
    nodes = [line for line in text if line.startswith("node ")]
    assert [line.split()[1:3] for line in nodes] == [
        ["1", "valve"],
        ["2", "pressure_a"],
        ["3", "pressure_b"],
        ["4", "position"],
    ]
    assert max(len(line) for line in text if "  EDS" not in line) <= 100


def test_json_has_the_same_devices(capsys):
    example = Path(__file__).parents[3] / "examples" / "two_axes.toml"
    assert main(["devices", str(example), "--json"]) == 0

    expected = [dataclasses.asdict(device) for device in read_devices(load_config(example))]
    assert json.loads(capsys.readouterr().out) == json.loads(json.dumps(expected))
    assert [device["node_id"] for device in expected] == [1, 4, 11, 12, 13, 14]


def test_j1939_devices_stand_behind_the_nodes(cli):
    blocks = cli(["devices", str(ROOT / "examples" / "j1939.toml")]).out.rstrip().split("\n\n")

    assert blocks[0].startswith("node 4  position")
    assert [block.splitlines()[0] for block in blocks[1:]] == [
        "J1939 19  joystick  table",
        "J1939 128  valve  auxiliary_valve  axis1",
        "J1939 140  sensors  table",
    ]
    # ISO 11783-7: auxiliary valve 0 is commanded by PGN 65072, and says its flow by PGN 65040.
    assert [line.split() for line in blocks[2].splitlines()[1:]] == [
        ["takes", "PGN", "65072", "(0xFE30)", "command"],
        ["sends", "PGN", "65040", "(0xFE10)", "every", "100", "ms", "estimated", "flow"],
    ]


def test_a_group_of_signals_that_come_and_go_has_a_line_each_way(make_file, cli):
    path = make_file(
        "bench.toml",
        "[plant.axis1]\n[j1939.box]\naddress = 7\n[j1939.box.signals]\n"
        'flow = { pgn = 0xFF20, start_bit = 0, length = 8, sink = "axis1.spool_setpoint" }\n'
        'a = { pgn = 0xFF20, start_bit = 0, length = 8, source = "axis1.P_A", unit = "bar" }\n'
        'b = { pgn = 0xFF20, start_bit = 8, length = 8, source = "axis1.P_B", unit = "bar" }\n',
    )

    (box,) = json.loads(cli(["devices", str(path), "--json"]).out)
    assert (box["name"], box["address"], box["kind"], box["axis"]) == ("box", 7, "table", None)
    assert box["messages"] == [
        {"pgn": 0xFF20, "role": "takes", "rate_ms": 0, "signals": ["flow"]},
        {"pgn": 0xFF20, "role": "sends", "rate_ms": 0, "signals": ["a", "b"]},
    ]
