"""The bus against the configuration."""

import re
from types import SimpleNamespace

import pytest

from device_profiles import IMITATIONS, PRESSURE_404
from hil_bench.abilities.commissioning.comparison import (
    Mend,
    apply,
    compare,
    concise_dcf,
    expected_values,
    plan_writes,
)
from hil_bench.abilities.commissioning.measures import Verdict
from hil_bench.abilities.commissioning.plan import Limits, Step, StepKind
from hil_bench.abilities.commissioning.rig import communication

MACHINE = """
[plant.axis1]
[nodes.valve]
profile = "valve_408"
node_id = 1
[nodes.pressure]
profile = "pressure_404"
node_id = 2
source = "P_A"
{more}
"""


def keys(differences):
    return {difference.key for difference in differences}


def test_a_bus_that_is_as_configured_has_no_difference(open_bench, load_bench):
    _, network = open_bench(MACHINE.format(more=""))
    assert compare(network, load_bench(MACHINE.format(more=""))) == []


def test_only_reads_are_sent(open_bench, load_bench):
    bench, network = open_bench(MACHINE.format(more=""))
    bench.frames.clear()
    compare(network, load_bench(MACHINE.format(more='objects = { "0x1017" = 50 }')))
    sent = [logged.frame for logged in bench.frames if logged.is_received]
    assert {frame.can_id & 0x780 for frame in sent} == {0x600}
    # Initiate upload and upload segment alone (CiA 301): 0x40, 0x60, 0x70.
    assert {frame.data[0] & 0xE0 for frame in sent} <= {0x40, 0x60}


def test_a_missing_and_an_unexpected_node_are_named(open_bench, load_bench):
    _, network = open_bench(MACHINE.format(more=""))
    expected = MACHINE.format(more="").replace("node_id = 2", "node_id = 3")
    missing, unexpected = (
        difference for difference in reversed(compare(network, load_bench(expected)))
    )
    assert "node 3 (pressure): does not answer" in missing.what
    assert "node 2: is on the bus" in unexpected.what
    assert missing.mend is unexpected.mend is Mend.NODE


def test_a_difference_names_object_found_and_right_value(open_bench, load_bench):
    _, network = open_bench(MACHINE.format(more=""))
    config = load_bench(MACHINE.format(more='objects = { "0x1017" = 50, "0x1800.05" = 25 }'))
    heartbeat, timer = compare(network, config)
    assert heartbeat.key == (0x1017, 0)
    assert "is 0; 50 by the configuration" in heartbeat.what
    assert timer.key == (0x1800, 5)
    assert "is 10; 25 by" in timer.what  # 10 ms by the EDS


def test_another_product_is_a_difference_of_its_own(open_bench, load_bench):
    _, network = open_bench(MACHINE.format(more=""))
    swapped = MACHINE.format(more="").replace("node_id = 1", "node_id = 9")
    swapped = swapped.replace("node_id = 2", "node_id = 1").replace("node_id = 9", "node_id = 2")
    found = [d for d in compare(network, load_bench(swapped)) if d.node_id == 1]
    # CiA 408 and CiA 404 as device types, and the EDS files' product codes.
    assert keys(found) == {(0x1000, 0), (0x1018, 2)}
    assert all(difference.mend is Mend.NODE for difference in found)


def described_otherwise(folder, *changes):
    """Return the machine's configuration with values of the EDS of node 2 replaced."""
    text = PRESSURE_404.read_text(encoding="utf-8")
    for section, value in changes:
        head, _, rest = text.partition(f"[{section}]\n")
        text = f"{head}[{section}]\n" + re.sub(
            "DefaultValue=.*", f"DefaultValue={value}", rest, count=1
        )
    eds = folder / "other.eds"
    eds.write_text(text, encoding="utf-8")
    return MACHINE.format(more="").replace('profile = "pressure_404"', f'eds = "{eds}"')


