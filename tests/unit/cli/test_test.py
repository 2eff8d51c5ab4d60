"""`hil-bench test`, on the worked examples and on what is wrong."""

import json
import pickle
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from support.programs import needs_compiler

from hil_bench.abilities.campaign.records import RunOutcome
from hil_bench.abilities.scenario.run import play
from hil_bench.cli import main
from hil_bench.cli.exit_codes import ExitCode

EXAMPLES = Path(__file__).parents[3] / "examples" / "scenarios"
VARIANTS = {
    "broken_wire": ("checks_sensor=0", "SRS-21"),
    "emergency_stop": ("restarts=1", "SRS-41"),
    "broken_lever": ("lever_percent=30", "SRS-70"),
    "end_stop": ("speed_mm_s=280", "SRS-51"),
    "heartbeat_loss": ("heartbeat_timeout_ms=0", "SRS-30"),
    "scripted_nodes": ("demand=4000", "IO-3"),
    "settling": ("position_gain=250", "SRS-1"),
    "supply_sag": ("position_gain=0.5", "SRS-11"),
}
"""Of each example, what makes its controller a bad one, and a requirement that finds it out."""

HEAD = 'title = "T"\nduration_s = 0.02\n'


def scenario(tmp_path, that, more=""):
    path = tmp_path / "a.scenario.toml"
    path.write_text(f"{HEAD}{more}[[expect]]\nid = \"R1\"\nthat = '{that}'\n")
    return str(path)


def test_there_is_a_variant_of_each_example():
    names = {path.name.removesuffix(".scenario.toml") for path in EXAMPLES.iterdir()}
    assert names == VARIANTS.keys()


@pytest.mark.parametrize("name", VARIANTS)
def test_an_example_passes_and_its_variant_fails(name, capsys):
    path = str(EXAMPLES / f"{name}.scenario.toml")
    assert main(["test", path]) == ExitCode.DONE, capsys.readouterr().out
    capsys.readouterr()
    given, found_out = VARIANTS[name]
    assert main(["test", path, "--set", given, "--json"]) == ExitCode.CHECK_FAILED
    (result,) = json.loads(capsys.readouterr().out).values()
    outcomes = {each["id"]: each["judgement"] for each in result["findings"]}
    assert outcomes[found_out]["outcome"] == "failed"


@pytest.mark.parametrize(
    ("that", "code"),
    [
        ("always axis1.P_A < 250 bar", ExitCode.DONE),
        ("always axis1.P_A < 1 bar", ExitCode.CHECK_FAILED),
        ("whenever axis1.P_A > 250 bar then axis1.P_B > 1 bar", ExitCode.INCONCLUSIVE),
    ],
)
def test_the_exit_code_is_the_worst_outcome(tmp_path, cli, that, code):
    assert cli(["test", scenario(tmp_path, that)], code).out.splitlines()[1].startswith("  R1  ")


def test_a_folder_is_searched_and_k_chooses(tmp_path, cli):
    scenario(tmp_path, "always axis1.P_A < 250 bar")
    assert main(["test", str(tmp_path), "-k", "r1"]) == ExitCode.DONE
    assert "-k R2: no requirement" in cli(["test", str(tmp_path), "-k", "R2"], ExitCode.USAGE).err


def test_the_junit_file_has_requirements_and_margins(tmp_path):
    """P_A is in [0, 100] bar of the supply, so that 250 bar has a margin of 0.6 to 1."""
    path = scenario(tmp_path, "always axis1.P_A < 250 bar")
    assert main(["test", path, "--junit", str(tmp_path / "j.xml"), "-q"]) == ExitCode.DONE
    (case,) = ET.parse(tmp_path / "j.xml").iter("testcase")  # noqa: S314 - our own
    found = {each.get("name"): each.get("value") for each in case.iter("property")}
    assert found["requirement_id"] == "R1"
    assert 0.6 < float(found["margin"]) < 1.0
    assert found["seen"] == "1"
    assert case.find("failure") is None


def test_a_failure_stands_in_the_junit_file(tmp_path):
    path = scenario(tmp_path, "always axis1.P_A < 1 bar")
    main(["test", path, "--junit", str(tmp_path / "j.xml"), "-q"])
    (suite,) = ET.parse(tmp_path / "j.xml").getroot()  # noqa: S314 - our own
    assert (suite.get("tests"), suite.get("failures")) == ("1", "1")
    assert (suite.get("time"), suite.find("testcase").get("time")) == ("0.020", "0.020")
    assert suite.find("testcase/failure").get("message").startswith("failed: first violated at 0 s")


