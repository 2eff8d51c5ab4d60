"""A third party's device and plant (examples/plugin) on the bench, by entry points alone."""

import ast
import importlib
import inspect
import math
import re
import struct
import subprocess
import sys
from pathlib import Path

import can
import pytest
from support.distribution import PLUGIN, declare, pip_install

from hil_bench import ConfigError, VirtualBench, load_config
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.devices.kinds.registry import KINDS
from hil_bench.plants.registry import PLANTS
from hil_bench.units import METRE
from hil_drivers import Network, PositionSensor
from hil_drivers.modbus.client import ModbusClient
from hil_drivers.modbus.framing import TcpFraming

BENCH = PLUGIN / "bench.toml"


@pytest.fixture
def rig(spring_rig):  # noqa: ARG001 - its kinds are there
    """The example's bench."""
    with VirtualBench(load_config(BENCH)) as bench:
        yield bench


@pytest.fixture
def vessel(spring_rig):  # noqa: ARG001 - its plant is there
    """The example's bench of a vessel that a valve fills, with the valve active and closed."""
    with VirtualBench(load_config(PLUGIN / "vessel.toml")) as bench:
        start(bench)
        command(bench, 0)
        yield bench


def deflection(time):
    """The script of bench.toml: from 0 at 0 s to 1 at 0.2 s."""
    return min(time / 0.2, 1.0)


def swing(time):
    """Closed form of m x'' + k x = 0 from 20 mm: k / m = 1000 N/m / 10 kg = (10 rad/s)²."""
    return 20e-3 * math.cos(10.0 * time)


def start(bench):
    bench.run(2e-3)  # all boot
    send(bench, 0, b"\x01\x00")
    bench.run(2e-3)


def send(bench, can_id, data):
    bench.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))


