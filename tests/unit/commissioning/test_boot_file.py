"""The network list of a file: what it gives, and what is said of a wrong one."""

from pathlib import Path

import pytest
from support.tables import from_text

from device_profiles import PRESSURE_404, VALVE_408
from hil_bench.abilities.commissioning.verbs.boot import load_boot_plan
from hil_bench.errors import ConfigError
from hil_drivers.boot_records import Loss, Slave, Start, Startup
from hil_drivers.concise_dcf import ConciseEntry, pack_concise_dcf

EXAMPLE = Path(__file__).parents[3] / "examples" / "network.toml"


@pytest.fixture
def plan_of(tmp_path):
    def load(text):
        path = tmp_path / "network.toml"
        path.write_text(text, encoding="utf-8")
        return load_boot_plan(path)

    return load


def test_the_example_is_one():
    plan = load_boot_plan(EXAMPLE)
    assert (plan.node_id, plan.heartbeat) == (127, 0.1)
    assert plan.startup == Startup(Start.ALL, Loss.SLAVE, 10.0)
    valve = plan.slaves[0]
    # By the EDS: 408 in 0x1000; product code and revision, and no vendor and serial number.
    assert (valve.device_type, valve.identity) == (0x198, (0, 0x408, 0x10000, 0))
    assert valve.heartbeat_time == 0.15
    assert [slave.mandatory for slave in plan.slaves] == [True, True, False, True]


def test_all_keys_have_their_place(plan_of, tmp_path):
    entries = (ConciseEntry(0x1017, 0, b"\x32\0"),)
    (tmp_path / "valve.cdcf").write_bytes(pack_concise_dcf(entries))
    plan = plan_of("""
[master]
node_id = 100
start = "none"
on_loss = "stop all"
boot_time_s = 0
[slaves.valve]
node_id = 3
mandatory = false
boot = false
keep_alive = true
device_type = 0x198
vendor_id = 1
product_code = 2
revision_number = 3
serial_number = 4
heartbeat_time_ms = 250
concise_dcf = "valve.cdcf"
configured = 1984-01-02T00:00:01.5
store = true
restore = 1
""")
    assert (plan.node_id, plan.heartbeat) == (100, 0.0)
    assert plan.startup == Startup(Start.NONE, Loss.STOP_ALL, 0.0)
    # CiA 302-3: days since 1984-01-01, and milliseconds after midnight.
    assert plan.slaves == (
        Slave(
            3,
            "valve",
            mandatory=False,
            boots=False,
            keep_alive=True,
            device_type=0x198,
            identity=(1, 2, 3, 4),
            configuration=entries,
            date=1,
            time=1500,
            store=True,
            restore=1,
            heartbeat_time=0.25,
        ),
    )


def test_what_the_eds_says_may_be_given_otherwise(plan_of):
    (slave,) = plan_of(
        f'[slaves.valve]\nnode_id = 1\neds = "{VALVE_408}"\nrevision_number = 0\nvendor_id = 5\n'
    ).slaves
    assert slave.identity == (5, 0x408, 0, 0)


def test_an_eds_without_an_entry_of_identity_asks_for_none(plan_of, tmp_path):
    eds = tmp_path / "valve.eds"
    text = VALVE_408.read_text(encoding="utf-8").replace("[1018sub4]", "[2FFF]")
    eds.write_text(text, encoding="utf-8")
    (slave,) = plan_of(f'[slaves.valve]\nnode_id = 1\neds = "{eds}"\n').slaves
    assert slave.identity == (0, 0x408, 0x10000, 0)


def test_objects_follow_the_procedure_of_pdos(plan_of):
    (slave,) = plan_of(f"""
[slaves.valve]
node_id = 1
eds = "{VALVE_408}"
objects = {{ "0x1A00.01" = 0x63010110, "0x1A00.00" = 1, "0x1017" = 50 }}
""").slaves
    # The EDS: TPDO1 is 0x40000181. CiA 301: off, mapping emptied, written, counted, on.
    assert [(entry.index, entry.subindex, entry.data.hex()) for entry in slave.configuration] == [
        (0x1017, 0, "3200"),
        (0x1800, 1, "810100c0"),
        (0x1A00, 0, "00"),
        (0x1A00, 1, "10010163"),
        (0x1A00, 0, "01"),
        (0x1800, 1, "81010040"),
    ]


VALVE = f'[slaves.valve]\nnode_id = 1\neds = "{VALVE_408}"\n'


@from_text("text", "what")
def test_what_is_wrong_is_said_in_a_line(plan_of, text, what):
    with pytest.raises(ConfigError) as caught:
        plan_of(text)
    (line,) = str(caught.value).splitlines()
    assert "network.toml" in line
    assert what in line


def test_times_reach_as_far_as_16_bits_of_milliseconds(plan_of):
    plan = plan_of("[master]\nheartbeat_ms = 1\n" + VALVE + "heartbeat_time_ms = 65535\n")
    assert (plan.heartbeat, plan.slaves[0].heartbeat_time) == (0.001, 65.535)


def test_a_dcf_is_a_configuration(plan_of, make_file):
    text = PRESSURE_404.read_text(encoding="utf-8")
    make_file("a.dcf", text.replace("[1017]\n", "[1017]\nParameterValue=50\n"))
    (slave,) = plan_of('[slaves.a]\nnode_id = 2\ndcf = "a.dcf"\n').slaves
    assert slave.configuration == (ConciseEntry(0x1017, 0, b"\x32\0"),)
    assert slave.device_type == 0x0002_0194
