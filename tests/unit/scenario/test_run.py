"""Runs of scenarios: steps act at their ticks, in the way that a controller or a fault does."""

import json
from pathlib import Path

import pytest
from support.tables import from_text

from hil_bench.abilities.scenario import stage
from hil_bench.abilities.scenario.judgement import RequirementOutcome
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.run import PlayOptions, play, prepare, prepare_on
from hil_bench.errors import ConfigError, ControllerError

HEAD = 'title = "T"\nduration_s = 0.2\n'
EXAMPLE = '[controller]\nexample = "manual"\n'
PASSED, FAILED = RequirementOutcome.PASSED, RequirementOutcome.FAILED


def step(at, what):
    return f"[[step]]\nat_s = {at}\n{what}\n"


def expect(*texts):
    return "".join(f"[[expect]]\nid = \"R{k}\"\nthat = '{that}'\n" for k, that in enumerate(texts))


def load(tmp_path, text):
    path = tmp_path / "a.scenario.toml"
    path.write_text(text)
    return load_scenario(path)


def run(tmp_path, text, **options):
    return play(prepare(load(tmp_path, text)), PlayOptions(**options))


def outcomes(found):
    return [finding.judgement.outcome for finding in found.findings]


def problems(tmp_path, text):
    with pytest.raises(ConfigError) as caught:
        prepare(load(tmp_path, text))
    return str(caught.value).replace(f"{tmp_path}/", "").splitlines()


def test_a_load_acts_at_its_tick(tmp_path):
    """20 kN on 20 kg are 1 m/s after a tick (Newton), less the oil; without it the piston rests."""
    text = HEAD + step(0.1, 'set = { "axis1.load" = "20 kN" }')
    before = "always from 0 s to 99 ms abs(axis1.speed) < 1 mm/s"
    after = "eventually from 100 ms to 100 ms abs(axis1.speed) > 10 mm/s"
    assert outcomes(run(tmp_path, text + expect(before, after))) == [PASSED, PASSED]


def test_nmt_commands_and_objects_act_at_their_ticks(tmp_path):
    text = HEAD + step(0.05, 'nmt = "start"\ntarget = "valve"')
    text += step(0.1, 'set = { "valve.0x1017" = 20 }')
    wanted = (
        'always from 0 s to 49 ms valve.nmt == "PRE_OPERATIONAL"',
        'always from 50 ms to 200 ms valve.nmt == "OPERATIONAL"',
        'always pressure_a.nmt == "PRE_OPERATIONAL"',
        "always from 100 ms to 200 ms valve.0x1017.00 == 20",
        "eventually from 0 s to 99 ms valve.0x1017.00 == 20",
        "frame(0x000) for the last 1 ms or eventually from 50 ms to 50 ms frame(0x000)",
        "always from 51 ms to 200 ms not frame(0x000)",
    )
    found = outcomes(run(tmp_path, text + expect(*wanted)))
    assert found == [PASSED] * 4 + [FAILED] + [PASSED] * 2


def test_a_set_point_goes_as_the_valves_rpdo(tmp_path):
    """0x201 is RPDO 1 of node 1 in the predefined connection set, 0x2000 half of 16384."""
    text = HEAD + EXAMPLE + step(0.15, 'set = { "valve.spool_setpoint" = 0.5 }')
    wanted = (
        "eventually from 150 ms to 150 ms (frame(0x201) and valve.0x6300.01 == 8192)",
        "always from 140 ms to 149 ms (valve.0x6300.01 == 0 and not frame(0x201))",
        "eventually axis1.spool_position > 0.49",
    )
    assert outcomes(run(tmp_path, text + expect(*wanted))) == [PASSED] * 3


def test_a_ramp_is_straight(tmp_path):
    """From 0 to 16384 in 40 ms: a quarter after 10 ms, and so on."""
    text = HEAD + EXAMPLE + step(0.15, 'set = { "valve.spool_setpoint" = 1.0 }\nover_s = 0.04')
    wanted = [
        f"eventually from {150 + after} ms to {150 + after} ms valve.0x6300.01 == {value}"
        for after, value in ((0, 0), (10, 4096), (20, 8192), (40, 16384), (50, 16384))
    ]
    assert outcomes(run(tmp_path, text + expect(*wanted))) == [PASSED] * 5


