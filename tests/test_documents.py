"""Links, names and snippets of the documents lead somewhere, load and run."""

import ast
import functools
import importlib
import math
import pkgutil
import re
import shutil
import subprocess
from dataclasses import replace

import pytest
from support import documents
from support.documents import DOCUMENTS, ROOT
from support.feed_loop import FeedLoop
from support.fmus import write_law

import hil_drivers.modbus
from hil_bench import VirtualBench, load_config
from hil_bench.abilities.campaign.records import read_campaign
from hil_bench.abilities.faults.registry import FAULT_KINDS
from hil_bench.abilities.faults.section import FaultsPart
from hil_bench.abilities.fmu.export import export_axis
from hil_bench.abilities.live import attached
from hil_bench.abilities.modbus.map_files import load_register_map
from hil_bench.abilities.panel.layouts import read_layout
from hil_bench.abilities.recording.column_map import read_column_map
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.nodes import Vocabulary
from hil_bench.abilities.scenario.parse import parse_expectation
from hil_bench.abilities.scenario.resolve import compile_expectations, parameter_values
from hil_bench.bench.configuration.records import FIRST_BUS
from hil_bench.devices.kinds.registry import KINDS
from hil_bench.plants.registry import DEFAULT_PLANT
from hil_drivers import Network
from hil_drivers.modbus.framing import TcpFraming

pytest_plugins = ["pytester"]

FOLDERS = "docs|examples|benchmarks|device_profiles|drivers|hil_bench|tests|.ci"
SKETCHES = "docs/types.md"  # its blocks show types, not programs
PYTHON = [block for block in documents.blocks("python") if not str(block).startswith(SKETCHES)]
IS_REFUSED = re.compile(r"\s*```text\nbench\.toml:")

VALVE = '[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n'
PRESSURE = '[nodes.pressure_a]\nprofile = "pressure_404"\nnode_id = 2\nsource = "P_A"\n'
BEGINNINGS = {
    "[nodes.valve.objects]": VALVE,
    "[nodes.pressure_a.chain]": VALVE + PRESSURE,
    "[nodes.pressures]": VALVE,
    "[nodes.io.objects]": '[nodes.io]\nnode_id = 10\neds = "vendor.eds"\n',
}
"""What a file has before the first table of a snippet that shows no whole one."""

SIGNALS = Vocabulary(
    {
        f"axis1.{quantity.name}": quantity.unit
        for quantity in DEFAULT_PLANT.quantities
        if quantity.is_recorded
    }
)


def code_with(pattern):
    """Return document and match of the pieces of code in the text that match, in one order."""
    return sorted({found for found in documents.inline_code() if re.fullmatch(pattern, found[1])})


def test_every_table_is_whole():
    """A row without a head above it, or with other columns than it, is shown as text."""
    torn = []
    for document, table in documents.tables():
        rows = [re.sub(r"\\\||`[^`]*`", "", row).strip() for row in table.splitlines()]
        columns = {row.count("|") for row in rows}
        if len(rows) < 2 or len(columns) > 1 or not re.fullmatch(r"[|: -]+", rows[1]):
            torn.append(f"{document.relative_to(ROOT)}: {rows[0]}")
    assert torn == []


def test_every_link_leads_to_a_file_and_a_heading():
    lost = []
    for document, target in documents.links():
        name, _, anchor = target.partition("#")
        path = document.parent / name if name else document
        if not path.exists() or (anchor and anchor not in documents.anchors(path)):
            lost.append(f"{document.relative_to(ROOT)}: {target}")
    assert lost == []


def test_every_picture_is_shown_somewhere():
    shown = {(path.parent / target).resolve() for path, target in documents.links()}
    assert [path for path in (ROOT / "docs" / "images").iterdir() if path not in shown] == []


def test_every_document_is_linked():
    linked = {
        (path.parent / target.partition("#")[0]).resolve() for path, target in documents.links()
    }
    apart = [path for path in DOCUMENTS if not {path, path.parent} & linked]
    assert apart == [ROOT / "README.md"]


