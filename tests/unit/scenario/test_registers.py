"""Modbus registers in scenarios: read as a client reads them, written as a client writes them."""

from pathlib import Path

import pytest
from support.tables import from_text

from hil_bench import ConfigError, VirtualBench
from hil_bench.abilities.modbus.binding import ModbusBinding
from hil_bench.abilities.modbus.protocol.register_map import DATA_TYPES, Register, Table
from hil_bench.abilities.scenario.judgement import RequirementOutcome
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.reach import CERTAIN
from hil_bench.abilities.scenario.recorded import prepare_for_machine
from hil_bench.abilities.scenario.run import play, prepare
from hil_bench.abilities.scenario.targets import name_registers
from hil_bench.outside.recording.channels import Channel
from hil_bench.units import BAR

ROOT = Path(__file__).parents[3]
DOCUMENT = (ROOT / "docs/scenarios.md").read_text(encoding="utf-8")
COMMANDS = "[modbus.units.valve]\ncommands = true\n[modbus.units.pressure_a]\n"
HEAD = 'title = "T"\nbench = "bench.toml"\nduration_s = 0.2\n'
ANY = "[[expect]]\nid = \"R0\"\nthat = 'always axis1.P_A < 250 bar'\n"
TAKE_CONTROL = '"modbus.valve.coils.control" = 1, "modbus.valve.enable" = 1'
SHARED = (
    "is in several tables; "
    "give modbus.valve.coils.control or modbus.valve.holding_registers.control"
)
NEAREST = "is no signal here; the nearest is"
PASSED, FAILED = RequirementOutcome.PASSED, RequirementOutcome.FAILED
INCONCLUSIVE = RequirementOutcome.INCONCLUSIVE


def step(at, what):
    return f"[[step]]\nat_s = {at}\n{what}\n"


def expect(*texts):
    return "".join(f"[[expect]]\nid = \"R{k}\"\nthat = '{that}'\n" for k, that in enumerate(texts))


@pytest.fixture
def load(tmp_path):
    def write(text, bench=COMMANDS):
        (tmp_path / "bench.toml").write_text(bench)
        path = tmp_path / "a.scenario.toml"
        path.write_text(HEAD + text)
        return load_scenario(path)

    return write


def outcomes(scenario):
    return [finding.judgement.outcome for finding in play(prepare(scenario)).findings]


def problem(scenario):
    with pytest.raises(ConfigError) as caught:
        prepare(scenario)
    (line,) = str(caught.value).splitlines()
    return line.split("a.scenario.toml:")[1]


def test_a_register_is_a_signal_with_a_unit(load):
    """It shows P_A of the plant, as float32 in bar and in counts of 0.01 bar."""
    wanted = (
        "always abs(modbus.pressure_a.pressure - axis1.P_A) < 0.001 bar",
        "always abs(modbus.pressure_a.pressure_scaled - axis1.P_A) < 0.0051 bar",
        "always modbus.pressure_a.pressure > axis1.P_A + 1 bar",
        "always modbus.pressure_a.valid == 1",
    )
    assert outcomes(load(expect(*wanted))) == [PASSED, PASSED, FAILED, PASSED]


@pytest.mark.parametrize(
    ("text", "is_certain"),
    [
        # int16 in 0.01 bar: -327.68 to 327.67 bar; float32 and REAL32 have any value.
        ("modbus.pressure_a.pressure_scaled <= 327.68 bar", True),
        ("modbus.pressure_a.pressure_scaled <= 327.66 bar", False),
        ("modbus.pressure_a.pressure_scaled >= -327.69 bar", True),
        ("modbus.pressure_a.pressure < 1e5 bar", False),
        ("modbus.pressure_a.valid <= 1", True),
        ("modbus.pressure_a.status >= 0", True),
        # UNSIGNED8, UNSIGNED16, INTEGER16 (CiA 301)
        ("valve.0x1001.00 <= 255", True),
        ("valve.0x1001.00 < 255", False),
        ("valve.0x6041.00 < 65536", True),
        ("valve.0x6300.01 >= -32768 and valve.0x6300.01 <= 32767", True),
        ("valve.0x6300.01 > -32768", False),
        ("pressure_a.0x6130.01 < 1e9", False),
    ],
)
def test_what_a_data_type_cannot_hold_no_run_violates(load, text, is_certain):
    prepared = prepare(load(expect(f"always {text}")))
    assert [CERTAIN in doubt for doubt in prepared.doubts] == [True] * is_certain
    (found,) = play(prepared).findings
    assert (found.judgement.outcome, found.judgement.reason == CERTAIN) == (PASSED, is_certain)


