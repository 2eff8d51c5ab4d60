"""Each known defect is there: a check shows it, and fails when it is gone.

Every evidence pack carries the list, so an entry that is no longer true misleads an assessor.
"""

import re
import tomllib
from dataclasses import replace

import can
import pytest
from support.bus_side import BusSide, valve_command
from support.documents import ROOT

from hil_bench import ConfigError, VirtualBench
from hil_bench.abilities.evidence.content import classification, known_defects
from hil_bench.bench.configuration import OverrunPolicy, load_config
from hil_bench.devices.position_control import POSITION
from hil_bench.devices.pressure_control import PRESSURE, PRESSURE_AND_FLOW
from hil_bench.devices.valve_408 import SPOOL
from hil_bench.outside.realtime.clock import VirtualClock
from hil_bench.outside.realtime.pacer import Pacer
from hil_bench.outside.realtime.statistics import TickStatistics
from hil_bench.plants.hydraulic_cylinder.model import (
    EntrainedAir,
    FullOrderPlant,
    PlantInput,
    PlantOptions,
    PlantState,
    Solver,
    paper_parameters,
)

DEFAULT = Solver.LINEARLY_IMPLICIT_MIDPOINT
AT_REST = PlantState(0.0, 0.0, 5e5, 5e5, 0.0, 0.0)
HALF_OPEN, ENABLE, STORED = 8192, 7, 0x60
OUT_OF_RANGE = {bytes.fromhex("30000906"), bytes.fromhex("31000906"), bytes.fromhex("32000906")}
"""Abort codes of CiA 301 for a value, one too high, one too low; little endian."""


def place_after_a_step(solver, dt):
    plant = FullOrderPlant(paper_parameters(), options=PlantOptions.bench(), solver=solver, dt=dt)
    return plant.step(PlantInput(1e-3), round(0.2 / dt)).x


def the_error_is_not_bounded():
    """A coarser step makes it larger, which a bound would forbid."""
    exact = place_after_a_step(Solver.RUNGE_KUTTA, 5e-6)
    fine, coarse = (abs(place_after_a_step(DEFAULT, dt) - exact) for dt in (5e-5, 5e-4))
    assert coarse > 2.0 * fine > 0.0


def the_plant_lacks_temperatures_and_a_tank_pressure():
    """An axis without a tank of oil shows no temperature, and no axis a pressure of the tank."""
    keys = {"supply": "unit", "oil": "HLP 46"}
    with VirtualBench(load_config(tables={"plant": {"axis1": keys}})) as bench:
        bench.run(0.01)
        names = {name.partition(".")[2] for name in bench.signals.dtype.names}
    assert {"P_A", "P_B", "P_S"} <= names
    assert names.isdisjoint({"T_oil", "P_T", "P_A_valve"})
    with pytest.raises(ConfigError, match="tank_volume_l: unknown key"):
        load_config(tables={"plant": {"axis1": keys | {"tank_volume_l": 60}}})


def place_of_rest_moves(solver):
    """The shift [m] that one pull of 60 kN leaves, the valve closed, with 2 % of air."""
    air = EntrainedAir(air_fraction=0.02, air_exponent=1.4)
    options = replace(PlantOptions.bench(), air=air)
    plant = FullOrderPlant(
        paper_parameters(), options=options, solver=solver, dt=5e-5, state=AT_REST
    )
    before = plant.step(PlantInput(0.0, 0.0), 20_000).x
    plant.step(PlantInput(0.0, -60e3), 10_000)
    return abs(plant.step(PlantInput(0.0, 0.0), 40_000).x - before)


def forward_euler_drifts_near_vacuum():
    """0.7 mm here, of a millimetre that the entry says; the default stays below 0.03 mm."""
    assert place_of_rest_moves(Solver.FORWARD_EULER) > 0.3e-3
    assert place_of_rest_moves(DEFAULT) < 0.03e-3


def the_bus_has_no_bit_timing_and_no_device_speaks_fd():
    """A SDO upload of 0x1000 by CAN FD is not answered."""
    with VirtualBench(load_config(tables={"bus": {"fd": True}})) as bench:
        bench.run(0.01)
        request = bytes.fromhex("4000100000000000")
        bench.bus.send(
            can.Message(arbitration_id=0x601, data=request, is_fd=True, is_extended_id=False)
        )
        bench.run(0.05)
        assert all(logged.frame.can_id != 0x581 for logged in bench.frames)
    with pytest.raises(ConfigError, match="sample_point: unknown key"):
        load_config(tables={"bus": {"wire": {"sample_point": 0.875}}})