def test_a_ramp_of_the_supply_begins_at_its_pressure(tmp_path):
    """From 100 bar to 90, which a chamber at 46 does not notice; from 0 it ran empty."""
    text = HEAD.replace("0.2", "0.7") + '[controller]\nexample = "position_control"\n'
    text += step(0.5, 'set = { "axis1.supply_pressure" = "90 bar" }\nover_s = 0.2')
    assert outcomes(run(tmp_path, text + expect("always axis1.P_A > 30 bar"))) == [PASSED]


@pytest.mark.parametrize(
    ("target", "values", "is_said"),
    [
        ("axis1.load", ["0 N"], True),  # as where nothing acts
        ("axis1.load", ["1 kN"], False),
        ("axis1.load", ["0 N", "1 kN", "0 N"], False),
        ("axis1.supply_pressure", ["100 bar"], False),  # that of a pump varies
        ("valve.spool_setpoint", ["0 %", "0 %"], True),
        ("valve.spool_setpoint", ["0 %", "0.1 %"], False),
        ("valve.0x1029.01", [0], True),
        ("valve.0x1029.01", [1], False),
    ],
)
def test_a_step_that_finds_its_value_there_is_said(tmp_path, target, values, is_said):
    text = HEAD + EXAMPLE
    for number, value in enumerate(values):
        text += step(0.15 + number / 100, f'set = {{ "{target}" = {json.dumps(value)} }}')
    (finding,) = run(tmp_path, text + expect("always axis1.P_A < 90 bar")).findings
    assert finding.judgement.outcome is PASSED
    said = f"{target} was so already when a step set it"
    assert (finding.judgement.reason == said) == is_said


def test_sync_goes_on_and_off(tmp_path):
    text = HEAD + step(0.05, "sync = true") + step(0.1, "sync = false")
    wanted = (
        "always from 0 s to 49 ms not frame(0x080)",
        "always from 50 ms to 99 ms frame(0x080)",
        "always from 100 ms to 200 ms not frame(0x080)",
    )
    assert outcomes(run(tmp_path, text + expect(*wanted))) == [PASSED] * 3


def test_the_sync_of_a_controller_is_held_back(tmp_path):
    text = HEAD + EXAMPLE + step(0.15, "sync = false")
    wanted = (
        "eventually from 140 ms to 149 ms frame(0x080)",
        "always after 150 ms not frame(0x080)",
    )
    assert outcomes(run(tmp_path, text + expect(*wanted))) == [PASSED] * 2


def test_an_emergency_is_an_event_with_a_code(tmp_path):
    """A wire that reads nothing is an EMCY of the transducer (docs/faults.md), within a tick."""
    text = HEAD + step(0.1, 'fault = "break_wire"\ntarget = "pressure_a"')
    wanted = (
        "always from 0 s to 99 ms not emcy(pressure_a)",
        "eventually from 100 ms to 101 ms emcy(pressure_a)",
        "always not emcy(pressure_b)",
        "always not emcy(pressure_a, 0x1234)",
    )
    assert outcomes(run(tmp_path, text + expect(*wanted))) == [PASSED] * 4


def test_the_lowest_node_id_has_emergencies_too(tmp_path):
    """0x081 is the first identifier of an EMCY (CiA 301, 7.3.3)."""
    sensor = '[nodes.pressure_a]\nprofile = "pressure_404"\nnode_id = 1\nsource = "P_A"\n'
    sensor += '[nodes.valve]\nprofile = "valve_408"\nnode_id = 2\n'
    (tmp_path / "bench.toml").write_text(f"[plant.axis1]\n{sensor}")
    text = HEAD + 'bench = "bench.toml"\n'
    text += step(0.1, 'fault = "break_wire"\ntarget = "pressure_a"')
    wanted = "eventually from 100 ms to 101 ms emcy(pressure_a)"
    assert outcomes(run(tmp_path, text + expect(wanted))) == [PASSED]