def test_a_register_is_seen_at_each_tick(load):
    """A load of 20 kN moves the piston of 20 kg at once (Newton), and so the pressure.

    Of 100 pressures some are 0.004 bar off their count, which may be 0.005 bar off.
    """
    text = step(0.1, 'set = { "axis1.load" = "20 kN" }')
    wanted = (
        "always from 0 s to 99 ms abs(modbus.pressure_a.pressure - axis1.P_A) < 0.001 bar",
        "eventually abs(rate(axis1.P_A)) > 100 bar/s",
        "always abs(modbus.pressure_a.pressure - axis1.P_A) < 0.001 bar",
        "eventually abs(modbus.pressure_a.pressure_scaled - axis1.P_A) > 0.004 bar",
    )
    assert outcomes(load(text + expect(*wanted))) == [PASSED] * 4


def test_what_is_no_number_is_unknown(load):
    """-32768 stands for it in an int16, which is no pressure of -327.68 bar."""
    text = step(0.1, 'fault = "break_wire"\ntarget = "pressure_a"')
    wanted = (
        "always modbus.pressure_a.pressure > 0 bar",
        "always modbus.pressure_a.pressure_scaled > 0 bar",
        "eventually modbus.pressure_a.valid == 0",
    )
    assert outcomes(load(text + expect(*wanted))) == [INCONCLUSIVE, INCONCLUSIVE, PASSED]


@pytest.mark.parametrize(
    "value",
    ['"modbus.valve.spool_setpoint" = 0.4', '"modbus.valve.spool_setpoint_scaled" = "40 %"'],
)
def test_a_step_moves_the_spool(load, value):
    """No controller, and all nodes PRE-OPERATIONAL: Modbus has control whatever NMT says."""
    text = step(0.05, f"set = {{ {TAKE_CONTROL}, {value} }}")
    wanted = (
        "always from 0 s to 49 ms abs(axis1.spool_position) < 0.001",
        "eventually from 50 ms to 50 ms modbus.valve.active == 1",
        "always from 0 s to 49 ms modbus.valve.active == 0",
        "always from 150 ms to 200 ms abs(axis1.spool_position - 0.4) < 0.01",
        'always valve.nmt == "PRE_OPERATIONAL"',
    )
    assert outcomes(load(text + expect(*wanted))) == [PASSED] * 5


def test_a_ramp_of_a_register_is_straight(load):
    """From 0 to 0.8 in 80 ms: a quarter after 20 ms, and so on; float32 has 2^-24 of error."""
    text = step(0.05, f"set = {{ {TAKE_CONTROL} }}")
    text += step(0.1, 'set = { "modbus.valve.spool_setpoint" = 0.8 }\nover_s = 0.08')
    wanted = [
        f"eventually from {at} ms to {at} ms abs(modbus.valve.spool_setpoint - {value}) < 0.0001"
        for at, value in ((99, 0), (120, 0.2), (140, 0.4), (180, 0.8), (200, 0.8))
    ]
    assert outcomes(load(text + expect(*wanted))) == [PASSED] * 5