@pytest.mark.parametrize(("device_type", "wrong"), [(0, [(0x1000, 0)]), ("", [])])
def test_a_device_type_of_zero_is_compared_and_what_is_open_or_a_vendor_of_zero_is_any(
    open_bench, load_bench, tmp_path, device_type, wrong
):
    _, network = open_bench(MACHINE.format(more=""))
    identity = [(f"1018sub{number}", 0) for number in (1, 2, 3)]
    expected = described_otherwise(tmp_path, ("1000", device_type), *identity)
    found = compare(network, load_bench(expected.replace('source = "P_A"', "")))
    assert [difference.key for difference in found if difference.node_id == 2] == wrong


@pytest.mark.parametrize(
    ("section", "key", "name"),
    [
        ("1000", (0x1000, 0), "another device"),
        ("1018sub1", (0x1018, 1), "another device"),
        ("1018sub2", (0x1018, 2), "another device"),
        ("1018sub3", (0x1018, 3), "wrong EDS revision"),
    ],
)
def test_each_entry_of_the_identity_is_compared_and_nothing_moves(
    open_bench, load_bench, tmp_path, section, key, name
):
    _, network = open_bench(MACHINE.format(more=""))
    expected = described_otherwise(tmp_path, (section, 0x77)).replace('source = "P_A"', "")
    config = load_bench(expected)
    members = [node for node in config.nodes if node.node_id == 2]
    procedure = SimpleNamespace(network=network, config=config, members=members)
    limits = Limits((0.0, 0.0), 0.0, (0.0, 0.0), 0.0)
    found = communication(procedure, Step(StepKind.COMMUNICATION, limits, {}))
    assert (found.verdict, [each.name for each in found.findings]) == (Verdict.STOPPED, [name])
    assert f"0x{key[0]:04X}.{key[1]:02X} " in found.findings[0].evidence
    assert {each.name: each.value for each in found.measures} == {
        "nodes as configured": 0.0,
        "settings that differ from the EDS": 0.0,
    }


@pytest.mark.parametrize("section", ["1003sub0", "1010sub1", "1011sub1", "1012", "1013"])
def test_commands_and_clocks_are_no_settings(open_bench, load_bench, tmp_path, section):
    """CiA 301: the number of errors, store, restore, the time stamps."""
    _, network = open_bench(MACHINE.format(more=""))
    index, _, subindex = section.partition("sub")
    text = described_otherwise(tmp_path).replace('source = "P_A"', "")
    eds = tmp_path / "other.eds"
    known = eds.read_text(encoding="utf-8")
    head, _, rest = known.partition(f"[{section}]\n")
    if rest:
        rest = rest.partition("\n\n")[2]
    added = f"[{section}]\nParameterName=x\nObjectType=7\nDataType=7\nAccessType=rw\n"
    eds.write_text(f"{head}\n{added}DefaultValue=3\nPDOMapping=0\n\n{rest}", encoding="utf-8")
    config = load_bench(text)
    node = network.add_node(2, eds)
    assert node.has(int(index, 16), int(subindex or 0))
    assert (int(index, 16), int(subindex or 0)) not in expected_values(node, config.nodes[1])


def test_a_serial_number_is_compared_where_the_configuration_gives_one(open_bench, load_bench):
    _, network = open_bench(MACHINE.format(more="serial_number = 5"))
    found = compare(network, load_bench(MACHINE.format(more="serial_number = 6")))
    assert keys(found) == {(0x1018, 4)}


def test_a_changed_mapping_is_found_and_mended_by_the_procedure(open_bench, load_bench):
    bench, network = open_bench(MACHINE.format(more=""))
    objects = next(node for node in bench.bench.nodes if node.node_id == 2).object_dictionary
    right = objects.number(0x1A00, 1)
    kind = objects.number(0x1800, 2)
    for index, subindex, value in ((0x1A00, 0, 1), (0x1A00, 1, 0x10010008), (0x1800, 2, 7)):
        objects.variable(index, subindex).value = value
    config = load_bench(MACHINE.format(more=""))
    differences = compare(network, config)
    assert (0x1A00, 1) in keys(differences)
    said = {each.key: each.what for each in differences}
    assert "is 1; 2 by" in said[0x1A00, 0]
    assert f"is 0x10010008; 0x{right:08X} by" in said[0x1A00, 1]
    (plan,) = plan_writes(network, config, differences)
    order = [(write.key, write.value) for write in plan.writes]
    # CiA 301: disable the PDO, number of entries 0, the entries, their number, enable the PDO.
    identifier = objects.number(0x1800, 1)
    assert order[0] == ((0x1800, 1), identifier | 1 << 31)
    assert order[1:4] == [((0x1800, 2), kind), ((0x1A00, 0), 0), ((0x1A00, 1), right)]
    assert order[-1] == ((0x1800, 1), identifier)
    apply(network, plan, store=False)
    assert compare(network, config) == []


