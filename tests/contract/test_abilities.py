"""The contract between the core and its abilities: each says what it needs, and each can go."""

import importlib
import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from support.distribution import PLUGIN, declare

from hil_bench import ConfigError, VirtualBench, load_config
from hil_bench.ability import OWN, own_abilities
from hil_bench.cli import main
from hil_bench.cli.parser import own_verbs

ROOT = Path(__file__).resolve().parents[2]
ABILITIES = {ability.name: ability for ability in own_abilities()}
GOLDEN = {
    "analysis": "analysis",
    "commissioning": "commissioning",
    "demo": "demo",
    "demo_modbus": "demo",
    "faults": "faults",
    "lockstep_firmware": "lockstep",
    "modbus": "modbus",
    "shadow": "shadow",
}
"""The golden runs that an ability makes; the core makes the others."""
ON_FAULTY_BENCHES = {"commissioning", "shadow"}
"""Abilities whose golden runs have faults in the file of their bench."""


COMMON = "common"
"""The folder of what abilities have in common, which is no ability and needs none."""

OF_LIVE = {"attached", "ctl", "feed"}
"""Parts that the live view takes of other abilities, under names of its parts."""


def imported(ability):
    """Return the other abilities that the sources of one name, but for those given to others."""
    folder = ROOT / "hil_bench" / "abilities" / ability.name
    takers = {*OWN, *OF_LIVE}
    given = {f"{place.replace('.', '/')}.py" for to, place in ability.gives.items() if to in takers}
    own = (path for path in folder.rglob("*.py") if str(path.relative_to(ROOT)) not in given)
    sources = (path.read_text(encoding="utf-8") for path in own)
    found = {name for text in sources for name in re.findall(r"hil_bench\.abilities\.(\w+)", text)}
    return found - {ability.name, COMMON}


def gone_with(name):
    """Return an ability, and those that need it."""
    gone = {name}
    while more := {a.name for a in ABILITIES.values() if {*a.needs} & gone} - gone:
        gone |= more
    return gone


@pytest.fixture
def without(tmp_path):
    """Return a function that copies the packages without some abilities, and runs Python on it."""

    def run(gone, *arguments):
        package = tmp_path / "hil_bench"
        if not package.exists():
            (package / "abilities").mkdir(parents=True)
            for path in (ROOT / "hil_bench").iterdir():
                if path.name not in {"abilities", "ability.py", "__pycache__"}:
                    (package / path.name).symlink_to(path)
            for path in (ROOT / "hil_bench" / "abilities").iterdir():
                if path.name not in gone | {"__pycache__"}:
                    (package / "abilities" / path.name).symlink_to(path)
            text = (ROOT / "hil_bench" / "ability.py").read_text(encoding="utf-8")
            for name in gone:
                text, count = re.subn(rf'^    "{name}",\n', "", text, flags=re.MULTILINE)
                assert count == 1
            (package / "ability.py").write_text(text, encoding="utf-8")
        environment = os.environ | {"PYTHONPATH": str(tmp_path), "COLUMNS": "100"}
        return subprocess.run(  # noqa: S603 - our own program
            [sys.executable, "-P", *arguments],
            capture_output=True,
            text=True,
            check=False,
            cwd=ROOT,
            env=environment,
        )

    return run


def test_each_folder_of_an_ability_is_listed():
    folders = {path.parent.name for path in ROOT.glob("hil_bench/abilities/*/__init__.py")}
    assert {*OWN} == folders - {COMMON}
    assert [ability.name for ability in own_abilities()] == [*OWN]


@pytest.mark.parametrize("ability", ABILITIES.values(), ids=lambda ability: ability.name)
def test_an_ability_needs_what_it_imports(ability):
    assert {*ability.needs} == imported(ability)


def test_the_core_names_no_ability():
    """No import, no text: but for the list of them, which is the one line that goes with each."""
    named = re.compile(rf"abilities[./]({'|'.join(OWN)})\b")
    core = [
        path
        for path in (ROOT / "hil_bench").rglob("*.py")
        if "abilities" not in path.relative_to(ROOT / "hil_bench").parts
    ]
    found = [str(path) for path in core if named.search(path.read_text(encoding="utf-8"))]
    assert found == []


