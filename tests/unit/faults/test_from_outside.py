"""A kind of fault of another distribution (examples/plugin), wherever one of ours is taken."""

import importlib
import json
import math
import re

import pytest
from support.distribution import PLUGIN, declare
from support.feed_loop import FeedLoop
from support.tables import from_text

from hil_bench import ConfigError, Faults, RecordingWish, VirtualBench, load_config, run_campaign
from hil_bench.abilities.faults.registry import FAULT_KINDS
from hil_bench.abilities.live import ctl
from hil_bench.abilities.panel.bench_link import fault_choices
from hil_bench.abilities.recording.mdf_blocks import read_events
from hil_bench.abilities.scenario.verbs.scenario import scenario_schema
from hil_bench.cli import main

pytest_plugins = ["pytester"]
pytestmark = pytest.mark.usefixtures("spring_rig")

RIG = (
    (PLUGIN / "bench.toml")
    .read_text(encoding="utf-8")
    .partition("[modbus")[0]
    .replace("../../", f"{PLUGIN.parents[1]}/")
)
WEAK = '[[faults]]\nkind = "fatigue"\ntarget = "rig"\n'


def weak_swing(time):
    """m x'' + k x / 4 = 0 from 20 mm: k / 4 m = 250 N/m / 10 kg = (5 rad/s)²."""
    return 20e-3 * math.cos(5.0 * time)


@pytest.fixture
def write(tmp_path):
    """Return a function that writes the example's rig with more tables."""

    def write(more=""):
        path = tmp_path / "bench.toml"
        path.write_text(RIG + more, encoding="utf-8")
        return path

    return write


def test_a_file_has_it_and_its_recording_says_when(write, tmp_path):
    config = load_config(write(f"{WEAK}loss_percent = 75\nfor_s = 0.1\n"))
    path = tmp_path / "trace.mf4"
    with VirtualBench(config, record=RecordingWish((path,))) as bench:
        bench.run(0.1)
        assert bench.values["rig.position"] == pytest.approx(weak_swing(0.1), rel=1e-3)
        bench.run(0.05)
        assert bench.faults.active == ()
    (span,) = read_events(path)
    assert span.label == "fatigue rig"
    assert (span.begin, span.end) == pytest.approx((1e-3, 0.1))  # from the first tick on


@from_text("table", "wrong")
def test_what_is_wrong_is_said_as_of_ours(write, table, wrong):
    path = write(table)
    with pytest.raises(ConfigError, match=re.escape(wrong)):
        load_config(path)


def test_a_plant_without_the_defect_names_the_faults_that_it_has():
    config = load_config(faults=[{"kind": "leak", "target": "axis1", "leak_l_min_bar": 1}])
    with VirtualBench(config) as bench, pytest.raises(ConfigError) as caught:
        bench.faults.fatigue("axis1")
    has = "leak, aerate, wear_spool, jam"
    assert str(caught.value) == f"faults: axis1 cannot have fatigue; it can have {has}"


def test_it_is_a_verb_that_grows(write):
    with VirtualBench(load_config(write())) as bench:
        with bench.faults.fatigue("rig", 0.5, growth=0.1):
            bench.run(0.05)
            plant = bench.session.bench.axes[0].plant
            assert plant._stiffness == pytest.approx(1000.0 * (1.0 - 0.5 * 0.049 / 0.1))
        bench.run(1e-3)
        assert plant._stiffness == 1000.0