def the_valve_refuses_these_modes():
    """A valve with all its sensors takes the four modes that README names, and aborts 7, 13, 14."""
    sensors = {"pressure_source": "P_A", "pressure_bar": 200.0, "position_source": "position"}
    valve = {"profile": "valve_408", "node_id": 1, **sensors}
    bus = BusSide(load_config(tables={"nodes": {"valve": valve}}))
    bus.tick(count=20)
    answers = {mode: bus.download(1, 0x6043, 0, bytes([mode])) for mode in range(1, 128)}
    taken = {mode for mode, answer in answers.items() if answer[0] == STORED}
    assert taken == {SPOOL, PRESSURE, PRESSURE_AND_FLOW, POSITION}
    assert {answers[mode][4:8] for mode in answers.keys() - taken} <= OUT_OF_RANGE
    assert taken.isdisjoint({7, 13, 14})


def a_late_tick_is_counted_and_not_prevented():
    """The machine stops for 5 ms where ticks are due each millisecond."""
    clock, statistics = VirtualClock(), TickStatistics()
    pacer = Pacer(clock, 1_000_000, overrun=OverrunPolicy.SKIP, statistics=statistics)
    pacer.wait()
    pacer.done()
    clock.advance(5_000_000)
    pacer.wait()
    pacer.done()
    assert statistics.overruns + statistics.skipped > 0


def a_pack_says_that_it_is_no_certificate():
    assert any("not a certificate" in line for line in classification()["is_not"])


def only_linux_is_classified():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    systems = {line for line in project["classifiers"] if line.startswith("Operating System")}
    assert systems == {"Operating System :: POSIX :: Linux"}


def the_valve_goes_on_without_its_controller():
    """Two seconds after the last frame its spool is where the set-point put it: 50 % of 1.3 mm."""
    bus = BusSide()
    bus.tick(count=20)
    bus.nmt(1)
    for _ in range(50):
        bus.tick(valve_command(6, 0))
        bus.tick(valve_command(ENABLE, HALF_OPEN))
    bus.tick(count=2000)
    assert bus.plant.output.nu == pytest.approx(0.65e-3, rel=1e-3)


CHECKS = {
    "KD-1": the_error_is_not_bounded,
    "KD-2": the_plant_lacks_temperatures_and_a_tank_pressure,
    "KD-3": forward_euler_drifts_near_vacuum,
    "KD-4": the_bus_has_no_bit_timing_and_no_device_speaks_fd,
    "KD-5": the_valve_refuses_these_modes,
    "KD-6": a_late_tick_is_counted_and_not_prevented,
    "KD-7": a_pack_says_that_it_is_no_certificate,
    "KD-8": only_linux_is_classified,
    "KD-9": the_valve_goes_on_without_its_controller,
}


PROFILES = {
    "Valve": ["valve_408"],
    "Pressure": ["pressure_404", "transducer_404"],
    "Encoder": ["encoder_406", "encoder_redundant_406"],
    "All": ["valve_408", "pressure_404", "encoder_406", "rotary_encoder_406", "drive_402"],
}
"""By the words with which the entries of docs/devices.md begin."""


def test_the_devices_have_no_object_of_which_the_documents_say_so():
    text = (ROOT / "docs" / "devices.md").read_text(encoding="utf-8")
    section = text.split("## What is not emulated")[1].split("\n## ")[0]
    entries = dict(re.findall(r"^- (\w+): (.*?)(?=^- |\Z)", section, re.DOTALL | re.MULTILINE))
    assert entries.keys() == PROFILES.keys()
    for word, entry in entries.items():
        absent = re.findall(r"0x([0-9A-F]{4})", re.sub(r"except [^,;.]*", "", entry))
        for profile in PROFILES[word]:
            eds = (ROOT / "device_profiles" / f"{profile}.eds").read_text(encoding="utf-8")
            there = set(re.findall(r"^\[([0-9A-Fa-f]{4})\]", eds, re.MULTILINE))
            assert "1000" in there
            assert there.isdisjoint(absent), profile


def test_each_entry_has_a_check():
    assert [defect["id"] for defect in known_defects()] == list(CHECKS)


@pytest.mark.parametrize("check", CHECKS.values(), ids=CHECKS)
def test_a_known_defect_is_still_there(check):
    check()


# The documents show what a pack says.


@pytest.mark.parametrize("defect", known_defects(), ids=lambda defect: defect["id"])
def test_the_documents_show_each_known_defect(defect):
    cells = [defect[key] for key in ("id", "subject", "text", "consequence", "remedy")]
    lines = (ROOT / "docs" / "known-defects.md").read_text(encoding="utf-8").splitlines()
    assert f"| {' | '.join(cells)} |" in lines


def test_the_documents_show_no_other_defect():
    text = (ROOT / "docs" / "known-defects.md").read_text(encoding="utf-8")
    assert text.count("| KD-") == len(known_defects())


def test_the_template_says_what_it_is_not_and_leaves_room():
    notes = classification()
    assert any("not a certificate" in line for line in notes["is_not"])
    assert all(note["to_fill_in"] for note in notes["note"])
    standards = {note["standard"].split(":")[0] for note in notes["note"]}
    assert {"ISO 26262-8", "IEC 61508-3"} <= standards