def test_what_abilities_have_in_common_needs_none():
    folder = ROOT / "hil_bench" / "abilities" / COMMON
    sources = [path.read_text(encoding="utf-8") for path in folder.rglob("*.py")]
    found = {name for text in sources for name in re.findall(r"hil_bench\.abilities\.(\w+)", text)}
    assert found <= {COMMON}


def test_a_public_name_of_the_core_imports_no_ability():
    program = (
        "import sys, hil_bench; hil_bench.ConfigError; "
        "print([name for name in sys.modules if name.startswith('hil_bench.abilities')]); "
        "print(hil_bench.run_campaign.__name__, 'run_campaign' in hil_bench.__all__)"
    )
    done = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout == "[]\nrun_campaign True\n"


BENCH = "examples/machines/crane.toml"
PROGRAM = f"""
import sys
from hil_bench.cli import main
print([int(main([*words])) for words in (["--help"], ["check", "{BENCH}"])])
print([int(main([verb])) for verb in sys.argv[1:]])
"""


def keys_of_nodes(gone):
    """Return the keys of the nodes' tables that go with some abilities."""
    places = [ABILITIES[name].gives.get("nodes") for name in gone]
    return [
        key.name for place in filter(None, places) for key in importlib.import_module(place).KEYS
    ]


@pytest.mark.long  # a process each, without what is imported already
@pytest.mark.parametrize("name", OWN)
def test_an_ability_can_go(name, without, cli):
    """Help has the other verbs, a bench is checked as ever, and a verb that is gone is unknown.

    Keys that it has in the nodes' tables are gone with it.
    """
    gone = gone_with(name)
    lost = {verb for other in gone for verb in ABILITIES[other].verbs}
    done = without(gone, "-c", PROGRAM, *lost)
    shown, _, checked = done.stdout.partition("[bench]")
    verbs = set(re.findall(r"^    ([a-z][a-z-]+) ", shown, re.MULTILINE))
    assert verbs & own_verbs().keys() == own_verbs().keys() - lost
    _, _, whole = cli(["check", BENCH]).out.partition("[bench]")
    for key in keys_of_nodes(gone):
        whole, count = re.subn(rf"^(# )?{key} .*\n", "", whole, flags=re.MULTILINE)
        assert count == len(re.findall(r"^profile = ", whole, re.MULTILINE))
    assert checked == f"{whole}[0, 0]\n{[2] * len(lost)}\n", done.stderr
    for verb in lost:
        assert f"'{verb}' is unknown" in done.stderr


def kept_with(name):
    """Return an ability, and those that it needs."""
    kept = {name}
    while more := {need for each in kept for need in ABILITIES[each].needs} - kept:
        kept |= more
    return kept


RUN = """
import hashlib
from hil_bench import VirtualBench
with VirtualBench() as bench:
    bench.bus.send(__import__("can").Message(arbitration_id=0, data=[1, 0], is_extended_id=False))
    bench.run(0.5)
    print(hashlib.sha256(bench.signals.tobytes() + repr([*bench.frames]).encode()).hexdigest())
"""


@pytest.mark.long  # a process each, without what is imported already
def test_without_any_ability_a_bench_runs_to_the_same_bytes(without):
    bare = without({*OWN}, "-c", RUN)
    whole = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", RUN], capture_output=True, text=True, check=True
    )
    assert bare.stdout == whole.stdout != "", bare.stderr
    refused = without({*OWN}, "-c", "import hil_bench; hil_bench.VirtualBench(record='x.csv')")
    assert "record = x.csv: nothing here records; leave it out" in refused.stderr