def test_a_shell_and_a_page_offer_it(write, monkeypatch, capsys):
    loop = FeedLoop(load_config(write()))
    monkeypatch.setattr(ctl, "connect", loop.connect)
    assert main(["ctl", "fault", "fatigue", "rig", "loss_percent=75", "for_s=1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"number": 1}
    loop.look_again()
    (fault,) = loop.session.bench.part(Faults).active
    assert (fault.kind, fault.target, fault.duration) == ("fatigue", "rig", 10**9)
    loss, growth, lasts = fault_choices(loop.connect().hello)["fatigue"]["rig"]
    assert (loss["words"], loss["unit"], loss["default"]) == ("loss", "%", 100.0)
    assert (growth["words"], lasts["words"]) == ("time to grow", "duration")


SCENARIO = """
title = "Swings slowly"
bench = "bench.toml"
duration_s = 0.2
[parameters]
loss_percent = {{ value = 75, range = [74, 76] }}
[[step]]
at_s = 0.0
fault = "fatigue"
target = "rig"
loss_percent = "loss_percent"
[[expect]]
id = "REQ-1"
that = "{that}"
"""


def test_a_scenario_and_a_campaign_take_it(write, make_file):
    write()
    titles = [step["title"] for step in scenario_schema()["properties"]["step"]["items"]["anyOf"]]
    assert "fault fatigue" in titles
    path = make_file("weak.scenario.toml", SCENARIO.format(that="rig.position > 10 mm"))
    table = run_campaign(path, runs=2, jobs=1)
    assert table["outcome"].tolist() == ["passed", "passed"]
    assert table["loss_percent"].nunique() == 2
    path.write_text(SCENARIO.format(that="rig.position < 10 mm"), encoding="utf-8")
    assert main(["test", str(path), "-q"]) == 1


def test_a_kind_that_cannot_be_used_is_a_line_that_names_its_distribution(site, write):
    (site / "broken.py").write_text("raise RuntimeError('no licence')", encoding="utf-8")
    declare(site, "maker-of-it", "2.5", {FAULT_KINDS.group: {"break": "broken:KIND"}})
    importlib.invalidate_caches()
    path = write('[[faults]]\nkind = "break"\ntarget = "rig"\n')
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    place = 'maker-of-it 2.5: hil_bench.faults: "break" (broken:KIND)'
    wrong = f"{path}:faults[1].kind: {place} cannot be imported: RuntimeError: no licence"
    assert str(caught.value) == wrong
    assert len(load_config().nodes) == 4  # whoever does not name it is not disturbed


FAILS = """
from hil_bench.abilities.faults.kind import fault_kind
from hil_bench.abilities.faults.points import PLANTS

@fault_kind(PLANTS)
def explode(axis):
    return 1 / 0
"""


def test_an_error_in_its_code_names_its_distribution(site, write, tmp_path, capsys):
    (site / "bomb.py").write_text(FAILS, encoding="utf-8")
    declare(site, "bomb", "0.1", {FAULT_KINDS.group: {"explode": "bomb:explode"}})
    importlib.invalidate_caches()
    write()
    path = tmp_path / "a.scenario.toml"
    step = 'fault = "explode"\ntarget = "rig"'
    text = SCENARIO.replace(
        'fault = "fatigue"\ntarget = "rig"\nloss_percent = "loss_percent"', step
    )
    path.write_text(text.format(that="rig.position > 0 mm"), encoding="utf-8")
    assert main(["test", str(path)]) == 70
    said = "hil-bench: error: bomb 0.1: ZeroDivisionError: division by zero; this is a bug, please"
    assert said in capsys.readouterr().err


def test_a_misspelt_name_of_a_plant_is_doubted(monkeypatch, write, capsys, cli):
    import spring_rig.mass_on_spring as plant  # noqa: PLC0415 - installed by the fixture

    path = write()
    assert cli(["check", str(path)]).err == ""
    monkeypatch.setattr(plant, "PICTURE", plant.PICTURE.replace('text="force"', 'text="forze"'))
    monkeypatch.setattr(
        plant.SpringConfig, "defects", (plant.Influence("lost_stifness", "-", 0.0, 1.0),)
    )
    assert main(["check", str(path)]) == 0
    place = f"hil-bench: warning: {path}:plant.rig: mass_on_spring"
    nearest = "the nearest that one makes is lost_stiffness"
    assert capsys.readouterr().err.splitlines() == [
        f'{place}: its page shows "forze", which is not recorded; the nearest is force',
        f'{place}: no kind of fault makes its defect "lost_stifness"; {nearest}',
    ]


def test_the_document_has_the_whole_of_it():
    document = (PLUGIN.parents[1] / "docs" / "plugins.md").read_text(encoding="utf-8")
    _, _, code = (PLUGIN / "spring_rig" / "fatigue.py").read_text(encoding="utf-8").split('"""', 2)
    assert f"```py\n{code.strip()}\n```" in document


def test_its_fixture_is_there_for_pytest(pytester, write):
    """Half a swing takes pi / 10 rad/s, with a quarter of the stiffness twice as long."""
    pytester.makepyfile(
        """
        import math
        import pytest

        def test_swing(half_swing, faults):
            assert half_swing() == pytest.approx(math.pi / 10.0, abs=2e-3)
            faults.fatigue("rig", 0.75)
            half_swing()
            assert half_swing() == pytest.approx(math.pi / 5.0, abs=2e-3)
        """
    )
    result = pytester.runpytest(f"--hil-config={write()}")
    result.assert_outcomes(passed=1)