def test_a_run_ends_at_the_first_failure_if_asked(tmp_path):
    text = HEAD + expect("always from 20 ms to 150 ms axis1.P_A < 0 bar")
    assert run(tmp_path, text).duration == pytest.approx(0.2)
    found = run(tmp_path, text, stops_at_failure=True)
    assert outcomes(found) == [FAILED]
    assert found.is_early
    assert found.duration < 0.15


def test_two_runs_are_the_same(tmp_path):
    text = HEAD + EXAMPLE + expect("eventually axis1.P_A > 51.7 bar", "always axis1.P_A < 60 bar")
    prepared = prepare(load(tmp_path, text))
    assert play(prepared) == play(prepared)


def test_steps_are_checked_against_the_bench(tmp_path):
    text = HEAD + step(0.1, 'fault = "freeze"\ntarget = "pressure_x"')
    text += step(0.1, 'set = { "valve.spool_setpont" = 0.4 }')
    text += step(0.1, 'nmt = "start"\ntarget = "vale"')
    text += step(0.1, 'set = { "valve.0x6300.01" = 70000 }')
    text += step(0.1, 'firmware = "kill"')
    text += expect("always axis1.P_a > 0 bar")
    found = problems(tmp_path, text)
    assert [line.split(" ")[0] for line in found] == [
        "a.scenario.toml:19:13:",
        "a.scenario.toml:5:10:",
        "a.scenario.toml:9:7:",
        "a.scenario.toml:12:8:",
        "a.scenario.toml:16:7:",
        "a.scenario.toml:22:16:",
    ]
    assert "the nearest is valve.spool_setpoint" in found[2]
    assert '"vale" is no node; the nearest is valve' in found[3]
    assert "70000 is out of range" in found[4]


@from_text("given", "said")
def test_a_unit_of_another_quantity_is_refused(tmp_path, given, said):
    text = HEAD + "[parameters]\nrise_mm = 5\n" + step(0.1, f"set = {{ {given} }}")
    (line,) = problems(tmp_path, text + expect("always axis1.position < rise_mm"))
    assert said in line


def test_a_course_with_a_parameter_of_another_quantity_is_refused(tmp_path):
    (tmp_path / "course.csv").write_text("0,0\n0.1,rise_mm\n")
    text = HEAD + "[parameters]\nrise_mm = 5\n"
    text += step(0.05, 'set = "axis1.load"\ntable = "course.csv"')
    (line,) = problems(tmp_path, text + expect("always axis1.P_A > 0 bar"))
    assert "axis1.load takes no value in mm" in line


def test_a_unit_of_the_same_quantity_is_converted(tmp_path):
    text = HEAD + EXAMPLE + "[parameters]\nopening_percent = 40\n"
    text += step(0.1, 'set = { "valve.spool_setpoint" = "opening_percent" }')
    text += step(0.1, 'set = { "axis1.supply_pressure" = "80 bar" }')
    # 40 % of 0x4000, rounded
    assert outcomes(run(tmp_path, text + expect("eventually valve.0x6300.01 == 6554"))) == [PASSED]


def test_an_unknown_example_is_refused(tmp_path):
    text = HEAD + '[controller]\nexample = "position"\n' + expect("always axis1.P_A > 0 bar")
    assert "the nearest is position_control" in problems(tmp_path, text)[0]


def test_a_parameter_that_does_nothing_is_refused(tmp_path):
    parameters = "[parameters]\npositon_gain = 10\nsag_bar = 1\nhigh_bar = 9\nat_s = 0.1\n"
    text = HEAD + EXAMPLE + parameters
    text += step(0.1, 'fault = "drop_supply"\ntarget = "axis1"\npressure_bar = "sag_bar"')
    text += step('"at_s"', 'set = { "axis1.load" = 1 }') + expect("always axis1.P_A < high_bar")
    (line,) = problems(tmp_path, text)
    assert line.endswith(
        "parameters.positon_gain: does nothing; the nearest of the controller's is position_gain"
    )