def test_each_file_that_is_named_is_there():
    named = code_with(rf"(?:{FOLDERS})/[\w./*-]+")
    assert len(named) > 100
    assert [found for found in named if not any(ROOT.glob(found[1]))] == []


def test_each_name_of_the_packages_is_there():
    """Of a module, or of a group of entry points."""
    named = code_with(r"(?:hil_bench|hil_drivers)(?:\.\w+)+")
    assert len(named) > 80
    for place, code in named:
        is_there = code in {FAULT_KINDS.group, KINDS.group} or pkgutil.resolve_name(code)
        assert is_there, f"{place}: {code}"


@pytest.mark.parametrize(
    ("document", "package"),
    [
        ("docs/analysis.md", "hil_bench.abilities.analysis"),
        ("docs/plant.md", "hil_bench.plants.hydraulic_cylinder.model"),
    ],
)
def test_a_function_that_is_named_is_there(document, package):
    modules = {
        module.name for module in pkgutil.iter_modules(importlib.import_module(package).__path__)
    }
    named = [
        code
        for place, code in code_with(r"[a-z_]+\.[a-z_]+")
        if place == document and code.partition(".")[0] in modules
    ]
    assert len(named) > 10
    for name in named:
        pkgutil.resolve_name(f"{package}.{name}")


@pytest.mark.parametrize("block", documents.blocks("toml"), ids=str)
def test_a_toml_snippet_loads(block, tmp_path):
    text = block.path.read_text(encoding="utf-8")
    behind = text[text.index(block.text) + len(block.text) + len("```\n") :]
    if IS_REFUSED.match(behind):
        return  # tests/unit/config/test_documentation.py compares what is said of it
    shutil.copy(ROOT / "device_profiles/imitations/analogue_io_401.eds", tmp_path / "vendor.eds")
    shutil.copy(ROOT / "examples/joystick.dbc", tmp_path)
    path = tmp_path / "bench.toml"
    if "control.fmu" in block.text:
        pytest.importorskip("pythonfmu")
        write_law(tmp_path)
    if "[[expect]]" in block.text:
        path.write_text(block.text, encoding="utf-8")
        check_scenario(path)
        return
    if "scenarios = [" in block.text:
        path.write_text(block.text, encoding="utf-8")
        assert read_campaign(path).parameters
        return
    if "[[items]]" in block.text:
        path.write_text(block.text, encoding="utf-8")
        assert read_layout(path)["items"]
        return
    if "[spool_setpoint]" in block.text:
        path.write_text(block.text, encoding="utf-8")
        assert read_column_map(path, []).common
        return
    if "_registers." in block.text:
        path.write_text(block.text, encoding="utf-8")
        load_register_map(path)
        return
    for name in re.findall(r'"(\w+\.(?:pem|key))"', block.text):
        (tmp_path / name).touch()
    if "axis.fmu" in block.text:
        pytest.importorskip("pythonfmu")
        config = load_config()
        export_axis(config, config.axes[0], tmp_path / "axis.fmu")
    beginning = BEGINNINGS.get(block.text.partition("\n")[0], "")
    path.write_text(beginning + block.text, encoding="utf-8")
    check_motion(load_config(path))


def check_motion(config):
    """See that each valve and each drive of CiA 402 on the first bus moves its axis.

    0.6 of the opening is beyond any overlap; a revolution takes the drive's default ramps
    2 sqrt(65536 / 655360) s = 0.63 s.
    """
    driven = {"valve_408", "drive_402"}
    nodes = [n for n in config.nodes if n.kind.name in driven and n.bus == FIRST_BUS]
    if not nodes or config.of(FaultsPart).faults:
        return
    with VirtualBench(config) as bench, Network(bench.bus, clock=bench.now) as network:
        bench.pump = network.pump
        bench.run(0.01)  # all boot
        plants = {axis.name: axis.plant for axis in bench.bench.axes}
        for node in nodes:
            begin = plants[node.axis].output[0]
            move = turn_by_drive if node.kind.name == "drive_402" else move_by_valve
            move(bench, network, node)
            moved = abs(plants[node.axis].output[0] - begin)
            assert moved > 0.01, f"{node.name} does not move {node.axis}"


