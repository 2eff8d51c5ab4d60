# ruff: noqa: E501 - a mistake and its message on one line are easier to compare
"""The tables [[faults]] and the option --fault."""

from pathlib import Path

import pytest
from support.tables import from_text

from device_profiles import VALVE_408
from hil_bench import ConfigError, Faults
from hil_bench.abilities.faults.checks import BrokenReading, FaultDirection, LeakPath
from hil_bench.abilities.faults.fault import FaultConfig
from hil_bench.abilities.faults.options import parse_fault
from hil_bench.abilities.faults.registry import FAULT_KINDS
from hil_bench.abilities.faults.section import FaultsPart
from hil_bench.abilities.j1939 import fault_kinds as ecu_kinds
from hil_bench.abilities.j1939.protocol.signal_table import Indication
from hil_bench.bench.assembly import build_bench
from hil_bench.bench.configuration import Origin, load_config

IO = """
[plant.axis1]
[nodes.io]
eds = "io.eds"
node_id = 5
[nodes.io.objects]
"0x6401.01" = { source = "axis1.P_A", unit = "bar", scale = 100 }
"0x6411.01" = { sink = "axis1.spool_setpoint" }
"""

EXAMPLES = {
    "freeze": ("pressure_a", "", {}),
    "offset": ("pressure_a", "offset_bar = 20", {"amount": 20e5}),
    "drift": ("position", "drift_mm_s = 5", {"rate": 5e-3}),
    "noise": ("position", "noise_mm = 0.5", {"rms": 0.5e-3}),
    "break_wire": ("pressure_a", 'reads = "high"', {"reads": BrokenReading.HIGH}),
    "slow": ("valve", "time_constant_ms = 50", {"time_constant": 0.05}),
    "stick": ("valve", "", {}),
    "invert": ("valve", "", {}),
    "disable": ("valve", "", {}),
    "drop_supply": ("axis1", "pressure_bar = 20", {"pressure": 20e5}),
    "leak": ("axis1", 'leak_l_min_bar = 0.06\npath = "a"\ngrowth_s = 2', {"conductance": 1e-11, "path": LeakPath.A, "growth": 2.0}),
    "aerate": ("axis1", "air_percent = 2", {"share": 0.02, "growth": 0.0}),
    "wear_spool": ("axis1", "opening_um = 20", {"opening": pytest.approx(20e-6), "growth": 0.0}),
    "jam": ("axis1", "force_n = 5000", {"force": 5000.0, "growth": 0.0}),
    "drop_load": ("axis1", "", {"share": 1.0, "growth": 0.0}),
    "wear_pump": ("axis1", "loss_percent = 30", {"share": 0.3, "growth": 0.0}),
    "sag_relief": ("axis1", "sag_bar = 50", {"pressure": 50e5, "growth": 0.0}),
    "lose_gas": ("axis1", "", {"share": 1.0, "growth": 0.0}),
    "clog_filter": ("axis1", "blocked_percent = 90", {"share": 0.9, "growth": 0.0}),
    "bind": ("valve", "band_percent = 5", {"band": 0.05, "growth": 0.0}),
    "weaken": ("valve", "travel_percent = 50", {"travel": 0.5, "growth": 0.0}),
    "silence": ("valve", "", {}),
    "reset": ("valve", "", {}),
    "lose": ("valve", "share_percent = 25\ncan_id = 0x181", {"share": 0.25, "can_id": 0x181}),
    "delay": ("valve", 'delay_ms = 5\ndirection = "sent"', {"time": 0.005, "direction": FaultDirection.SENT}),
    "truncate": ("valve", "length = 4", {"length": 4}),
    "corrupt": ("valve", "share_percent = 25\ncan_id = 0x181", {"share": 0.25, "can_id": 0x181}),
    "repeat": ("valve", "can_id = 0x181", {"can_id": 0x181}),
    "babble": ("valve", "frames_per_tick = 8", {"frames_per_tick": 8}),
    "bit_error": ("valve", 'share_percent = 10\ncan_id = 0x181\ndirection = "sent"', {"share": 0.1, "can_id": 0x181, "direction": FaultDirection.SENT}),
    "bus_off": ("valve", "", {}),
    "stuck_dominant": ("valve", "", {}),
    "no_acknowledge": ("valve", "", {}),
    "indicate": ("lever.x", 'shows = "not_available"', {"shows": Indication.NOT_AVAILABLE}),
    "report": ("lever", 'spn = 1208\nfmi = 3', {"spn": 1208, "fmi": 3, "lamp": "warning"}),
    "readdress": ("lever", "address = 200", {"address": 200}),
}  # fmt: skip


PLANT = """
[plant.axis1]
load_n = 1000
supply = "unit"
filter_rated_flow_l_min = 60
filter_rated_drop_bar = 1
oil_viscosity_mm2_s = 46
"""
"""An axis that can have each of them."""

NODES = PLANT + "[bus.wire]\n"
LEVER = """
[j1939.lever]
address = 19
[j1939.lever.signals]
x = { pgn = 0xFDD6, start_bit = 6, length = 10 }
"""


def fault(kind, target, more=""):
    return f'[[faults]]\nkind = "{kind}"\ntarget = "{target}"\n{more}\n'


def test_there_is_an_example_of_each_kind():
    assert EXAMPLES.keys() == FAULT_KINDS.built_in.keys()