def test_a_parameter_that_does_nothing_is_refused_without_a_controller_too(tmp_path):
    text = HEAD + "[parameters]\nsag_bar = 1\n" + expect("always axis1.P_A < 9 bar")
    (line,) = problems(tmp_path, text)
    assert line.endswith("does nothing; name it in a step, an expectation or the firmware's words")


TWO_BUSES = Path(__file__).parents[3] / "examples" / "two_buses.toml"
VALVE_ALONE = '[plant.axis1]\n[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\naxis = "axis1"\n'


@pytest.mark.parametrize(
    ("bench", "wrong"),
    [
        (VALVE_ALONE, "plant.axis1: no node is its encoder_406; the controller needs one"),
        (TWO_BUSES.read_text(), "controller: the examples need all devices of the axis on the f"),
    ],
)
def test_a_controller_without_its_devices_is_no_run(tmp_path, bench, wrong):
    (tmp_path / "bench.toml").write_text(bench)
    text = 'bench = "bench.toml"\n' + HEAD + EXAMPLE + expect("always axis1.P_A > 0 bar")
    with pytest.raises(ControllerError, match=wrong):
        run(tmp_path, text)


def test_a_controller_that_cannot_begin_is_no_run(tmp_path):
    text = HEAD + EXAMPLE + step(0.001, 'fault = "silence"\ntarget = "valve"')
    with pytest.raises(ControllerError, match="the controller could not work: node 1"):
        run(tmp_path, text + expect("always axis1.P_A < 250 bar"))


@pytest.mark.parametrize(("at", "over"), [(0.01, 0.0), (0.01, 0.02), (0.01, 0.1), (0.1, 0.0)])
def test_a_set_point_that_the_example_overwrites_is_no_run(tmp_path, at, over):
    """It enables the valve, with set-point 0, after some 65 ms."""
    ramp = f'set = {{ "valve.spool_setpoint" = 0.5 }}\nover_s = {over}'
    text = HEAD + EXAMPLE + step(at, ramp) + expect("eventually axis1.spool_setpoint > 0.4")
    if at + over < 0.05:
        with pytest.raises(ConfigError, match=r"before the example has enabled the valve"):
            run(tmp_path, text)
    else:
        assert run(tmp_path, text).findings[0].judgement.outcome == "passed"


@pytest.mark.parametrize(
    ("that", "outcome"),
    [
        ("always pressure_a.measured < 250 bar", "inconclusive"),
        ("always pressure_a.0x6130.01 < 250", "inconclusive"),
        ('always pressure_a.nmt == "PRE_OPERATIONAL"', "inconclusive"),
        ('always valve.state != "HOLD"', "passed"),
        ('eventually after 0.16 s pressure_a.nmt == "PRE_OPERATIONAL"', "passed"),
    ],
)
def test_nothing_is_known_of_a_node_without_power(tmp_path, that, outcome):
    """The others go on, and the node itself with its boot-up at 0.15 s."""
    text = HEAD + step(0.05, 'fault = "reset"\ntarget = "pressure_a"\nfor_s = 0.1')
    (found,) = run(tmp_path, text + expect(that)).findings
    assert found.judgement.outcome == outcome
    if outcome == "inconclusive":
        assert found.judgement.coverage.unknown == pytest.approx(0.1)


LEVER = Path(__file__).parents[3] / "examples/j1939_lever.toml"


@pytest.mark.parametrize("that", ["always joystick.x < 200 %", "always not dm1(joystick)"])
def test_nothing_is_known_of_a_j1939_device_without_power(tmp_path, that):
    head = HEAD + f'bench = "{LEVER}"\n'
    text = head + step(0.05, 'fault = "reset"\ntarget = "joystick"\nfor_s = 0.1')
    (found,) = run(tmp_path, text + expect(that)).findings
    assert found.judgement.coverage.unknown == pytest.approx(0.1)


def test_a_controller_that_ends_leaves_the_rest_of_the_run(tmp_path):
    text = HEAD + EXAMPLE + step(0.15, 'fault = "silence"\ntarget = "valve"')
    text = text.replace("manual", "position_control") + expect("always axis1.P_A < 250 bar")
    found = run(tmp_path, text.replace("0.2", "4"))  # its drivers give a request up after 0.5 s
    assert found.ending.startswith("the controller ended: node 1: ")
    assert found.duration == pytest.approx(4.0)
    assert not found.is_early