def test_a_junit_file_keeps_tabs_and_loses_what_xml_cannot_hold(tmp_path):
    path = scenario(tmp_path, "always axis1.P_A\t< 250 bar")  # as it is in TOML, too
    text = Path(path).read_text().replace('"T"', '"Bell\\u0007"')
    Path(path).write_text(text)
    assert main(["test", path, "--junit", str(tmp_path / "j.xml"), "-q"]) == ExitCode.DONE
    (suite,) = ET.parse(tmp_path / "j.xml").getroot()  # noqa: S314 - our own
    assert suite.get("name") == "Bell\ufffd"
    found = {each.get("name"): each.get("value") for each in suite.iter("property")}
    assert found["expectation"] == "always axis1.P_A\t< 250 bar"


def test_a_run_that_ends_at_a_failure_says_what_it_has_seen(tmp_path, capsys):
    """The run is looked at each 64 ticks, so that it ends early in 2 s."""
    path = tmp_path / "a.scenario.toml"
    texts = ("always axis1.P_A < 1 bar", "always axis1.P_B < 250 bar")
    tables = (f"[[expect]]\nid = 'R{n}'\nthat = '{text}'\n" for n, text in enumerate(texts))
    path.write_text('title = "T"\nduration_s = 2.0\n' + "".join(tables))
    junit = ["--junit", str(tmp_path / "j.xml")]
    assert main(["test", str(path), "--stop-at-failure", *junit]) == ExitCode.CHECK_FAILED
    failed, undecided = capsys.readouterr().out.splitlines()[1:]
    assert failed.endswith(" of 2 s")
    assert "inconclusive   nothing seen after 0.0" in undecided
    (_, case) = ET.parse(tmp_path / "j.xml").iter("testcase")  # noqa: S314 - our own
    assert case.find("failure").get("type") == "inconclusive"
    (seen,) = (p.get("value") for p in case.iter("property") if p.get("name") == "seen")
    assert 0.0 < float(seen) < 0.1


def test_a_junit_file_that_is_somebody_elses_is_refused_before_anything_is_played(tmp_path, cli):
    path = scenario(tmp_path, "always axis1.P_A < 250 bar")
    printed = cli(["test", path, "--junit", path], ExitCode.USAGE)
    assert "is there already, and not written by hil-bench" in printed.err
    assert not printed.out


def test_a_junit_file_without_a_folder_is_refused_before_anything_is_played(tmp_path, cli):
    path = scenario(tmp_path, "always axis1.P_A < 250 bar")
    found = cli(["test", path, "--junit", str(tmp_path / "no" / "j.xml")], ExitCode.USAGE)
    assert found.out == ""
    assert "there is no folder" in found.err


@pytest.mark.parametrize("option", ["--junit", "--report"])
def test_a_read_only_folder_is_refused_before_anything_is_played(
    option, tmp_path, cli, monkeypatch
):
    """Root may write into all folders but those of a read-only disk."""
    path = scenario(tmp_path, "always axis1.P_A < 250 bar")
    monkeypatch.setattr("os.access", lambda folder, _mode: Path(folder) != tmp_path)
    file = str(tmp_path / "result.html")
    found = cli(["test", path, option, file], ExitCode.USAGE)
    assert found.out == ""
    assert f"{option} {file}: its folder is read-only" in found.err


@pytest.mark.parametrize(
    ("controller", "wrong"),
    [
        ('firmware = ["/no/such"]', "/no/such: cannot be started: No such file"),
        ('kind = "program"\ncommand = ["/"]', "/: cannot be started: Permission denied"),
        ('kind = "process"\ncommand = ["/no/such"]', "/no/such: cannot be started: No such file"),
        ('kind = "library"\nlibrary = "/no/such.so"', "/no/such.so: there is no such library"),
        ('kind = "library"\nlibrary = "OWN"', "cannot be loaded: "),
        ('kind = "elf"\nprogram = "/no/such.elf"\nchip = "STM32F407"', "/no/such.elf: cannot be"),
        ('kind = "python"\ncall = "/no/such.py:step"', "/no/such.py: there is no such file"),
        ('kind = "fmu"\nfile = "/no/such.fmu"\noutputs = {}', "/no/such.fmu: cannot be read"),
    ],
)
def test_a_file_that_is_no_controller_is_bad_input_whatever_its_kind(
    controller, wrong, tmp_path, cli
):
    """docs/exit-codes.md: 2 for a file that is wrong, 1 for a controller that ran and failed."""
    head = f"[controller]\n{controller}\n".replace("OWN", str(tmp_path / "a.scenario.toml"))
    path = scenario(tmp_path, "always axis1.P_A < 250 bar", head)
    found = cli(["test", path], ExitCode.USAGE)
    assert wrong in found.out + found.err


