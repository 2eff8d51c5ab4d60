"""Sound files to begin with: those of `examples` and some of their own, and what lies beside."""

import importlib.util
import json
import shutil
import sys
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

REPOSITORY: Final = Path(__file__).resolve().parents[2]
_SHORTEST = 0.02  # s, of a scenario: what is played is cheap, and every kind of step still acts
_RECORDING = "time,axis1.position,axis1.P_A,axis1.P_B,axis1.spool_setpoint,axis1.spool_position\n"

SCENARIO = """
title = "T"
duration_s = 0.02
[controller]
example = "position_control"
[parameters]
target_mm = { value = 10.0, range = [5.0, 15.0] }
[[step]]
at_s = 0.005
fault = "noise"
target = "position"
noise_mm = 0.1
[[step]]
at_s = 0.01
set = { "axis1.load" = 500 }
over_s = 0.005
[[expect]]
id = "R1"
that = "always axis1.P_A < 250 bar and axis1.position < target_mm + 300 mm"
"""
REQUIREMENTS = """
[[expect]]
id = "R1"
that = "always axis1.P_A < 250 bar"
[[expect]]
id = "R2"
that = "always within 5 ms axis1.position < 1 m"
"""
PLAN = """
[limits]
position_mm = [-150, 150]
speed_mm_s = 400
pressure_bar = [-1, 110]
time_s = 1
[communication]
[sensors]
duration_s = 0.1
"""
CAMPAIGN = """
title = "C"
scenarios = ["seed.scenario.toml"]
sampler = "grid"
runs = 2
levels = 2
seeds = [1]
timeout_s = 10
[parameters]
target_mm = { range = [6.0, 9.0] }
[tolerances]
"plant.axis1.moving_mass_kg" = { normal = [10.0, 1.0] }
"""
REGISTER_MAP = """
[device]
profile = "pressure_404"
vendor_name = "maker"
product_code = "PT-1"
revision = "1.0"
[input_registers.pressure]
address = 0
source = "pressure"
type = "float32"
unit = "bar"
"""
COLUMNS = """
[time]
column = "t"
unit = "s"
[position]
column = "x"
unit = "mm"
[spool_setpoint]
column = "u"
unit = "V"
[P_A]
column = "pa"
unit = "bar"
[P_B]
column = "pb"
unit = "bar"
"""
SHEET = """title,T
duration_s,0.02
parameter,high_bar,60,40,90
expect,R1,always axis1.P_A < high_bar + 200 bar
time_s,axis1.load,fault:drop_supply axis1 pressure_bar,sync
0.005,200,high_bar,on
0.01,-> 0.1 over 0.005,,off
"""
FMU_BENCH = """
[bench]
tick_us = 1000
step_us = 1000
[plant.axis1]
kind = "fmu"
file = "axis.fmu"
command = "spool_setpoint"
own_process = false
[plant.axis1.outputs]
position = "position"
speed = { variable = "speed", unit = "m/s" }
P_A = { variable = "P_A", unit = "Pa" }
[plant.axis1.inputs]
load = { variable = "load", unit = "N" }
[nodes.valve]
profile = "valve_408"
node_id = 1
"""
WITH_MAP = '[modbus.units.pressure_a]\nregisters = "generated.toml"\n'
WITH_EDS = """
[plant.axis1]
kind = "none"
[nodes.io]
node_id = 10
eds = "generated.eds"
"""
WITH_DBC = """
[plant.axis1]
[nodes.valve]
profile = "valve_408"
node_id = 1
[j1939.joystick]
address = 19
dbc = "generated.dbc"
[j1939.joystick.signals]
JoystickButton1 = { message = "BJM1" }
"""
WITH_COURSE = """
title = "T"
duration_s = 0.02
[[step]]
at_s = 0.0
set = "axis1.load"
table = "generated.csv"
[[expect]]
id = "R1"
that = "always axis1.P_A < 250 bar"
"""
COURSE = "0,0\n0.005,100\n0.01,200\n0.015,0\n"
ON_BENCH = """
title = "T"
bench = "generated.toml"
duration_s = 0.02
[parameters]
load_n = { value = 500, range = [0, 900] }
[[step]]
at_s = 0.005
set = { "axis1.load" = "load_n" }
over_s = 0.005
[[expect]]
id = "R1"
that = "always axis1.P_A < 250 bar"
"""
STEPS = """
title = "Steps"
duration_s = 0.02
[parameters]
load_n = { value = 500, range = [0, 900] }
limit_bar = { value = 250.0, range = [100.0, 300.0] }
offset_bar = 2.0
[[step]]
at_s = 0.001
nmt = "start"
target = "valve"
[[step]]
at_s = 0.002
set = { "valve.0x6040" = 1 }
[[step]]
at_s = 0.003
sync = true
[[step]]
at_s = 0.004
sync = false
[[step]]
at_s = 0.005
set = { "axis1.load" = "load_n" }
over_s = 0.005
[[step]]
at_s = 0.006
fault = "offset"
target = "pressure_a"
offset_bar = "offset_bar"
for_s = 0.005
[[step]]
at_s = 0.007
fault = "drop_supply"
target = "axis1"
pressure_bar = 60.0
[[step]]
at_s = 0.008
fault = "lose"
target = "position"
share_percent = 10.0
direction = "sent"
[[expect]]
id = "R1"
that = "always axis1.P_A < limit_bar"
[[expect]]
id = "R2"
that = "whenever axis1.P_A > 10 bar then within 5 ms abs(axis1.position) < 10 mm"
[[expect]]
id = "R3"
that = "eventually axis1.P_A > 1 bar"
"""
LINES = (
    "(0.000100) can0 701#00\n(0.000500) can0 000#0100\n(0.001000) can0 181#0102\n"
    "(0.001100) can0 601#4018100100000000\n(0.001200) can0 581#4318100101000000\n"
    "(0.002000) can0 080#\n(0.003000) can0 081#0010010000000000\n(0.004000) can0 704#7F\n"
)
ASC = (
    "date Mon Sep 30 15:06:13.191 2019\nbase hex  timestamps absolute\n"
    "0.001000 1  181 Rx d 2 01 02\n0.002000 1  080 Rx d 0\n0.003000 1  701 Rx d 1 05\n"
)
_SHAPES = ("63/36x500", "80/45/45x300", "100/70x1200")
ANSWERS = tuple(
    f"{shape}\n{valve}\n{supply}\n{pump}\n500\n{slope}\nHLP 46\n"
    for shape in _SHAPES
    for valve, supply in (("60 l/min @ 5 bar, overlap 15 %, 40 Hz", "210"), ("NG10", "160 bar"))
    for pump, slope in (("none", "0"), ("40", "90"))
)
RESULTS = {"scenarios": [{"title": "T", "requirements": [{"id": "R1", "verdict": "passed"}]}]}
JUNIT = (
    '<?xml version="1.0"?>\n<testsuites>\n<testsuite name="s" tests="1" failures="0">\n'
    '<testcase classname="c" name="R1" time="0.1"/>\n</testsuite>\n</testsuites>\n'
)