def move_by_valve(bench, network, node):
    valve = network.add_node(node.node_id, node.eds)
    network.start_node(node.node_id)
    bench.run(0.01)
    for word in (0x01, 0x03, 0x07):
        valve.write(0x6040, 0, word)
        bench.run(0.003)
    valve.write(0x6300, 1, -0x2666)  # of 0x4000
    bench.run(0.3)


def turn_by_drive(bench, network, node):
    drive = network.add_node(node.node_id, node.eds)
    network.start_node(node.node_id)
    bench.run(0.01)
    plant = next(axis.plant for axis in bench.bench.axes if axis.name == node.axis)
    begin = plant.output[0]
    drive.write(0x6060, 0, 1)
    for word in (0x06, 0x07, 0x0F):
        drive.write(0x6040, 0, word)
        bench.run(0.003)
    drive.write(0x607A, 0, 65536)
    drive.write(0x6040, 0, 0x1F)
    bench.run(3.0)
    assert drive.read_integer(0x603F, 0) == 0
    assert drive.read_integer(0x6041, 0) & 1 << 10, "the target is not reached"
    # The position window of docs/devices.md is 656 of the 65536 increments of a revolution.
    assert abs(drive.read_integer(0x6064, 0) - 65536) <= 656
    assert abs((plant.output[0] - begin) / math.tau - 1.0) <= 2 * 656 / 65536
    drive.write(0x6060, 0, 3)
    drive.write(0x60FF, 0, 131072)  # 2 rev/s, after 0.2 s by the ramp of 0x6083
    bench.run(2.0)
    before = plant.output[0]
    bench.run(0.5)
    assert (plant.output[0] - before) / math.tau == pytest.approx(1.0, rel=0.05)
    drive.write(0x6060, 0, 8)
    start = drive.read_integer(0x6064, 0)
    for step in range(1, 101):  # 1 rev/s: a target each 10 ms, the period of 0x60C2
        drive.write(0x607A, 0, start + step * 655)
        bench.run(0.009)
    bench.run(4.0)  # the drive comes to rest in the window as slowly as its velocity loop lets it
    assert abs(drive.read_integer(0x6064, 0) - start - 65500) <= 656
    assert drive.read_integer(0x603F, 0) == 0


def check_scenario(path):
    """Load a scenario, and parse what it expects of the default bench."""
    scenario = load_scenario(path)
    values = parameter_values(scenario)
    assert compile_expectations(scenario, replace(SIGNALS, parameters=values))


@pytest.mark.parametrize("block", documents.blocks("expectation"), ids=str)
def test_an_expectation_is_right(block):
    for line in block.text.splitlines():
        parse_expectation(line, SIGNALS)


@pytest.mark.parametrize("block", PYTHON, ids=str)
def test_a_python_snippet_says_what_its_comments_say(block, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "examples/one_axis.toml", "bench.toml")
    shutil.copy(ROOT / "examples/j1939.toml", "j1939.toml")
    with VirtualBench(load_config(modbus=True)) as bench:  # what listens to a Modbus client
        monkeypatch.setattr(
            hil_drivers.modbus, "TcpLink", lambda _host, _port: bench.modbus_link(TcpFraming())
        )
        bench.run(0.1)
        watched = functools.cache(FeedLoop)
        monkeypatch.setattr(attached, "connect", lambda *words: watched().connect(*words))
        shown = run_and_collect_comments(block)
    said = capsys.readouterr().out.splitlines()
    assert len(said) == len(shown)
    for line, comment in zip(said, shown, strict=True):
        assert re.fullmatch(re.escape(comment).replace(r"\.\.\.", ".*"), line)