def test_a_ramp_of_a_register_begins_at_the_value_that_it_has(load):
    """From 0.8 to 0.4 in 80 ms: 0.7 after 20 ms, 0.6 after 40 ms."""
    scaled = '"modbus.valve.spool_setpoint_scaled" = "80 %"'  # another register of this object
    text = step(0.05, f"set = {{ {TAKE_CONTROL}, {scaled} }}")
    text += step(0.1, 'set = { "modbus.valve.spool_setpoint" = 0.4 }\nover_s = 0.08')
    wanted = [
        f"eventually from {at} ms to {at} ms abs(modbus.valve.spool_setpoint - {value}) < 0.0001"
        for at, value in ((99, 0.8), (120, 0.7), (140, 0.6), (180, 0.4))
    ]
    assert outcomes(load(text + expect(*wanted))) == [PASSED] * 4


def test_who_has_no_control_is_refused(load):
    """CiA 408: the valve takes local commands only while 0x604F is 1."""
    text = step(0.05, 'set = { "modbus.valve.spool_setpoint" = 0.4 }')
    with pytest.raises(ConfigError) as caught:
        play(prepare(load(text + ANY)))
    assert str(caught.value).startswith(
        "modbus.valve.spool_setpoint: valve refuses 0.4: SDO abort 0x08000022:"
    )


@from_text("assigned", "bench", "wrong")
def test_a_step_that_no_client_could_do_is_refused(load, assigned, bench, wrong):
    text = step(0.05, f"set = {{ {assigned} }}")
    assert problem(load(text + ANY, bench)) == f"6:7: step[1].set: {wrong}"


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("modbus.pressure_a.pressure_p", f"{NEAREST} modbus.pressure_a.pressure_pa"),
        ("modbus.valve.control", SHARED),
    ],
)
def test_an_unknown_register_is_no_signal(load, name, wrong):
    assert problem(load(expect(f"always {name} > 0"))).endswith(f'R0: "{name}" {wrong}')


def test_the_example_of_the_document_plays(load):
    """On the bench that lets Modbus clients command its valve."""
    (block,) = [text for text in DOCUMENT.split("```") if '"modbus.valve.coils.control"' in text]
    _, assigned, wanted, _ = block.split("\n")
    text = f"[[step]]\nat_s = 0.05\n{assigned}\n[[expect]]\nid = 'R'\n{wanted}\n"
    assert outcomes(load(text, (ROOT / "examples/modbus.toml").read_text())) == [PASSED]


def test_a_machine_has_no_registers(load):
    """Neither as targets nor as signals, and both are named in one go."""
    text = step(0.05, 'set = { "modbus.valve.spool_setpoint" = 0.4 }')
    scenario = load(text + expect("always modbus.pressure_a.pressure > 0 bar"))
    with pytest.raises(ConfigError) as caught:
        prepare_for_machine(
            scenario, {}, tick_ns=1_000_000, valve="valve", channels=[Channel("axis1.P_A", "Pa")]
        )
    first, second = str(caught.value).splitlines()
    assert "modbus.valve.spool_setpoint cannot be set on a machine" in first
    assert '"modbus.pressure_a.pressure" is no signal here' in second


def test_a_client_reads_a_value_in_counts():
    """5154640 Pa are 5154.64 counts of 0.01 bar: 5155, which are 5155000 Pa."""
    places = {"name": "p", "table": Table.INPUT_REGISTERS, "address": 0, "source": "pressure"}
    register = Register(**places, data_type=DATA_TYPES["int16"], unit=BAR, scale=0.01)
    assert register.as_read(5154640.0) == pytest.approx(5155000.0)


def test_a_row_observer_sees_what_clients_read_of_the_tick(load_bench):
    """The number of the tick among it, from 1, which all values of the tick have in common."""
    seen = []
    with VirtualBench(load_bench(COMMANDS)) as bench:
        modbus = bench.session.bench.find(ModbusBinding)
        registers = name_registers(modbus)
        place = list(registers).index("modbus.valve.sample")
        entries = [each.entry for each in registers.values()]
        bench.session.watch(rows=lambda _: seen.append([entry.read() for entry in entries]))
        for number in (1, 2, 3):
            bench.run(bench.config.tick_ns * 1e-9)
            assert list(modbus.plan.rows.read().values) == seen[-1]
            assert (len(seen), seen[-1][place]) == (number, number)
