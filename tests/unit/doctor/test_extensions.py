"""The kinds that other distributions bring, as `hil-bench doctor` lists them."""

import importlib
import json

from support.distribution import declare

from hil_bench.abilities.doctor.machine import Verdict, absent, good
from hil_bench.abilities.doctor.verbs import examine_extensions
from hil_bench.cli import main
from hil_bench.devices.kinds.registry import KINDS
from hil_bench.plants.registry import PLANTS

SPRING = """
from hil_bench.plants.hydraulic_cylinder.kind import HydraulicCylinder
class Spring(HydraulicCylinder):
    name = "spring"
KIND = Spring()
"""


def install(site):
    """Put a plant that works and a device that does not onto the path."""
    (site / "spring.py").write_text(SPRING)
    (site / "stick.py").write_text("raise RuntimeError('no\\nlicence')")
    declare(site, "spring-maker", "2.0", {PLANTS.group: {"spring": "spring:KIND"}})
    declare(site, "stick-maker", "1.5", {KINDS.group: {"stick": "stick:KIND"}})
    importlib.invalidate_caches()


def test_each_is_listed_with_its_distribution_and_whether_it_loads(site):
    install(site)
    stick, spring = examine_extensions().findings
    assert spring == good("spring", "kind of plant, spring-maker 2.0")
    assert (stick.name, stick.verdict) == ("stick", Verdict.MISSING)
    assert stick.value == "kind of device, stick-maker 1.5, not loaded"
    assert stick.advice == (
        'stick-maker 1.5: hil_bench.kinds: "stick" (stick:KIND) cannot be imported: '
        "RuntimeError: no licence"
    )


def test_without_any_it_says_so(site):
    assert list(site.iterdir()) == []
    assert examine_extensions().findings == (absent("kinds", "none installed"),)


def test_the_verb_reports_them(site, capsys):
    install(site)
    assert main(["doctor", "--json", "--seconds", "0"]) == 0
    found = {item["name"]: item for item in json.loads(capsys.readouterr().out)["findings"]}
    assert found["spring"]["topic"] == found["stick"]["topic"] == "Extensions"
    assert (found["spring"]["verdict"], found["stick"]["verdict"]) == ("good", "missing")


def test_a_kind_of_fault_is_among_them(spring_rig):  # noqa: ARG001 - is installed
    assert good("fatigue", "kind of fault, spring-rig 1.0") in examine_extensions().findings


CONTROLLER = """
from hil_bench import ControllerKind

class Metronome(ControllerKind):
    name, summary = "metronome", "SYNC"

    def problems(self, settings, folder):
        return ()

    def build(self, settings, surroundings):
        raise NotImplementedError

METRONOME = Metronome()
"""


def test_a_kind_of_controller_is_among_them(site):
    (site / "metronome.py").write_text(CONTROLLER, encoding="utf-8")
    declared = {"hil_bench.abilities.controllers": {"metronome": "metronome:METRONOME"}}
    declare(site, "beats", "3.0", declared)
    importlib.invalidate_caches()
    assert good("metronome", "kind of controller, beats 3.0") in examine_extensions().findings