STEM: Final = "generated"
"""Name of each generated file, without its suffix."""


def examples(folder: str, pattern: str) -> Iterator[tuple[str, str]]:
    for path in sorted((REPOSITORY / folder).glob(pattern)):
        yield folder, path.read_text(encoding="utf-8")


def benches() -> Iterator[tuple[str, str]]:
    strangers = {"commissioning.toml", "network.toml", "pyproject.toml"}
    for folder in ("examples", "examples/machines", "examples/plugin"):
        for path in sorted((REPOSITORY / folder).glob("*.toml")):
            if path.name not in strangers and ".scenario." not in path.name:
                yield folder, path.read_text(encoding="utf-8")
    if importlib.util.find_spec("fmpy"):
        yield "examples", FMU_BENCH


def recording() -> str:
    rows = (f"{n / 1000},{0.1 * n / 100},{5e6},{4e6},0.1,0.1\n" for n in range(60))
    return _RECORDING + "s,m,Pa,Pa,-,-\n" + "".join(rows)


def measured() -> str:
    """Return a table of another tool: the piston moves with the command, to and fro."""
    rows = []
    position = 0.0
    for n in range(250):  # 2.5 s: refused behind all checks, as an identification takes 20 s
        command = 5.0 if n // 50 % 2 else -5.0
        position += command * 0.02
        rows.append(f"{n / 100},{position:.4f},{command},{50 + command},{50 - command}\n")
    return "t,x,u,pa,pb\n" + "".join(rows)


