"""Every kind of fault as a step: it begins at the step's tick, and ends after its time."""

import json
from types import SimpleNamespace

import pytest
from support.built_in_nodes import NODES
from support.tables import from_text

from hil_bench import ConfigError, RecordingWish, VirtualBench
from hil_bench.abilities.faults.registry import FAULT_KINDS
from hil_bench.abilities.scenario import run
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.results import play_for_result
from hil_bench.abilities.scenario.targets import Targets
from hil_bench.cli.exit_codes import ExitCode

KEYS = {
    "freeze": 'target = "position"',
    "offset": 'target = "pressure_a"\noffset_bar = 5',
    "drift": 'target = "position"\ndrift_mm_s = 1',
    "noise": 'target = "position"\nnoise_mm = 1',
    "break_wire": 'target = "pressure_a"\nreads = "low"',
    "slow": 'target = "valve"\ntime_constant_ms = 5',
    "stick": 'target = "valve"',
    "invert": 'target = "valve"',
    "disable": 'target = "valve"',
    "drop_supply": 'target = "axis1"\npressure_bar = "sag_bar"',
    "leak": 'target = "axis1"\nleak_l_min_bar = 0.1\npath = "b"\ngrowth_s = 0.005',
    "aerate": 'target = "axis1"\nair_percent = 2',
    "wear_spool": 'target = "axis1"\nopening_um = 30\ngrowth_s = 0.01',
    "jam": 'target = "axis1"\nforce_n = 1000',
    "drop_load": 'target = "axis1"',
    "wear_pump": 'target = "axis1"\nloss_percent = 40',
    "sag_relief": 'target = "axis1"\nsag_bar = 10',
    "lose_gas": 'target = "axis1"',
    "clog_filter": 'target = "axis1"\nblocked_percent = 90\ngrowth_s = 0.005',
    "bind": 'target = "valve"\nband_percent = 3',
    "weaken": 'target = "valve"\ntravel_percent = 50',
    "silence": 'target = "valve"',
    "reset": 'target = "valve"',
    "lose": 'target = "valve"\nshare_percent = 10\ndirection = "sent"\ncan_id = 0x181',
    "delay": 'target = "valve"\ndelay_ms = 3',
    "truncate": 'target = "valve"\nlength = 2',
    "corrupt": 'target = "valve"\nshare_percent = 10',
    "repeat": 'target = "valve"\ncan_id = 0x181',
    "babble": 'target = "valve"\nframes_per_tick = 2',
    "bit_error": 'target = "valve"\nshare_percent = 10',
    "bus_off": 'target = "valve"',
    "stuck_dominant": 'target = "valve"',
    "no_acknowledge": 'target = "valve"',
    "indicate": 'target = "lever.x"',
    "report": 'target = "lever"\nspn = 2660\nfmi = 2',
    "readdress": 'target = "lever"\naddress = 200',
}
"""The keys of each kind, as docs/faults.md has them."""

BENCH = f"""
[bus.wire]
[plant.axis1]
load_n = 1000
supply = "unit"
filter_rated_flow_l_min = 60
filter_rated_drop_bar = 0.5
{NODES}[j1939.lever]
address = 19
[j1939.lever.signals]
x = {{ pgn = 0xFDD6, start_bit = 6, length = 10, resolution = 0.1, unit = "%" }}
"""
"""An axis that can have each of them."""

SCENARIO = """
title = "T"
bench = "bench.toml"
duration_s = 0.05
[parameters]
sag_bar = 40
[[step]]
at_s = 0.02
fault = "{kind}"
for_s = 0.01
{keys}
[[step]]
at_s = 0.0
set = {{ "valve.0x6040" = 1 }}
[[step]]
at_s = 0.025
nmt = "start"
target = "all"
[[expect]]
id = "R"
that = "always axis1.P_A < sag_bar + 200 bar"
[[expect]]
id = "S"
that = 'eventually (pressure_a.nmt == "PRE_OPERATIONAL" and position.nmt == "PRE_OPERATIONAL")'
"""
"""The valve and both sensors concern somebody, so that no fault is idle."""


@pytest.fixture
def benches(monkeypatch):
    """The benches that runs have made."""
    made = []

    class KeptBench(VirtualBench):
        def __init__(self, *args, **options):
            super().__init__(*args, **options)
            made.append(self)

    monkeypatch.setattr(run, "VirtualBench", KeptBench)
    return made


def test_each_kind_is_tried():
    assert FAULT_KINDS.built_in.keys() == KEYS.keys()


@pytest.mark.parametrize("kind", KEYS)
def test_a_fault_begins_and_ends_at_its_ticks(tmp_path, make_file, benches, kind):
    (tmp_path / "bench.toml").write_text(BENCH)
    path = make_file("a.scenario.toml", SCENARIO.format(kind=kind, keys=KEYS[kind]))
    run.play(run.prepare(load_scenario(path)))
    (bench,) = benches
    found = [(event.time, event.kind, event.is_begin) for event in bench.faults.events]
    assert found == [(20_000_000, kind, True), (30_000_000, kind, False)]


