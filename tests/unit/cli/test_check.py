import json
import tomllib
from pathlib import Path

import pytest

from device_profiles import VALVE_408
from hil_bench.abilities.faults.section import FaultsPart
from hil_bench.bench.configuration import load_config
from hil_bench.cli import main


def test_each_value_is_shown_with_its_origin(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HIL_BENCH_SEED", "7")
    Path("bench.toml").write_text("[plant.axis1]\nstroke_mm = 300\n")

    assert main(["check", "bench.toml", "-c", "vcan0", "--bus-kwargs", "port=5"]) == 0

    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert lines[:21] == [
        "# bench.toml",
        "",
        "[bench]",
        "tick_us = 1000 # default",
        "step_us = 50 # default",
        "sync_period_us = 1000 # default",
        "seed = 7 # environment",
        'realtime = "off" # default',
        "realtime_priority = 80 # default",
        "# realtime_cpu = # none",
        "realtime_spin_us = 0 # default",
        'overrun = "count" # default',
        "",
        "[bus]",
        "# interface = # left to python-can",
        'channel = "vcan0" # command line',
        "# bitrate = # left to python-can",
        "fd = false # default",
        "# data_bitrate = # none",
        "port = 5 # command line",
        "",
    ]
    assert "stroke_mm = 300.0 # file" in lines
    assert "moving_mass_kg = 20.0 # default" in lines
    # 20 kg by Table I of the paper
    assert lines.count("# What axis1 can do:") == 1
    assert "# moving mass 20 kg" in lines[lines.index("# What axis1 can do:") :]


@pytest.mark.parametrize(
    "example", ["one_axis.toml", "two_axes.toml", "real_sensors.toml", "faults.toml"]
)
def test_what_check_prints_is_the_same_bench(make_file, cli, example):
    original = Path(__file__).parents[3] / "examples" / example
    printed = make_file("printed.toml", cli(["check", str(original)]).out)
    first, second = load_config(original), load_config(printed)

    assert (first.axes, first.nodes, first.bus) == (second.axes, second.nodes, second.bus)
    assert first.of(FaultsPart) == second.of(FaultsPart)
    assert (first.tick_ns, first.step_ns, first.seed) == (
        second.tick_ns,
        second.step_ns,
        second.seed,
    )


def test_json_is_for_programs(cli):
    found = json.loads(cli("check --json --seed 3").out)
    assert found["path"] is None
    settings = {(s["table"], s["key"]): s for s in found["settings"]}
    assert settings["bench", "seed"] == {
        "table": "bench",
        "key": "seed",
        "value": 3,
        "unit": "-",
        "origin": "command line",
    }
    assert settings["plant.axis1", "supply_pressure_bar"]["unit"] == "bar"
    assert settings["bus", "interface"]["value"] is None


def test_a_wrong_configuration_is_exit_code_2(tmp_path, monkeypatch, cli):
    monkeypatch.chdir(tmp_path)
    Path("bench.toml").write_text("[bench]\ntick = 1\nseed = -1\n")

    found = cli("check bench.toml", 2)
    assert found.out == ""
    assert found.err.splitlines() == [
        "hil-bench: error: bench.toml:bench.tick: unknown key; the nearest known key is tick_us",
        "hil-bench: error: bench.toml:bench.seed: -1 is out of range; give an integer from 0 up",
    ]


def test_a_broken_eds_is_found(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("broken.eds").write_text("[FileInfo]\n")
    node = 'profile = "{}"\nnode_id = {}\neds = "broken.eds"\n'
    Path("bench.toml").write_text(
        "[nodes.v]\n" + node.format("valve_408", 1) + "[nodes.e]\n" + node.format("encoder_406", 2)
    )

    assert main(["check", "bench.toml"]) == 2

    # Two nodes with one file have one problem.
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("hil-bench: error: broken.eds: is no EDS file, it has no object such as")


LOAD = """
[nodes]
valve = { profile = "valve_408", node_id = 1 }
one = { node_id = 20, eds = "vendor.eds" }
other = { node_id = 21, eds = "vendor.eds" }
"""


@pytest.mark.parametrize("command", [["check"], ["devices"], ["run", "--duration", "0.01"]])
def test_a_deviation_of_an_eds_is_told_once(tmp_path, monkeypatch, cli, command):
    monkeypatch.chdir(tmp_path)
    text = VALVE_408.read_text(encoding="ascii")
    changed = text.replace("$NODEID+0x200", "0x601").replace("AccessType=const", "AccessType=co", 1)
    Path("vendor.eds").write_text(changed, encoding="ascii")
    Path("bench.toml").write_text(LOAD)
    verb, *options = command
    hub = ["--hub", "0"] if verb == "run" else []

    code = 1 if verb == "check" else 0
    lines = cli([verb, "bench.toml", *hub, *options], code).err.splitlines()
    warnings = [line for line in lines if line.startswith("hil-bench: vendor.eds:")]
    first, second = warnings
    # What does not work comes first.
    assert "error: [1400sub1] DefaultValue: is 0x601, which no PDO may have; RPDO1 is off" in first
    assert "warning: [1008] AccessType: is 'co'; one of ro" in second
    assert "vendor.eds" not in cli("check bench.toml --quiet", 1).err


NO_OBJECT = (
    "\n1=0x1003\n",
    "\n1=0x1999\n",
    "0x1999 has no section [1999]; the device does not have",
)
NO_COB_ID = ("$NODEID+0x200", "0x601", "DefaultValue: is 0x601, which no PDO may have")
"""Changes of our valve's EDS: an object that is listed only, a PDO with an SDO's COB-ID."""


@pytest.mark.parametrize("change", [NO_OBJECT, NO_COB_ID], ids=["listed object", "PDO"])
@pytest.mark.parametrize("options", ["", "--json", "--bus --virtual"])
def test_an_eds_with_an_error_does_not_pass(tmp_path, monkeypatch, cli, change, options):
    monkeypatch.chdir(tmp_path)
    before, after, said = change
    text = VALVE_408.read_text(encoding="ascii")
    assert before in text
    Path("vendor.eds").write_text(text.replace(before, after), encoding="ascii")
    Path("bench.toml").write_text(LOAD)

    found = cli(f"check bench.toml {options}", 1)
    assert said in found.err
    assert cli("check-eds vendor.eds", 1).out.count("error: ") == found.err.count("error: ")
    if options == "--json":
        (finding, *_) = json.loads(found.out)["eds"]["vendor.eds"]
        assert finding["severity"] == "error"
        assert said in f"[{finding['section']}] {finding['text']}"


def test_many_deviations_of_an_eds_are_counted(tmp_path, monkeypatch, cli):
    monkeypatch.chdir(tmp_path)
    text = VALVE_408.read_text(encoding="ascii")
    number = text.count("AccessType=const")
    assert number > 11
    changed = text.replace("AccessType=const", "AccessType=co")
    Path("vendor.eds").write_text(changed, encoding="ascii")
    Path("bench.toml").write_text(LOAD)

    lines = cli("check bench.toml").err.splitlines()
    assert len(lines) == 11
    assert lines[-1] == (
        f"hil-bench: vendor.eds: and {number - 10} more; hil-bench check-eds vendor.eds shows all"
    )


def test_a_bus_of_can_fd_is_given_by_the_options_of_python_can(cli):
    shown = cli("check -b 500000 --fd --data-bitrate=2000000").out
    bus = tomllib.loads(shown)["bus"]
    assert (bus["bitrate"], bus["fd"], bus["data_bitrate"]) == (500_000, True, 2_000_000)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            ["--data-bitrate=2000000"],
            "error: --data-bitrate: the bus is classical, and has one bit rate; give --fd",
        ),
        (["--fd", "--data-bitrate=900000"], "900000 is less than the bit rate; give 1000000 or"),
        (["--timing", "f_clock=8000000"], "--timing: bit timing is the adapter's; give -b or"),
    ],
)
def test_what_no_bus_can_be_is_refused_in_a_line(options, said, cli):
    err = cli(["check", *options], 2).err
    assert said in err
    assert err.count("\n") == 1


NONSENSE = "[plant.axis1]\nsupply_pressure_bar = 21000000\n"
DOUBT = "plant.axis1.supply_pressure_bar: 21000000 is 2.1 TPa; "


def test_what_is_hard_to_believe_is_a_warning_on_standard_error(make_file, cli):
    path = make_file("bench.toml", NONSENSE)
    out, err = cli(["check", str(path)])
    assert err.startswith(f"hil-bench: warning: {path}:{DOUBT}")
    assert tomllib.loads(out)["plant"]["axis1"]["supply_pressure_bar"] == 21_000_000
    warning, *results = json.loads(cli(["check", str(path), "--json"]).out)["warnings"]
    assert warning.startswith(f"{path}:{DOUBT}")
    assert "top speed extending is" in results[0]
    assert cli(["check", str(path), "-q"]).err == ""