@pytest.mark.long  # runs the golden runs in a process of their own
@pytest.mark.parametrize("name", ["", *dict.fromkeys(GOLDEN.values())])
def test_the_golden_runs_stay_with_one_ability_alone(name, without, tmp_path):
    """The core makes its runs with what writes them down, and each ability with what it needs."""
    gone = {*OWN} - kept_with("recording") - (kept_with(name) if name else set())
    gone -= {"faults"} if name in ON_FAULTY_BENCHES else set()
    assert (
        str(tmp_path) in without(gone, "-c", "import hil_bench; print(hil_bench.__file__)").stdout
    )
    file = "tests/golden/test_golden.py"
    test = f"{file}::test_a_run_leaves_the_bytes_that_it_left"
    own = [f"{test}[{run}]" for run, needed in GOLDEN.items() if needed == name]
    asked = own or [file, *(f"--deselect={test}[{run}]" for run in GOLDEN)]
    done = without(gone, "-m", "pytest", "-q", "-p", "no:cacheprovider", *asked)
    assert done.returncode == 0, done.stdout


def test_a_verb_of_another_distribution_runs(spring_rig, cli):  # noqa: ARG001 - is installed
    """The example's mass of 10 kg on 1000 N/m swings with 10 rad/s = 1.59 Hz."""
    (swing,) = json.loads(cli(["springs", str(PLUGIN / "bench.toml"), "--json"]).out).values()
    assert swing["frequency_hz"] == pytest.approx(10.0 / (2.0 * math.pi))
    assert "\n    springs " in cli("--help").out


@pytest.mark.usefixtures("spring_rig")
def test_a_table_of_another_distribution_is_read_and_at_work(make_file, cli):
    file = make_file("bench.toml", "[beacon]\ncan_id = 0x77F\nperiod_ms = 20\n")
    with VirtualBench(load_config(file)) as bench:
        bench.run(0.1)
        times = [each.now for each in bench.frames if each.frame.can_id == 0x77F]
    assert times == [k * 20_000_000 for k in range(6)]
    assert "[beacon]" in cli(["check", str(file)]).out
    file.write_text("[beacon]\ncan_id = 0\nperiods_ms = 20\n")
    with pytest.raises(ConfigError) as error:
        load_config(file)
    assert str(error.value).splitlines() == [
        f"{file}:beacon.periods_ms: unknown key; the nearest known key is period_ms",
        f"{file}:beacon.can_id: 0 is out of range; give an integer from 1 to 2047",
    ]


def test_a_table_that_nobody_reads_is_refused(load_bench):
    with pytest.raises(ConfigError, match="baecon: unknown table; the nearest known is "):
        load_bench("[baecon]\ncan_id = 1\n")


NEW, ODD = 'Verb("more", 1, "do", "act")', 'Verb("odd", 1, "do", "act")'


@pytest.mark.parametrize(
    ("ability", "problem"),
    [
        (f'Ability("own", verbs={{"run": {NEW}}})', "its verb run is there already"),
        ('Ability("own", ("nowhere",))', "needs nowhere, which hil-bench does not have"),
        ('Ability("own", options={"run": "act"})', "has options; of other distributions only"),
        (f'Ability("own", verbs={{"act": {ODD}}})', 'the group "odd"; one'),
        ("1 / 0", "cannot be imported: ZeroDivisionError"),
        ('Ability("other")', "calls itself 'other'; both names must be the same"),
    ],
)
def test_a_broken_ability_is_a_line_and_the_rest_runs(ability, problem, site, capsys, cli):
    source = f"from hil_bench.ability import Ability, Verb\nOWN = {ability}\n"
    (site / "maker.py").write_text(source, encoding="utf-8")
    declare(site, "maker", "1.0", {"hil_bench.abilities": {"own": "maker:OWN"}})
    importlib.invalidate_caches()
    sys.modules.pop("maker", None)
    shown = cli("--help")
    (line,) = shown.err.splitlines()
    assert line.startswith("hil-bench: warning: ")
    assert problem in line
    assert "\n    run " in shown.out
    assert main(["check"]) == 0  # says nothing of what it does not concern
    assert capsys.readouterr().err == ""
