"""`[buses.NAME]`: further buses, and which nodes are on them."""

from collections.abc import Callable
from pathlib import Path

import pytest

from hil_bench.bench.configuration import BusConfig, load_config
from hil_bench.errors import ConfigError

Write = Callable[[str], Path]

NODES = """
[nodes]
valve = { profile = "valve_408", node_id = 1 }
position = { profile = "encoder_406", bus = "sensors", node_id = 1 }
"""


def problems(path):
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    return [line.removeprefix(f"{path}:") for line in str(caught.value).splitlines()]


def test_a_node_is_on_the_first_bus_unless_it_names_another(write):
    config = load_config(write('[bus]\nchannel = "a"\n[buses.sensors]\nchannel = "b"\n' + NODES))
    assert config.buses == {"bus": BusConfig(channel="a"), "sensors": BusConfig(channel="b")}
    assert [(node.name, node.bus) for node in config.nodes] == [
        ("valve", "bus"),
        ("position", "sensors"),
    ]
    seen = config.seen_from("sensors")
    assert [(node.name, node.bus) for node in seen.nodes] == [("position", "bus")]
    assert seen.buses == {"bus": BusConfig(channel="b")}


def test_the_command_line_is_for_the_first_bus(write):
    path = write('[bus]\nchannel = "a"\n[buses.sensors]\nchannel = "b"\n' + NODES)
    config = load_config(path, interface="virtual", channel="c")
    assert (config.bus.channel, config.further_buses["sensors"].channel) == ("c", "b")


def test_further_keys_are_for_the_bus_class(write):
    text = '[buses.sensors]\ninterface = "socketcand"\nchannel = "b"\nhost = "h"\nport = 1\n'
    config = load_config(write(text + NODES))
    assert config.further_buses["sensors"].options == {"host": "h", "port": 1}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            '[buses.sensor]\nchannel = "b"\n' + NODES,
            [
                'nodes.position.bus: there is no bus "sensors"; give one of bus, sensor',
                'buses.sensor: no node is on it; give one bus = "sensor", or leave the table out',
            ],
        ),
        (
            '[bus]\nchannel = "a"\n[buses.sensors]\nchannel = "a"\n' + NODES,
            ['buses.sensors.channel: "a" is that of [bus] too; give each bus a channel of its own'],
        ),
        (
            '[buses.bus]\nchannel = "b"\n[buses.sensors]\nchannel = "c"\n' + NODES,
            ["buses.bus: [bus] is the first bus; give a further one another name"],
        ),
        (
            '[buses.sensors]\nchannel = "b"\n' + NODES + '[nodes.second]\nprofile = "encoder_406"\n'
            'bus = "sensors"\nnode_id = 1\n',
            ["nodes.second.node_id: 1 is taken by nodes.position; 2 is free"],
        ),
        (
            '[buses.sensors]\nchanne = "b"\n' + NODES,
            ["buses.sensors.channe: unknown key; the nearest known key is channel"],
        ),
    ],
)
def test_what_makes_no_sense_is_told(write, text, expected):
    assert problems(write(text)) == expected


def test_more_buses_than_any_machine_has_are_refused(write):
    names = [f"b{number}" for number in range(8)]
    text = "".join(f'[buses.{name}]\nchannel = "{name}"\n' for name in names)
    text += "".join(
        f'[nodes.n{name}]\nprofile = "encoder_406"\nbus = "{name}"\nnode_id = 1\n' for name in names
    )
    text += '[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n'
    assert problems(write(text)) == ["buses: 9 buses with [bus]; give at most 8"]


@pytest.mark.parametrize(
    ("count", "right"), [(126, "127 is free"), (127, "a bus has room for 127 nodes")]
)
def test_a_full_bus_is_told_from_one_with_room(write, count, right):
    nodes = [f'[nodes.n{n}]\nprofile = "encoder_406"\nnode_id = {n}\n' for n in range(1, count + 1)]
    more = '[nodes.more]\nprofile = "encoder_406"\nnode_id = 5\n'
    assert f"nodes.more.node_id: 5 is taken by nodes.n5; {right}" in problems(
        write("".join([*nodes, more]))
    )