EDS = (*examples("device_profiles", "*.eds"), *examples("device_profiles/imitations", "*.eds"))
MAPS = (
    "t=time:s\nx=position:mm\nu=spool_setpoint:V\npa=P_A:bar\npb=P_B:bar",
    "t=time:s\nx=-position:mm\nu=spool_setpoint:%\npa=P_A:bar\npb=P_B:kPa",
)


def lay_out(folder: Path) -> None:
    """Make the folders of the seeds below a folder, with what the seeds name."""
    (folder / "device_profiles").symlink_to(REPOSITORY / "device_profiles")
    for path in sorted((REPOSITORY / "examples").rglob("*")):
        place = folder / path.relative_to(REPOSITORY)
        if path.suffix in {".toml", ".dbc", ".csv", ".eds", ".py"}:
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, place)
    for name in ("", "machines", "scenarios", "plugin"):
        _lay_beside(folder / "examples" / name)


def _lay_beside(place: Path) -> None:
    """Write the files that verbs read beside a generated one."""
    for name, text in {
        "seed.scenario.toml": SCENARIO,
        "steps.scenario.toml": STEPS,
        "with_course.scenario.toml": WITH_COURSE,
        "requirements.toml": REQUIREMENTS,
        "recording.csv": recording(),
        "measured.csv": measured(),
        "columns.toml": COLUMNS,
        "frames.log": LINES,
        "with_map.toml": WITH_MAP,
        "with_eds.toml": WITH_EDS,
        "with_dbc.toml": WITH_DBC,
    }.items():
        (place / name).write_text(text, encoding="utf-8")


def install_plugin(root: Path) -> None:
    """Install the distribution of `examples/plugin` for this process."""
    folder = root / "examples" / "plugin"
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    metadata = folder / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    metadata.mkdir()
    head = f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    (metadata / "METADATA").write_text(head)
    groups = (
        f"[{group}]\n" + "".join(f"{name} = {place}\n" for name, place in points.items())
        for group, points in project["entry-points"].items()
    )
    (metadata / "entry_points.txt").write_text("\n".join(groups))
    sys.path.insert(0, str(folder))


def shorten(document: dict[str, object]) -> None:
    """Cap what decides how long a verb runs."""
    given = document.get("duration_s")
    if isinstance(given, float | int) and given > _SHORTEST:
        document["duration_s"] = _SHORTEST
    steps = document.get("step")
    for step in steps if isinstance(steps, list) else ():
        for name in ("at_s", "for_s", "over_s") if isinstance(step, dict) else ():
            if isinstance(step.get(name), float) and _SHORTEST < step[name] < 1e3:
                step[name] = step[name] % _SHORTEST


def lay_scenario(path: Path, document: Mapping[str, object]) -> None:
    """Write the scenario on a bench beside it, on the first of its axes."""
    plants = document.get("plant")
    axis = next(iter(plants), "axis1") if isinstance(plants, dict) else "axis1"
    path.write_text(ON_BENCH.replace("axis1", json.dumps(axis)[1:-1]), encoding="utf-8")