@needs_compiler
@pytest.mark.parametrize("bench", ["", "[modbus]\n"])
def test_a_program_that_sends_nothing_exercises_nothing(tmp_path, cli, bench):
    """Frames of steps are not its own, and `test` serves no Modbus."""
    (tmp_path / "bench.toml").write_text(bench)
    more = 'bench = "bench.toml"\n[controller]\nkind = "program"\ncommand = ["sleep", "9"]\n'
    more += '[[step]]\nat_s = 0.01\nnmt = "start"\ntarget = "all"\n'
    path = scenario(tmp_path, "always axis1.P_A < 250 bar", more)
    found = cli(["test", path], ExitCode.INCONCLUSIVE)
    assert "R1  not exercised  the program has sent no frame" in found.out


@pytest.mark.parametrize(
    ("words", "wrong"),
    [
        (["--set", "x"], "--set x: write NAME=NUMBER"),
        (["--set", "load_n=inf"], "--set load_n=inf: is not finite; give a number"),
        (["--set", "x=1"], '"x" is not in [parameters]; add it there'),
    ],
)
def test_a_wrong_parameter_is_a_line(tmp_path, cli, words, wrong):
    path = scenario(tmp_path, "always axis1.P_A < 250 bar")
    assert wrong in cli(["test", path, *words], ExitCode.USAGE).err


def test_an_empty_folder_is_refused(tmp_path, cli):
    assert "holds no *.scenario.toml" in cli(["test", str(tmp_path)], ExitCode.USAGE).err


def test_ctrl_c_keeps_the_verdicts_of_scenarios_that_are_done(tmp_path, capsys, cli, monkeypatch):
    for name in "abc":
        (tmp_path / f"{name}.scenario.toml").write_text(
            f'{HEAD}[[expect]]\nid = "R-{name}"\nthat = "always axis1.P_A < 250 bar"\n'
        )

    def play_until_ctrl_c(prepared, options):
        if prepared.scenario.path.name.startswith("b"):
            # What is done has been printed already.
            assert "R-a  passed" in capsys.readouterr().out
            raise KeyboardInterrupt
        return play(prepared, options)

    monkeypatch.setattr("hil_bench.abilities.scenario.results.play", play_until_ctrl_c)
    junit = tmp_path / "result.xml"
    out = cli(["test", str(tmp_path), "--junit", str(junit)], ExitCode.INTERRUPTED).out
    assert "b.scenario.toml: T\n  interrupted\n" in out
    assert "R-c" not in out
    assert "R-a" in junit.read_text()


def several(tmp_path):
    """One scenario that passes, one that fails, one whose firmware cannot be started."""
    texts = {
        "a": ("always axis1.P_A < 250 bar", ""),
        "b": ("always axis1.P_A < 1 bar", ""),
        "c": ("always axis1.P_A < 250 bar", '[controller]\nfirmware = ["/no/such"]\n'),
    }
    for name, (that, more) in texts.items():
        expect = f"[[expect]]\nid = \"R-{name}\"\nthat = '{that}'\n"
        (tmp_path / f"{name}.scenario.toml").write_text(f"{HEAD}{more}{expect}")
    return str(tmp_path)


class Backwards:
    """A pool in this process that is done with the last task first."""

    def __init__(self, jobs, perform, failed):
        assert jobs == 2
        self.perform, self.failed = perform, failed

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def __call__(self, tasks):
        for task in reversed(pickle.loads(pickle.dumps(list(tasks)))):  # noqa: S301 - our own
            yield self.outcome(task)

    def outcome(self, task):
        return pickle.loads(pickle.dumps(self.perform(task)))  # noqa: S301 - our own


class Dying(Backwards):
    """The process that has the first task dies."""

    def outcome(self, task):
        if task.number:
            return super().outcome(task)
        return self.failed(task, RunOutcome.CRASHED, "its process was killed (SIGKILL)")