def test_what_was_applied_and_stored_is_there_after_a_power_cycle(open_bench, load_bench):
    _, network = open_bench(MACHINE.format(more=""))
    config = load_bench(MACHINE.format(more='objects = { "0x1017" = 50 }'))
    (plan,) = plan_writes(network, config, compare(network, config))
    apply(network, plan, store=True)
    network.reset_node(2)
    assert compare(network, config) == []


def test_what_was_not_stored_is_gone_after_a_reset(open_bench, load_bench):
    _, network = open_bench(MACHINE.format(more=""))
    config = load_bench(MACHINE.format(more='objects = { "0x1017" = 50 }'))
    (plan,) = plan_writes(network, config, compare(network, config))
    apply(network, plan, store=False)
    network.reset_node(2)
    assert keys(compare(network, config)) == {(0x1017, 0)}


def test_commands_are_no_settings(open_bench, load_bench):
    _, network = open_bench(MACHINE.format(more=""))
    network.start_node()
    network.send(0x201, bytes.fromhex("07000010"))  # control word and set-point by RPDO 1
    network.pump(0.01)
    assert compare(network, load_bench(MACHINE.format(more=""))) == []


def test_the_concise_dcf_has_the_layout_of_cia_302(open_bench, load_bench):
    _, network = open_bench(MACHINE.format(more=""))
    config = load_bench(MACHINE.format(more='objects = { "0x1017" = 50 }'))
    (plan,) = plan_writes(network, config, compare(network, config))
    # Number of entries; index, sub-index, size and data of each: little endian.
    assert concise_dcf(plan) == bytes.fromhex("01000000 1710 00 02000000 3200")


def test_two_devices_under_one_node_id_are_named(device, device_network, load_bench):
    device.answer(
        0x601, "4000100000000000", (0x581, "4300100098010000"), (0x581, "4300100094010200")
    )
    differences = compare(device_network, load_bench(MACHINE.format(more="")))
    assert "2 devices answer under this node-ID" in differences[0].what


def test_a_device_that_answers_aborts_only_is_one_difference(device, device_network, load_bench):
    device.refuse_all(1)
    refused, missing = compare(device_network, load_bench(MACHINE.format(more="")))
    assert refused.what == (
        "node 1 (valve): cannot read 0x1000 (Device type): SDO abort 0x08000000, General error"
    )
    assert refused.mend is Mend.NODE
    assert "node 2 (pressure): does not answer" in missing.what


def test_a_device_that_falls_silent_is_named_once(device, device_network, load_bench):
    device.answer(0x601, "4000100000000000", (0x581, "8000100000000206"))
    found = [
        d for d in compare(device_network, load_bench(MACHINE.format(more=""))) if d.node_id == 1
    ]
    assert len(found) == 1
    assert "0x1000" in found[0].what


BOUND = f"""
[nodes.io]
node_id = 10
eds = "{IMITATIONS / "analogue_io_401.eds"}"
[nodes.io.objects]
"0x1601.00" = 1
"0x6411.02" = {{ sink = "axis1.spool_setpoint", scale = 16384 }}
"""


def test_what_a_bound_object_holds_is_no_difference(open_bench, load_bench):
    _, network = open_bench(BOUND)
    node = network.add_node(10, IMITATIONS / "analogue_io_401.eds")
    node.write(0x6411, 2, 8192)
    assert node.read_integer(0x6411, 2) == 8192
    assert compare(network, load_bench(BOUND)) == []
