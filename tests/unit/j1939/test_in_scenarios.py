"""J1939 devices in scenarios: what steps set and break, and what expectations read of them."""

from pathlib import Path

import pytest
from support.tables import from_text

from hil_bench.abilities.scenario.judgement import RequirementOutcome
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.run import play, prepare
from hil_bench.errors import ConfigError

EXAMPLES = Path(__file__).parents[3] / "examples"
BENCH = EXAMPLES / "j1939_lever.toml"
HEAD = f'title = "T"\nbench = "{BENCH}"\nduration_s = 0.6\n'
PASSED, FAILED = RequirementOutcome.PASSED, RequirementOutcome.FAILED


def step(at, what):
    return f"[[step]]\nat_s = {at}\n{what}\n"


def prepared(tmp_path, steps, *texts):
    path = tmp_path / "a.scenario.toml"
    wanted = "".join(
        f"[[expect]]\nid = \"R{k}\"\nthat = '{that}'\n" for k, that in enumerate(texts)
    )
    path.write_text(
        HEAD + steps + (wanted or '[[expect]]\nid = "R"\nthat = "always axis1.P_A > 0 bar"\n')
    )
    return prepare(load_scenario(path))


def outcomes(tmp_path, steps, *texts):
    findings = play(prepared(tmp_path, steps, *texts)).findings
    return [finding.judgement.outcome for finding in findings]


def test_a_lever_is_moved_along_a_ramp(tmp_path):
    found = outcomes(
        tmp_path,
        step(0.1, 'set = { "joystick.x" = "-40 %" }\nover_s = 0.2'),
        # Half of the ramp is over at 0.2 s; the table has 0.1 % a bit.
        "eventually from 200 ms to 200 ms settled(joystick.x + 20 %, 0.1 %, 0 ms)",
        "always after 301 ms joystick.x == -40 % and joystick.x.measured == joystick.x",
        "always after 301 ms joystick.x_left == 1 and joystick.x_right == 0",
        "always joystick.x == 0 %",
    )
    assert found == [PASSED, PASSED, PASSED, FAILED]


def test_a_valve_driver_is_commanded_as_by_a_controller_that_repeats(tmp_path):
    # Its time-out is 300 ms: one command alone would be over at 0.4 s.
    found = outcomes(
        tmp_path,
        step(0.1, 'set = { "valve.spool_setpoint" = 0.3 }'),
        "always from 101 ms to 600 ms axis1.spool_setpoint == 30 %",
        "always from 250 ms to 600 ms abs(valve.flow - 30 %) < 2 %",
        "always not dm1(valve)",
    )
    assert found == [PASSED] * 3


def test_a_valve_driver_that_is_off_the_bus_centres_its_spool(tmp_path):
    steps = step(0.1, 'set = { "valve.spool_setpoint" = 0.3 }')
    steps += step(0.15, 'fault = "silence"\ntarget = "valve"')
    found = outcomes(
        tmp_path,
        steps,
        # The last command came at 0.1 s, and 300 ms later it is too old; the DM1 takes a tick.
        "always from 101 ms to 399 ms axis1.spool_setpoint == 30 %",
        "always from 400 ms to 600 ms axis1.spool_setpoint == 0",
        "always from 401 ms to 600 ms dm1(valve, 1907, 9)",
        "eventually dm1(valve, 1907, 2)",
    )
    assert found == [PASSED, PASSED, PASSED, FAILED]


def test_trouble_codes_and_the_address_claim_are_read(tmp_path):
    steps = step(0.2, 'fault = "report"\ntarget = "joystick"\nspn = 100\nfmi = 3')
    steps += step(0.3, 'fault = "reset"\ntarget = "valve"\nfor_s = 0.1')
    found = outcomes(
        tmp_path,
        steps,
        "always from 0 s to 199 ms not dm1(joystick)",
        "always after 200 ms dm1(joystick, 100) and dm1(joystick, 100, 3)",
        'always from 300 ms to 399 ms valve.state == "off" and valve.address == 254',
        'always after 400 ms valve.state == "claimed" and valve.address == 10',
    )
    assert found == [PASSED] * 4


def test_an_offset_of_the_lever_is_given_in_percent(tmp_path):
    steps = step(0.2, 'fault = "offset"\ntarget = "joystick.x"\noffset_percent = 5')
    steps += step(0.4, 'fault = "offset"\ntarget = "valve.flow"\noffset_percent = -10')
    found = outcomes(
        tmp_path,
        steps,
        "always from 200 ms to 600 ms joystick.x == 5 %",
        "always from 400 ms to 600 ms abs(valve.flow + 10 %) < 1 %",
    )
    assert found == [PASSED] * 2


@from_text("what", "message")
def test_a_step_that_cannot_act_is_one_line(tmp_path, what, message):
    with pytest.raises(ConfigError) as caught:
        prepared(tmp_path, step(0.1, what))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_signal_takes_values_of_its_own_quantity(tmp_path):
    """1 MPa is 10 bar, and kN is no pressure."""
    bench = tmp_path / "bench.toml"
    signal = 'pgn = 0xFF10, start_bit = 0, length = 16, resolution = 0.1, unit = "bar"'
    gauge = f"\n[j1939.gauge]\naddress = 20\n[j1939.gauge.signals]\np = {{ {signal} }}\n"
    bench.write_text(BENCH.read_text() + gauge)

    def played(value):
        text = HEAD.replace(str(BENCH), str(bench)) + step(
            0.1, f'set = {{ "gauge.p" = "{value}" }}'
        )
        path = tmp_path / "a.scenario.toml"
        path.write_text(f'{text}[[expect]]\nid = "R"\nthat = "eventually gauge.p == 10 bar"\n')
        return play(prepare(load_scenario(path)))

    (finding,) = played("1 MPa").findings
    assert finding.judgement.outcome is PASSED
    with pytest.raises(ConfigError, match=r"gauge.p takes no value in kN; give one in bar"):
        played("1 kN")


@from_text("that", "message")
def test_an_expectation_that_cannot_be_judged_is_one_line(tmp_path, that, message):
    with pytest.raises(ConfigError) as caught:
        prepared(tmp_path, "", that)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_example_passes():
    run = play(prepare(load_scenario(EXAMPLES / "scenarios" / "broken_lever.scenario.toml")))

    assert [each.judgement.outcome for each in run.findings] == [PASSED] * 3