class Interrupted(Backwards):
    """Ctrl-C comes while the second task is under way, the third is done and the first is not."""

    def outcome(self, task):
        if task.number == 1:
            raise KeyboardInterrupt
        return super().outcome(task)


def faces(folder, out, capsys, *words, draws=False):
    """Return what `test` prints and writes for a folder, and its exit code."""
    out.mkdir(exist_ok=True)
    files = ["--junit", str(out / "j.xml"), *(["--report", str(out / "r.html")] * draws)]
    code = main(["test", folder, *files, *words])
    written = [path.read_bytes() for path in sorted(out.iterdir())]
    main(["test", folder, "--json", *words])
    said = capsys.readouterr()
    return code, said.out, said.err, written


def test_results_come_in_the_order_of_the_files_whoever_is_done_first(
    tmp_path, capsys, monkeypatch
):
    folder = several(tmp_path)
    serial = faces(folder, tmp_path / "out", capsys)
    monkeypatch.setattr("hil_bench.abilities.scenario.verbs.test.Pool", Backwards)
    assert faces(folder, tmp_path / "out", capsys, "--jobs", "2") == serial
    assert serial[0] == ExitCode.CHECK_FAILED


def test_a_process_that_dies_is_a_result(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("hil_bench.abilities.scenario.verbs.test.Pool", Dying)
    words = ["-k", "R-a", "-k", "R-", "--jobs", "2"]
    assert main(["test", several(tmp_path), *words]) == ExitCode.CHECK_FAILED
    first, problem, second = capsys.readouterr().out.splitlines()[:3]
    assert first.endswith("a.scenario.toml: T")
    assert problem == "  its process was killed (SIGKILL)"
    assert second.endswith("b.scenario.toml: T")


def test_ctrl_c_ends_all_and_keeps_what_is_done(tmp_path, cli, monkeypatch):
    monkeypatch.setattr("hil_bench.abilities.scenario.verbs.test.Pool", Interrupted)
    folder = several(tmp_path)
    (tmp_path / "c.scenario.toml").unlink()
    (tmp_path / "c.scenario.toml").write_text((tmp_path / "a.scenario.toml").read_text())
    lines = cli(["test", folder, "--jobs", "2"], ExitCode.INTERRUPTED).out.splitlines()
    assert [line.rpartition("/")[2] for line in lines[:3]] == [
        "a.scenario.toml: T",
        "  interrupted",
        "c.scenario.toml: T",
    ]


@pytest.mark.long  # processes start
def test_scenarios_in_processes_of_their_own_give_the_same_bytes(tmp_path, capsys):
    folder = several(tmp_path)
    serial = faces(folder, tmp_path / "out", capsys, draws=True)
    assert faces(folder, tmp_path / "out", capsys, "--jobs", "3", draws=True) == serial


def test_a_machine_plays_one_scenario_at_a_time(tmp_path, capsys):
    words = ["-i", "virtual", "-c", "x", "--plan", "plan.toml", "--jobs", "2"]
    assert main(["test", several(tmp_path), *words]) == ExitCode.USAGE
    assert "--jobs 2: a machine plays one scenario at a time" in capsys.readouterr().err


def test_a_requirement_that_is_named_and_not_judged_is_undecided(tmp_path, cli):
    """As the report, the JUnit file and `hil-bench evidence` have it; `-k` leaves it out."""
    named = 'requirement_ids = ["R1", "SRS-9"]\n'
    path, junit = scenario(tmp_path, "always axis1.P_A < 250 bar", named), tmp_path / "j.xml"
    out = cli(["test", path, "--junit", str(junit)], ExitCode.INCONCLUSIVE).out
    assert "  SRS-9  not judged     requirement_ids names it" in out
    (suite,) = ET.parse(junit).getroot()  # noqa: S314 - our own
    assert [suite.get(each) for each in ("tests", "failures", "skipped")] == ["2", "1", "0"]
    assert suite.find("testcase[@name='SRS-9']/failure").get("type") == "not exercised"
    out = cli(["test", path, "-k", "R1", "--junit", str(junit)], ExitCode.DONE).out
    assert "SRS-9" not in out + junit.read_text()
    out = cli(["run", "--scenario", path, "--speed", "inf"], ExitCode.INCONCLUSIVE).out
    assert "  SRS-9  not judged" in out
    failing = scenario(tmp_path, "always axis1.P_A < 1 bar", named)
    cli(["test", failing], ExitCode.CHECK_FAILED)