def run_and_collect_comments(block):
    """Run a snippet that prints each expression, too; return what it shows behind "#"."""
    tree, lines, shown = ast.parse(block.text), block.text.splitlines(), []
    for statement in ast.walk(tree):
        if isinstance(statement, ast.Expr) and not is_call_of_another(statement.value):
            if not isinstance(statement.value, ast.Call):
                statement.value = ast.Call(ast.Name("print", ast.Load()), [statement.value], [])
            comment = lines[statement.end_lineno - 1].partition("  # ")[2]
            shown.append((statement.lineno, re.sub(r"(?: \[|: ).*", "", comment)))
    program = compile(ast.fix_missing_locations(tree), str(block), "exec")
    exec(program, {"__name__": "snippet"})  # noqa: S102 - it is our own document
    return [comment for _, comment in sorted(shown)]


def is_call_of_another(value):
    """Whether an expression is a call, and none of print, so that it shows nothing."""
    return isinstance(value, ast.Call) and ast.unparse(value.func) != "print"


def test_the_tests_pass(pytester):
    tests = [block.text for block in documents.blocks("py") if "firmware(" not in block.text]
    pytester.makepyfile("\n\n".join(tests))
    pytester.runpytest("-p", "no:cacheprovider").assert_outcomes(
        passed=sum(text.count("def test_") for text in tests)
    )


@pytest.mark.skipif(
    not (shutil.which("make") and shutil.which("cc")),
    reason="no C compiler; apt-get install make gcc libc6-dev",
)
def test_the_tests_of_firmware_pass(pytester):
    tests = [block.text for block in documents.blocks("py") if "firmware(" in block.text]
    assert len(tests) == 1
    build = pytester.path / "build"
    make = ["make", "--silent", "-C", ROOT / "examples" / "firmware", f"BUILD={build}"]
    subprocess.run(make, check=True)  # noqa: S603 - our own sources
    pytester.makepyfile(tests[0])
    pytester.runpytest("-p", "no:cacheprovider").assert_outcomes(passed=1)


def test_no_example_is_left_untold():
    texts = [path.read_text(encoding="utf-8") for path in DOCUMENTS]
    examples = [path.name for path in (ROOT / "examples").iterdir() if path.is_file()]
    assert [name for name in examples if not any(name in text for text in texts)] == []


def test_every_table_of_figures_says_when_it_was_published():
    text = (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8")
    text = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    stamp = r"\n\*Published \d{4}-\d\d-\d\d with [0-9a-f]{7}[^*]*\.\*\n"
    undated = [
        table.partition("\n")[0]
        for table in re.findall(r"(?:^\|.*\n)+(?!\|)(?!" + stamp + ")", text, re.MULTILINE)
    ]
    assert undated == []


def test_who_has_no_cylinder_gets_strokes_by_the_bench_of_that_page(tmp_path, monkeypatch, cli):
    """The commands up to the first that takes long; a playing scenario has tests of its own."""
    monkeypatch.chdir(tmp_path)
    on_page = [block for block in documents.blocks("toml", "sh") if "my-cylinder" in str(block)]
    (bench,) = (block.text for block in on_page if block.text.startswith("[plant.lift]"))
    (practice,) = (block.text for block in on_page if block.language == "sh")
    old, new = re.match(r"sed 's/(.*)/(.*)/' bench\.toml > machine\.toml\n", practice).groups()
    assert bench.count(old) == 1
    (tmp_path / "machine.toml").write_text(bench.replace(old, new))
    design, play, fit = practice.splitlines()[1:]
    cli(design.removeprefix("hil-bench "))
    assert play.split()[3] == "practice/design.scenario.toml"
    assert load_scenario(tmp_path / play.split()[3]).bench == "../machine.toml"
    assert play.split()[-1] == fit.split()[2] == "strokes.csv"