SECOND = 'bench = "{}"\n'.format(Path(__file__).parents[3] / "examples/two_axes.toml")


def test_a_set_point_of_a_valve_that_nobody_enables_is_refused(tmp_path):
    text = HEAD + SECOND + EXAMPLE + step(0.1, 'set = { "press_valve.spool_setpoint" = 0.5 }')
    (problem,) = problems(tmp_path, text + expect("always press.position < 1 m"))
    assert "press_valve is not enabled: the example sets up feed only" in problem


REST = "always axis1.position < 1 m"
FREEZE = step(0.1, 'fault = "freeze"\ntarget = "pressure_a"')


@pytest.mark.parametrize("controller", ["", EXAMPLE])
def test_a_fault_of_a_sensor_that_nothing_reads_is_refused(tmp_path, controller):
    (problem,) = problems(tmp_path, HEAD + controller + FREEZE + expect(REST))
    assert "nothing reads pressure_a, so the fault changes nothing" in problem


@pytest.mark.parametrize(
    ("controller", "that"),
    [
        ("", "always pressure_a.measured < 250 bar"),
        ("", "always frame(0x81) implies axis1.P_A > 0"),
        (EXAMPLE.replace("manual", "position_control"), REST),
        ('[controller]\nfirmware = ["true"]\n', REST),
    ],
)
def test_a_fault_of_a_sensor_that_somebody_reads_is_right(tmp_path, controller, that):
    prepare(load(tmp_path, HEAD + controller + FREEZE + expect(that)))


def test_on_a_bus_somebody_else_may_enable_and_read(tmp_path):
    scenario = load(tmp_path, HEAD + FREEZE + expect(REST))
    config = prepare(load(tmp_path, HEAD + expect(REST))).config
    assert prepare_on(config, scenario, {}, drives_itself=False).actions


def test_a_fault_of_a_valve_that_nobody_enables_is_refused(tmp_path):
    stick = step(0.1, 'fault = "stick"\ntarget = "valve"')
    (problem,) = problems(tmp_path, HEAD + stick + expect(REST))
    assert "valve is not enabled: no step enables it" in problem
    prepare(load(tmp_path, HEAD + EXAMPLE + stick + expect(REST)))


@pytest.mark.parametrize(
    ("keys", "wrong"),
    [
        ("offset_bar = 0", "offset_bar: 0 changes nothing; give another amount"),
        ("offset_bar = 5\nfor_s = 0", "for_s: 0 is no time; give how long the fault lasts"),
    ],
)
def test_a_fault_of_no_size_or_time_is_refused(tmp_path, keys, wrong):
    text = HEAD + step(0.1, f'fault = "offset"\ntarget = "pressure_a"\n{keys}')
    (problem,) = problems(tmp_path, text + expect("always pressure_a.measured < 250 bar"))
    assert wrong in problem


def test_a_parameter_may_make_a_fault_nothing(tmp_path):
    """A range from 0 on is the case without the fault, for comparison."""
    text = HEAD + "[parameters]\nshift_bar = { value = 0, range = [0, 5] }\n"
    text += step(0.1, 'fault = "offset"\ntarget = "pressure_a"\noffset_bar = "shift_bar"')
    prepare(load(tmp_path, text + expect("always pressure_a.measured < 250 bar")))


def test_a_sync_that_is_on_already_is_refused(tmp_path):
    text = HEAD + EXAMPLE + step(0.1, "sync = true") + expect("always axis1.position < 1 m")
    (problem,) = problems(tmp_path, text)
    assert "SYNC is on already" in problem


def test_a_value_moves_in_straight_lines_and_leaps_where_two_points_are_of_one_tick():
    move = stage.Move(None, ((1, 0.0), (3, 2.0), (3, 5.0), (5, 9.0)))
    assert [move.at(tick) for tick in range(1, 8)] == [0.0, 1.0, 5.0, 7.0, 9.0, 9.0, 9.0]