@pytest.mark.parametrize("kind", FAULT_KINDS.built_in)
def test_each_kind_comes_in_si(write, kind):
    target, more, values = EXAMPLES[kind]
    (found,) = (
        load_config(
            write(
                (LEVER if hasattr(ecu_kinds, kind) else NODES)
                + fault(kind, target, f"{more}\nat_s = 2\nfor_s = 0.5")
            )
        )
        .of(FaultsPart)
        .faults
    )
    assert found == FaultConfig(kind, target, at=2.0, duration=0.5, values=found.values)
    assert found.values.keys() == values.keys()
    for name, value in values.items():
        expected = value if isinstance(value, str) else pytest.approx(value)
        assert found.values[name] == expected


@pytest.mark.parametrize(
    ("kind", "target"),
    [("drop_load", "axis1"), ("wear_pump", "axis1"), ("lose", "valve"), ("corrupt", "valve")],
)
def test_without_a_share_all_is_lost(write, kind, target):
    """As docs/configuration.md has it: 100 %."""
    (found,) = load_config(write(NODES + fault(kind, target))).of(FaultsPart).faults
    assert found.values["share"] == 1.0


@pytest.mark.parametrize(("base", "is_of_ecu"), [(NODES, False), (LEVER, True)])
def test_each_kind_can_be_made_and_happens(write, base, is_of_ecu):
    kinds = [kind for kind in FAULT_KINDS.built_in if (hasattr(ecu_kinds, kind)) == is_of_ecu]
    text = base + "".join(fault(kind, *EXAMPLES[kind][:2]) for kind in kinds)
    bench = build_bench(load_config(write(text)))
    bench.start(0)
    bench.tick([], 1_000_000)
    assert [each.kind for each in bench.part(Faults).active] == kinds


def test_without_times_a_fault_is_there_for_ever(write):
    (found,) = load_config(write(fault("freeze", "pressure_a"))).of(FaultsPart).faults
    assert (found.at, found.duration) == (0.0, None)


def test_the_settings_name_each_fault(write):
    config = load_config(write(fault("freeze", "pressure_a") + fault("stick", "valve")))
    tables = [setting.table for setting in config.settings if setting.key.name == "kind"]
    assert tables == ["faults[1]", "faults[2]"]


@from_text("text", "message")
def test_a_mistake_is_told(write, text, message):
    with pytest.raises(ConfigError) as caught:
        load_config(write_io(write, text))
    assert str(caught.value) == f"bench.toml:{message}"


def write_io(write, text):
    path = write(text)
    eds = Path(VALVE_408).parent / "imitations" / "analogue_io_401.eds"
    Path("io.eds").write_text(eds.read_text(encoding="utf-8"), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "faults",
    [
        fault("freeze", "io") + fault("stick", "io") + fault("offset", "io", "offset_bar = 1"),
        fault("freeze", "io.0x6401.01") + fault("slow", "io.0x6411.01", "time_constant_ms = 5"),
    ],
)
def test_bound_objects_may_have_faults(write, faults):
    bench = build_bench(load_config(write_io(write, IO + faults)))
    bench.start(0)
    bench.tick([], 1_000_000)
    assert len(bench.part(Faults).active) == faults.count("[[faults]]")


def test_faults_of_the_command_line_come_to_those_of_the_file(write):
    words = ["offset", "pressure_a", "offset_bar=20", "at_s=1"]
    config = load_config(write(fault("stick", "valve")), faults=[parse_fault(words)])
    assert [each.kind for each in config.of(FaultsPart).faults] == ["stick", "offset"]
    assert config.of(FaultsPart).faults[1].values == {"amount": 20e5}
    assert config.settings[-1].origin in {Origin.COMMAND_LINE, Origin.DEFAULT}


def test_words_need_no_quotes():
    assert parse_fault(
        ["lose", "valve", "direction=sent", "can_id=0x181", "share_percent=2.5"]
    ) == {
        "kind": "lose",
        "target": "valve",
        "direction": "sent",
        "can_id": 0x181,
        "share_percent": 2.5,
    }


@pytest.mark.parametrize(
    "words", ["freeze", "freeze at_s=1", "freeze pressure_a 2", "kind=freeze x"]
)
def test_words_that_are_no_fault_are_told(words):
    with pytest.raises(ConfigError) as caught:
        parse_fault(words.split())
    right = "give KIND TARGET [KEY=VALUE ...], as in freeze pressure_a at_s=2"
    assert str(caught.value) == f"--fault {words}: is no fault; {right}"


@from_text("words", "message")
def test_a_mistake_in_the_option_is_told(words, message):
    with pytest.raises(ConfigError) as caught:
        load_config(faults=[parse_fault(words.split())])
    assert message in str(caught.value)


IDLE = [
    ("offset", "pressure_a", "offset_bar = 0"),
    ("lose", "valve", "share_percent = 0"),
    ("delay", "valve", "delay_ms = 0"),
    ("weaken", "valve", "travel_percent = 100"),
    ("jam", "axis1", "force_n = 0"),
]


@pytest.mark.parametrize(("kind", "target", "key"), IDLE)
def test_an_amount_that_changes_nothing_is_refused(write, kind, target, key):
    with pytest.raises(ConfigError, match="changes nothing; give another amount"):
        load_config(write(NODES + fault(kind, target, key)))


def test_an_open_coil_and_a_tank_pressure_are_faults(write):
    """Travel 0 is an open coil, and a supply of 0 bar a burst hose: no amounts of a change."""
    text = fault("weaken", "valve", "travel_percent = 0")
    text += fault("drop_supply", "axis1", "pressure_bar = 0")
    assert len(load_config(write(NODES + text)).of(FaultsPart).faults) == 2


def test_no_time_is_refused(write):
    with pytest.raises(ConfigError, match=r"for_s: 0 is no time; give how long"):
        load_config(write(NODES + fault("freeze", "pressure_a", "for_s = 0")))
