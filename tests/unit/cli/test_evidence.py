"""`hil-bench evidence`: the whole pack, made and verified."""

import hashlib
import json
from dataclasses import replace

import pytest
from support.documents import ROOT
from support.tables import from_text

from hil_bench import VirtualBench, load_config
from hil_bench.abilities.analysis import closed_forms
from hil_bench.abilities.analysis.validation import validate
from hil_bench.abilities.conformance.check import Impact
from hil_bench.abilities.conformance.suite import CHAPTERS, Outcome, Result
from hil_bench.abilities.evidence import pack
from hil_bench.abilities.evidence.content import classification, page_html
from hil_bench.abilities.evidence.pack import examine_software
from hil_bench.abilities.faults.section import FaultsPart
from hil_bench.cli import main
from hil_bench.plants.hydraulic_cylinder.model import FullOrderPlant

RESULTS = {
    "<b>a</b>.scenario.toml": {
        "requirement_ids": ["SRS-1"],
        "problem": "",
        "findings": [
            {
                "id": "SRS-1",
                "that": "always axis1.P_A < 250 bar",
                "judgement": {"outcome": "passed", "deciding": None, "reason": ""},
            }
        ],
    }
}


EMPTY = {
    "summary": [],
    "software": examine_software(load_config()),
    "plant": [],
    "determinism": {"verdict": "passed", "length_s": 1.0, "runs": []},
    "timing": {"lateness": []},
    "traceability": {"files": []},
    "known_defects": [],
    "classification": classification(),
}