def command(bench, percent):
    """Command the valve by way of HOLD to ACTIVE, at a part of its reference 0x6311.01 = 16384."""
    for word in (0x0003, 0x0007):
        send(bench, 0x201, struct.pack("<Hh", word, percent * 16384 // 100))
        bench.run(2e-3)


def rise(bench, time=0.1):
    """Return by how much the pressure rises in a time [Pa]."""
    before = bench.values["vessel.pressure"]
    bench.run(time)
    return bench.values["vessel.pressure"] - before


def test_a_valve_commands_the_foreign_plant_by_a_ratio(vessel):
    assert rise(vessel) == 0.0
    command(vessel, 50)
    assert vessel.values["vessel.opening_setpoint"] == 0.5
    # 6 l/min = 100 cm³/s at the full opening, into 1 cm³/bar: half of it brings 50 bar/s.
    assert rise(vessel) == pytest.approx(5e5)
    assert vessel.nodes["valve"]["0x6301.01"] == 8192  # the opening follows at once
    assert vessel.values["pressure.measured"] == vessel.values["vessel.pressure"]
    with vessel.faults.invert("valve"):
        vessel.run(2e-3)
        assert rise(vessel) == pytest.approx(-5e5)


def test_influence_and_defect_of_the_foreign_plant(vessel):
    act = vessel.session.bench.axes[0].plant.influence
    act("load_flow", 10e-6)  # 10 cm³/s out of 1 cm³/bar
    assert rise(vessel) == pytest.approx(-1e5)
    act("load_flow", 0.0)
    pressure = vessel.values["vessel.pressure"]
    conductance = 5e-12  # with C = 1e-11 m³/Pa, P falls as exp(-0.5 t / s)
    with vessel.faults.leak("vessel", conductance):
        fall = rise(vessel)
    # Euler's steps of 50 us differ from that by 2.5e-5 of the fall.
    assert fall == pytest.approx(pressure * math.expm1(-0.05), rel=1e-4)


@pytest.mark.usefixtures("spring_rig")
def test_a_full_opening_is_refused_where_the_command_is_no_length(make_file):
    path = make_file(
        "bench.toml",
        '[plant.vessel]\nkind = "vessel"\n'
        '[nodes.v]\nprofile = "valve_408"\nnode_id = 1\nfull_opening_mm = 1.0\n',
    )
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    wrong = "nodes.v.full_opening_mm: a vessel is commanded in -; leave the key out"
    assert str(caught.value) == f"{path}:{wrong}"


@pytest.mark.usefixtures("spring_rig")
def test_a_length_in_another_unit_is_the_full_opening(monkeypatch):
    vessel = PLANTS.find("vessel")
    monkeypatch.setattr(type(vessel), "command_unit", METRE)
    monkeypatch.setattr(type(vessel), "full_scale", lambda *_: 2e-3)
    config = load_config(PLUGIN / "vessel.toml")
    assert config.full_scale(config.axes[0]) == pytest.approx(2e-3)


def test_device_and_plant_are_recorded_with_units(rig):
    rig.run(0.3)
    signals = rig.signals
    assert list(signals.units) == [
        "time",
        "rig.position",
        "rig.speed",
        "rig.force_setpoint",
        "rig.force",
        "position.measured",
        "position.measured_speed",
        "io.0x6401.01.measured",
        "joystick.x.measured",
        "joystick.y.measured",
    ]
    assert signals.units["rig.force"] == "N"
    assert signals.units["joystick.x.measured"] == "-"
    times = signals["time"]
    expected = [swing(time) for time in times]
    # The first tick moves it, so a row is a tick of 1 ms ahead: at most 0.2 m/s by 1 ms; and the
    # semi-implicit Euler step of 50 us adds its half.
    assert signals["rig.position"] == pytest.approx(expected, abs=0.2e-3 + 10e-6)
    assert signals["joystick.x.measured"] == pytest.approx([deflection(t) for t in times], abs=0.01)
    assert set(signals["joystick.y.measured"]) == {0.0}
    shown = rig.nodes["io"]["0x6401.01"]  # 100 counts a millimetre, and no full scale in them
    assert shown == round(rig.values["rig.position"] * 1e3 * 100)


def test_the_bench_s_own_encoder_measures_the_foreign_plant(rig):
    with Network(rig.bus, clock=rig.now) as network:
        rig.pump = network.pump
        (node,) = (node for node in rig.config.nodes if node.name == "position")
        sensor = PositionSensor(network, node.node_id, node.eds)
        sensor.setup(transmission_type=254, event_timer=0.005)
        network.start_node(node.node_id)
        network.wait_until(lambda: sensor.age < 1.0, 1.0, "first values")
        network.pump(0.1)
        # The encoder counts micrometres, and its value is at most 6 ms old at up to 0.2 m/s.
        assert sensor.position == pytest.approx(rig.values["rig.position"], abs=1.5e-3)


def test_an_object_commands_the_foreign_plant_within_its_force(rig):
    start(rig)
    for counts, force in ((1234, 12.34), (32767, 50.0)):  # 100 counts a newton; force_n = 50
        send(rig, 0x30B, struct.pack("<hh", counts, 0))
        rig.run(2e-3)
        assert rig.values["rig.force_setpoint"] == pytest.approx(force)
        assert rig.values["rig.force"] == pytest.approx(force)


def test_the_device_is_seen_over_canopen_and_modbus(rig):
    client = ModbusClient(rig.modbus_link(TcpFraming()), clock=rig.now, timeout=0.1)
    start(rig)
    rig.run(0.1)
    x, _, y, counts = client.read_registers(10, "input_registers", 0, 4)
    seen = []
    while (message := rig.bus.recv(0.0)) is not None:
        seen += [message.data] if message.arbitration_id == 0x28A else []
    # deflection(0.1) is 0.5; 10000 counts are 1, and the TPDO comes each 10 ms or 100 counts.
    assert struct.unpack("<hh", seen[-1]) == (pytest.approx(5000, abs=600), 0)
    assert struct.unpack(">f", struct.pack(">HH", x, _))[0] == pytest.approx(0.5, abs=0.06)
    assert (y, counts) == (0, pytest.approx(5000, abs=600))


def test_device_and_plant_may_have_faults(rig):
    rig.run(0.1)
    with rig.faults.freeze("joystick.x"), rig.faults.offset("position", 5e-3):
        rig.run(2e-3)
        frozen = rig.values["joystick.x.measured"]
        rig.run(0.05)
        assert rig.values["joystick.x.measured"] == frozen
        shown, true = rig.values["position.measured"], rig.values["rig.position"]
        assert shown - true == pytest.approx(5e-3)
    rig.run(2e-3)
    assert rig.values["joystick.x.measured"] > frozen + 0.2  # 5 a second
    with pytest.raises(ConfigError, match="there is no axis"):
        rig.faults.drop_supply("rig", 1e5)


@pytest.mark.usefixtures("rig")
def test_what_does_not_go_with_the_plant_is_told(make_file):
    path = make_file(
        "bench.toml",
        '[plant.rig]\nkind = "mass_on_spring"\nmass_kgg = 1\n'
        '[nodes.v]\nprofile = "valve_408"\nnode_id = 1\n'
        '[nodes.p]\nprofile = "pressure_404"\nnode_id = 2\nsource = "P_A"\n'
        '[nodes.p.objects]\n"0x2000.01" = { source = "rig.P_A" }\n',
    )
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    assert [line.removeprefix(f"{path}:") for line in str(caught.value).splitlines()] == [
        "plant.rig.mass_kgg: unknown key; the nearest known key is mass_kg",
        (
            "nodes.v.axis: the plant is a mass_on_spring, commanded in N, and no valve does so; "
            "give the node another profile or another axis"
        ),
        'nodes.p.source: "P_A" is unknown; a mass_on_spring has no pressure',
        (
            'nodes.p.objects.0x2000.01.source: "rig.P_A" can be no source; '
            'the nearest that can is "rig.speed"'
        ),
    ]


@pytest.mark.usefixtures("rig")
def test_a_verb_for_cylinders_says_that_it_needs_one(cli):
    assert "plant.rig: is a mass_on_spring, and an analysis needs a hydraulic" in (
        cli(["analyse", "root-locus", str(BENCH)], 2).err
    )


BROKEN = {
    "raises": (
        "raise RuntimeError('no\\nlicence')",
        "cannot be imported: RuntimeError: no licence",
    ),
    "no_kind": ("KIND = 1", "is int; an instance of DeviceKind is right"),
    "absent": ("", "cannot be imported: AttributeError: module 'absent' has no attribute 'KIND'"),
    "other": (
        "from hil_bench.devices.kinds.kind import GENERIC as KIND",
        "calls itself 'generic'; both names must be the same",
    ),
    "no_eds": (
        (
            "from pathlib import Path\nfrom hil_bench.devices.kinds.kind import GenericKind\n"
            "class Kind(GenericKind):\n    name = 'no_eds'\n    eds = Path('/nowhere/no.eds')\n"
            "KIND = Kind()"
        ),
        "lacks its EDS file: there is no /nowhere/no.eds",
    ),
    "twice": (
        (
            "from hil_bench.devices.kinds.kind import GenericKind\n"
            "from hil_bench.config.settings import Key\n"
            "class Kind(GenericKind):\n    name = 'twice'\n    keys = (Key('bus', str),)\n"
            "KIND = Kind()"
        ),
        (
            "has the key bus twice; every node has profile, node_id, bus, axis, eds, storage, "
            "serial_number, objects, chain"
        ),
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_kind_is_one_line_that_names_its_distribution(site, make_file, name):
    source, problem = BROKEN[name]
    (site / f"{name}.py").write_text(source)
    declare(site, "maker-of-it", "2.5", {KINDS.group: {name: f"{name}:KIND"}})
    importlib.invalidate_caches()
    path = make_file("bench.toml", f'[nodes.n]\nprofile = "{name}"\nnode_id = 1\n')
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    told = f'maker-of-it 2.5: hil_bench.kinds: "{name}" ({name}:KIND) {problem}'
    assert str(caught.value).splitlines()[0] == f"{path}:nodes.n.profile: {told}"
    assert str(caught.value).count("maker-of-it") == 1
    # Whoever does not ask for it is not disturbed, and a list of all goes on behind it.
    assert len(load_config().nodes) == 4
    assert [(each.name, each.distribution) for each in KINDS.extensions()] == [
        (name, "maker-of-it 2.5")
    ]
    assert [each.problem for each in KINDS.extensions()] == [told]


def test_a_name_that_is_there_twice_is_told_with_all_who_declare_it(site):
    for maker in ("one", "two"):
        declare(site, maker, "1", {KINDS.group: {"stick": "stick:KIND"}})
    importlib.invalidate_caches()
    with pytest.raises(ConfigError, match=r'^one 1, two 1: hil_bench.kinds: "stick" is decl'):
        KINDS.find("stick")


def test_the_bench_s_own_kind_stays_when_somebody_declares_its_name(site):
    declare(site, "thief", "1", {KINDS.group: {"valve_408": "thief:KIND"}})
    importlib.invalidate_caches()
    assert KINDS.find("valve_408") is KINDS.built_in["valve_408"]
    (extension,) = KINDS.extensions()
    assert extension.problem.startswith('thief 1: hil_bench.kinds: "valve_408" is hil-bench\'s own')


def test_a_plant_with_two_commands_is_refused(site):
    (site / "two.py").write_text(
        "from hil_bench.plants.hydraulic_cylinder.kind import HydraulicCylinder\n"
        "from hil_bench.plants.plant import Quantity\n"
        "class Two(HydraulicCylinder):\n    name = 'two'\n"
        "    quantities = (Quantity('a', 'N', None), Quantity('b', 'N', None))\n"
        "KIND = Two()"
    )
    declare(site, "two", "1", {PLANTS.group: {"two": "two:KIND"}})
    importlib.invalidate_caches()
    with pytest.raises(ConfigError, match="has 2 quantities without an output; one, its command"):
        PLANTS.find("two")


def test_names_and_the_built_in_bench_import_no_extension(site):
    declare(site, "lazy", "1", {KINDS.group: {"lazy": "lazy_module:KIND"}})
    (site / "lazy_module.py").write_text("raise SystemExit('imported')")
    importlib.invalidate_caches()
    assert KINDS.names()[-1] == "lazy"
    assert len(load_config().nodes) == 4


@pytest.mark.long  # a process of its own, and what pip needs
def test_the_package_of_the_example_runs_where_pip_has_put_it(tmp_path):
    target, recording = tmp_path / "target", tmp_path / "run.csv"
    pip_install(PLUGIN, target)
    program = (
        "import sys\n"
        "from hil_bench import VirtualBench, load_config\n"
        "with VirtualBench(load_config(sys.argv[1]), record=sys.argv[2]) as bench:\n"
        "    with bench.faults.freeze('joystick.x', at=0.05):\n"
        "        bench.run(0.1)\n"
        "import spring_rig\n"
        "print(spring_rig.__file__)"
    )
    done = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", program, str(BENCH), str(recording)],
        env={"PYTHONPATH": str(target)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert Path(done.stdout.strip()).is_relative_to(target)
    rows = read_recording(recording)
    assert rows["rig.position"][-1] == pytest.approx(swing(0.1), abs=0.2e-3)
    assert rows["joystick.x.measured"][-1] == pytest.approx(deflection(0.05), abs=0.01)


def contract(cls):
    """Return the public face of a class as its source has it, without texts and bodies."""
    (node,) = ast.parse(inspect.getsource(cls)).body
    node.body = [each for each in node.body if is_public(each)]
    for each in node.body:
        if isinstance(each, ast.FunctionDef):
            each.body = [ast.Expr(ast.Constant(...))]
    return ast.dump(node)


def is_public(each):
    if isinstance(each, ast.FunctionDef):
        return each.name == "__init__" or not each.name.startswith("_")
    return isinstance(each, ast.AnnAssign)


def test_the_document_has_the_signatures_of_the_code():
    text = (PLUGIN.parents[1] / "docs" / "plugins.md").read_text(encoding="utf-8")
    named = {}
    for block in re.findall(r"```pyi\n(# hil_bench.*?)```", text, re.DOTALL):
        for part in block.split("# hil_bench.")[1:]:
            module, _, source = part.partition("\n")
            (node,) = ast.parse(source).body
            named[node.name] = f"hil_bench.{module}", ast.dump(node)
    assert {"Key", "Quantity", "Measurement", "QuantitySource", "Fitting"} <= set(named)
    assert {"AxisConfig", "DeviceKind", "PlantKind"} <= set(named)
    for name, (module, told) in named.items():
        assert told == contract(getattr(importlib.import_module(module), name)), name