@pytest.mark.parametrize(
    ("kind", "keys", "is_idle"),
    [
        ("silence", 'target = "valve"', False),
        ("lose", 'target = "valve"\ncan_id = 0x7FF', True),  # nobody sends it
        ("lose", 'target = "valve"\ncan_id = 0', False),
        ("bit_error", 'target = "valve"\ncan_id = 0x7FF', True),
        ("weaken", 'target = "valve"\ntravel_percent = 50', True),  # of a spool in its centre
        ("stick", 'target = "valve"', True),  # where it is, too
        ("offset", 'target = "position"\noffset_mm = 1', False),
        ("jam", 'target = "axis1"\nforce_n = 1', False),
    ],
)
def test_what_holds_beside_a_fault_that_changes_nothing_is_not_exercised(
    tmp_path, make_file, cli, kind, keys, is_idle
):
    """So it is where the recording is judged, if that carries its faults; S is no signal.

    Where it does not, that is said, also where the requirements alone are given.
    """
    (tmp_path / "bench.toml").write_text(BENCH)
    text = SCENARIO.format(kind=kind, keys=keys)
    if kind == "stick":  # to the end of the run
        text = text.replace("for_s = 0.01\n", "")
    path = make_file("a.scenario.toml", text)
    recordings = tmp_path / "a.mf4", tmp_path / "a.csv"
    options = run.PlayOptions(record=RecordingWish(recordings))
    result = play_for_result(run.prepare(load_scenario(path)), options)
    (first, _) = (finding.judgement for finding in result.findings)
    assert first.outcome == ("not exercised" if is_idle else "passed")
    target = keys.split('"')[1]
    said = f"the fault {kind} {target} has changed nothing"
    assert (first.reason == said) == is_idle
    signals = make_file("r.toml", text.partition('[[expect]]\nid = "S"')[0])
    unseen = f"the recording does not show the fault {kind} {target}"
    code = ExitCode.INCONCLUSIVE if is_idle else ExitCode.DONE
    for recording, ended, reason in zip(recordings, (code, 0), (first.reason, unseen), strict=True):
        found = cli(["judge", str(signals), str(recording), "--json"], ended).out
        assert json.loads(found)[str(recording)][0]["judgement"]["reason"] == reason
    limit = "always position.measured < 200 mm"
    alone = make_file("alone.toml", f"[[expect]]\nid = 'R'\nthat = '{limit}'\n")
    report = tmp_path / "report.html"
    words = ["judge", str(alone), str(recordings[1]), "--report", str(report)]
    said = "does not hold the faults of its run: whether one changed nothing is not known"
    assert said in cli(words).err
    assert said in report.read_text()
    assert "faults" not in cli(["judge", str(alone), str(recordings[0])], code).err


def test_a_parameter_that_leaves_the_machine_as_it_is_is_the_variant_without_the_fault(make_file):
    """As the first point of a range from 0, and what the others are compared with."""
    head = 'title = "T"\nduration_s = 0.03\n[parameters]\noff_mm = 0.0\n'
    step = '[[step]]\nat_s = 0.01\nfault = "offset"\ntarget = "position"\noffset_mm = "off_mm"\n'
    expect = '[[expect]]\nid = "R"\nthat = "always position.measured < 150 mm"\n'
    path = make_file("a.scenario.toml", head + step + expect)
    (finding,) = play_for_result(run.prepare(load_scenario(path))).findings
    assert finding.judgement.outcome == "passed"
    said = "the fault offset position has an amount that changes nothing"
    assert finding.judgement.reason == said


@from_text("kind", "keys", "wrong")
def test_a_fault_without_its_amount_is_refused_as_in_a_bench(
    tmp_path, make_file, kind, keys, wrong
):
    (tmp_path / "bench.toml").write_text(BENCH)
    path = make_file("a.scenario.toml", SCENARIO.format(kind=kind, keys=keys))
    with pytest.raises(ConfigError) as caught:
        run.prepare(load_scenario(path))
    assert wrong in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_bench_on_which_nothing_can_be_set_says_so():
    """As that of a plug-in's plant without influences, on generic nodes and without Modbus."""
    config = SimpleNamespace(nodes=(), ecus=())
    bench = SimpleNamespace(axes=(), nodes=(), find=lambda _kind: None)
    session = SimpleNamespace(bench=bench)
    with pytest.raises(ConfigError) as caught:
        Targets(config, session).find("rig.load")
    assert str(caught.value) == '"rig.load" is nothing to set here; objects are NODE.0x6300.01'