WHOLE = pytest.mark.long
"""For tests of a whole pack, which takes five seconds of a processor."""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A whole pack, made once."""
    folder = tmp_path_factory.mktemp("evidence")
    results = folder / "results.json"
    results.write_text(json.dumps(RESULTS), encoding="utf-8")
    pack = folder / "pack"
    bench = folder / "bench.toml"  # one device, so that the suite of conformance is short
    bench.write_text('[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n', encoding="utf-8")
    arguments = [str(pack), str(bench), "--seconds", "0", "--results", str(results)]
    assert main(["-q", "evidence", *arguments]) == 0
    return pack


def content_of(pack):
    return json.loads((pack / "evidence.json").read_text(encoding="utf-8"))


@WHOLE
def test_a_sound_installation_passes(made):
    verdicts = {line["section"]: line["verdict"] for line in content_of(made)["summary"]}
    assert verdicts == dict.fromkeys(
        ("plant", "conformance", "determinism", "traceability"), "passed"
    )


@WHOLE
def test_the_page_needs_nothing_from_elsewhere_and_shows_names_as_text(made):
    page = (made / "index.html").read_text(encoding="utf-8")
    assert "default-src 'none'" in page
    assert "http://" not in page
    assert "https://" not in page
    assert "&lt;b&gt;a&lt;/b&gt;.scenario.toml" in page
    assert "It is not a certificate" in page
    assert "KD-1" in page


@WHOLE
def test_the_pack_verifies_until_a_file_is_touched(made, capsys, cli):
    assert main(["evidence", "--verify", str(made)]) == 0
    capsys.readouterr()
    page = made / "index.html"
    whole = page.read_bytes()
    page.write_bytes(whole.replace(b"passed", b"Passed", 1))
    assert cli(["evidence", "--verify", str(made)], 1).out == f"{made}/index.html: was changed\n"
    page.write_bytes(whole)


@WHOLE
def test_the_runs_agree_and_another_seed_does_not(made, make_file):
    found = content_of(made)["determinism"]
    (digest,) = {run["digest"] for run in found["runs"]}
    assert found["runs"][0]["rows"] == 1010  # 1.01 s at 1 kHz
    noisy = make_file("bench.toml", (ROOT / "examples" / "real_sensors.toml").read_bytes())
    traces = {pack.run_once(noisy, seed) for seed in (1, 1, 2)}
    assert len(traces) == 2
    assert digest not in {trace.digest for trace in traces}


def test_the_run_of_the_determinism_moves_the_axis(monkeypatch):
    benches = []

    def keep(config):
        benches.append(VirtualBench(config))
        return benches[-1]

    monkeypatch.setattr(pack, "VirtualBench", keep)
    pack.run_once(None, 1)
    positions = benches[0].signals["axis1.position"]
    assert positions.max() - positions.min() > 0.02


@WHOLE
def test_the_inputs_are_in_the_pack(made):
    assert json.loads((made / "inputs" / "results-1.json").read_bytes()) == RESULTS
    software = content_of(made)["software"]
    assert [each["file"] for each in software["inputs"]] == ["bench.toml", "valve_408.eds"]
    text = (made / "inputs" / "bench.toml").read_bytes()
    assert software["inputs"][0]["sha256"] == hashlib.sha256(text).hexdigest()
    assert "numpy" in software["libraries"]


@pytest.fixture
def quick(monkeypatch):
    """Leave out what the test does not look at."""
    monkeypatch.setattr("hil_bench.abilities.evidence.pack.examine_devices", lambda _config: [])
    monkeypatch.setattr("hil_bench.abilities.evidence.verbs.validate", lambda _axes, _dt: iter(()))
    trace = pack.Trace("0" * 64, 1, 1)
    monkeypatch.setattr(pack, "run_once", lambda _path, _seed: trace)
    monkeypatch.setattr(pack, "ProcessPoolExecutor", SameProcess)


class SameProcess:
    """An executor that is none."""

    def __init__(self, *_arguments):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *_error):
        pass

    def submit(self, function, *arguments):
        return Done(function(*arguments))


class Done:
    def __init__(self, value):
        self.result = lambda: value


@pytest.mark.usefixtures("quick")
def test_a_wrong_plant_is_shown_as_failed(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr("hil_bench.abilities.evidence.verbs.validate", validate)

    def wider(parameters, **rest):
        return FullOrderPlant(replace(parameters, C_d=0.66), **rest)

    monkeypatch.setattr(closed_forms, "FullOrderPlant", wider)
    assert main(["evidence", str(tmp_path / "pack"), "--seconds", "0"]) == 1
    assert "plant          failed" in capsys.readouterr().out
    assert main(["-q", "evidence", "--verify", str(tmp_path / "pack")]) == 0
    page = (tmp_path / "pack" / "index.html").read_text(encoding="utf-8")
    assert '<tr class="wrong">' in page
    assert '<span class="outcome failed">failed</span>' in page


def test_a_device_that_breaks_a_clause_is_shown_as_failed(monkeypatch):
    (check, *_) = CHAPTERS[0].checks
    broken = Result("NMT", check, Outcome.FAILED, "no boot-up message")
    monkeypatch.setattr(pack, "run_suite", lambda _dut, _allowed: [broken])
    found = [device.content for device in pack.examine_devices(load_config())]
    assert [device["verdict"] for device in found] == ["failed"] * 4
    page = page_html({**EMPTY, "conformance": found})
    assert "no boot-up message" in page


def test_faults_of_the_bench_do_not_count_against_its_devices(monkeypatch):
    config = load_config(ROOT / "examples" / "faults.toml")
    assert config.of(FaultsPart).faults
    benches = []

    def keep(sound):
        benches.append(sound)
        return VirtualBench(sound)

    monkeypatch.setattr(pack, "VirtualBench", keep)
    monkeypatch.setattr(pack, "run_suite", lambda _dut, _allowed: [])
    pack.examine_devices(config)
    assert [sound.of(FaultsPart).faults for sound in benches] == [()] * 4


@pytest.mark.parametrize(("storage", "allowed"), [("", Impact.STORE), ('"kept"', Impact.WRITE)])
def test_stored_parameters_are_not_overwritten(monkeypatch, tmp_path, storage, allowed):
    (tmp_path / "kept").mkdir()
    line = f"storage = {storage}\n" if storage else ""
    text = f'[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n{line}'
    (tmp_path / "bench.toml").write_text(text, encoding="utf-8")
    asked = []
    monkeypatch.setattr(pack, "run_suite", lambda _dut, most: asked.append(most) or [])
    pack.examine_devices(load_config(tmp_path / "bench.toml"))
    assert asked == [allowed]


@pytest.mark.usefixtures("quick")
def test_a_run_that_differs_is_shown_as_failed(monkeypatch, tmp_path, cli):
    digests = iter("123")
    monkeypatch.setattr(pack, "run_once", lambda _path, _seed: pack.Trace(next(digests), 1, 1))
    folder = str(tmp_path / "pack")
    cli(["-q", "evidence", folder, "--seconds", "0"], 1)
    whole = f"{folder}: every file is as the manifest has it\n"
    assert cli(["evidence", "--verify", folder]).out == whole


def test_without_jinja2_it_is_one_line(monkeypatch, tmp_path, cli):
    monkeypatch.setattr("hil_bench.abilities.evidence.verbs.find_spec", lambda _name: None)
    said = cli(["evidence", str(tmp_path / "pack")], 2).err
    assert said == "hil-bench: error: evidence needs Jinja2: pip install 'hil-bench[report]'\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(
    ("content", "code"),
    [
        (json.dumps(RESULTS), 0),
        (json.dumps(RESULTS).replace('"passed"', '"failed"'), 1),
        (json.dumps(RESULTS).replace('"passed"', '"inconclusive"'), 6),
        (json.dumps(RESULTS).replace('"passed"', '"not exercised"'), 6),
        ("{}", 6),
        ('<testsuite><testcase name="names no requirement"/></testsuite>', 6),
    ],
)
def test_the_exit_code_is_that_of_the_requirements(tmp_path, make_file, content, code):
    results = make_file("results", content)
    pack = ["evidence", str(tmp_path / "pack"), "--seconds", "0", "--results", str(results)]
    assert main(["-q", *pack]) == code


@from_text("arguments", "message")
def test_what_is_wrong_is_said_before_anything_runs(tmp_path, cli, arguments, message):
    assert message in cli(["evidence", str(tmp_path / "pack"), *arguments.split()], 2).err
    assert list(tmp_path.iterdir()) == []
