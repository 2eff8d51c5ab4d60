"""Sound files to begin with: those of `examples`, by dialect, and the verbs that read each."""

import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple

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
"""
SHEET = """title,T
duration_s,0.02
parameter,high_bar,60,40,90
expect,R1,always axis1.P_A < high_bar + 200 bar
time_s,valve.spool_setpoint,fault:drop_supply axis1 pressure_bar
0.005,0.2,high_bar
0.01,-> 0.1 over 0.005,
"""
OTHER_BENCH = '[modbus.units.pressure_a]\nregisters = "generated.toml"\n'


class Dialect(NamedTuple):
    """A sort of file.

    Attributes:
        suffix: of its files.
        verbs: words of each verb that reads it; ``{}`` is the file.
        seeds: sound files: their folder below the repository, and their text.
    """

    suffix: str
    verbs: tuple[tuple[str, ...], ...]
    seeds: tuple[tuple[str, str], ...]


def _examples(folder: str, pattern: str) -> Iterator[tuple[str, str]]:
    for path in sorted((REPOSITORY / folder).glob(pattern)):
        yield folder, path.read_text(encoding="utf-8")


def _benches() -> Iterator[tuple[str, str]]:
    strangers = {"commissioning.toml", "network.toml"}
    for path in sorted((REPOSITORY / "examples").glob("*.toml")):
        if path.name not in strangers:
            yield "examples", path.read_text(encoding="utf-8")
    for folder, text in _examples("examples/machines", "*.toml"):
        if "[[expect]]" not in text:
            yield folder, text


def _recording() -> str:
    rows = (f"{n / 1000},{0.1 * n / 100},{5e6},{4e6},0.1,0.1\n" for n in range(60))
    return _RECORDING + "s,m,Pa,Pa,-,-\n" + "".join(rows)


def _measured() -> str:
    rows = (f"{n / 1000},{n / 10},{n % 10}\n" for n in range(60))
    return "t,x,u\n" + "".join(rows)


DIALECTS: Final[Mapping[str, Dialect]] = {
    "bench": Dialect(
        ".toml",
        (
            ("check", "{}"),
            ("check", "{}", "--json"),
            ("devices", "{}"),
            ("devices", "{}", "--json"),
            ("registers", "{}"),
            ("registers", "{}", "--csv"),
            ("bus-load", "{}", "--simulate", "0.01"),
            ("explain", "frames.log", "{}"),
            ("decode", "frames.log", "{}"),
            ("scenario", "check", "on_generated.scenario.toml"),
            ("test", "on_generated.scenario.toml"),
        ),
        tuple(_benches()),
    ),
    "network": Dialect(
        ".toml", (("boot", "--virtual", "--network", "{}"),), (*_examples("examples", "network.*"),)
    ),
    "plan": Dialect(
        ".toml",
        (("commission", "{}", "--virtual", "--json", "--output", "out"),),
        (
            (
                "examples",
                PLAN,
            ),
        ),
    ),
    "scenario": Dialect(
        ".scenario.toml",
        (
            ("scenario", "check", "{}"),
            ("scenario", "list", "{}"),
            ("test", "{}"),
            ("test", "{}", "--json"),
            ("judge", "{}", "recording.csv"),
        ),
        (("examples", SCENARIO), *_examples("examples/scenarios", "*.scenario.toml")),
    ),
    "campaign": Dialect(
        ".toml", (("campaign", "{}", "--jobs", "1", "--runs", "2"),), (("examples", CAMPAIGN),)
    ),
    "requirements": Dialect(
        ".toml", (("judge", "{}", "recording.csv"),), (("examples", REQUIREMENTS),)
    ),
    "register map": Dialect(
        ".toml", (("registers", "with_map.toml"),), (("examples", REGISTER_MAP),)
    ),
    "columns": Dialect(
        ".toml", (("identify", "measured.csv", "--columns", "{}"),), (("examples", COLUMNS),)
    ),
    "scenario sheet": Dialect(
        ".csv",
        (("scenario", "check", "{}"), ("scenario", "list", "{}"), ("test", "{}")),
        (("examples", SHEET),),
    ),
    "recording": Dialect(
        ".csv",
        (
            ("judge", "requirements.toml", "{}"),
            ("replay", "{}", "--virtual"),
            ("plot", "{}", "-o", "out.png"),
        ),
        (("examples", _recording()),),
    ),
}
"""Every dialect that a verb reads."""


def lay_out(folder: Path) -> None:
    """Make the folders of the seeds below a folder, with what the seeds name."""
    (folder / "device_profiles").symlink_to(REPOSITORY / "device_profiles")
    for path in sorted((REPOSITORY / "examples").rglob("*")):
        place = folder / path.relative_to(REPOSITORY)
        if path.is_dir():
            place.mkdir(parents=True, exist_ok=True)
        elif path.suffix in {".toml", ".dbc", ".csv"}:
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, place)
    examples = folder / "examples"
    played = SCENARIO.replace('title = "T"', 'title = "T"\nbench = "generated.toml"')
    for place in (examples, examples / "machines", examples / "scenarios"):
        (place / "seed.scenario.toml").write_text(SCENARIO)
        (place / "on_generated.scenario.toml").write_text(played)
        (place / "requirements.toml").write_text(REQUIREMENTS)
        (place / "recording.csv").write_text(_recording())
        (place / "measured.csv").write_text(_measured())
        (place / "frames.log").write_text("(0.001000) can0 181#0102\n(0.002000) can0 080#\n")
        (place / "with_map.toml").write_text(OTHER_BENCH)


def shorten(document: dict[str, object]) -> None:
    """Cap what decides how long a verb runs."""
    for name in ("duration_s", "timeout_s"):
        given = document.get(name)
        if isinstance(given, float | int) and given > _SHORTEST and name == "duration_s":
            document[name] = _SHORTEST
    for step in document.get("step") or ():  # type: ignore[attr-defined]
        for name in ("at_s", "for_s", "over_s") if isinstance(step, dict) else ():
            if isinstance(step.get(name), float) and _SHORTEST < step[name] < 1e3:
                step[name] = step[name] % _SHORTEST
