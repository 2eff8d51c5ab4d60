"""The frame of the command line: exit codes, error lines, quick start."""

import io
import logging
import os
import subprocess
import sys
from errno import ENOSPC
from types import ModuleType

import pytest
from support.tables import from_text

from hil_bench import __version__, cli
from hil_bench.__main__ import main as command
from hil_bench.abilities.common.shown_units import VARIABLE
from hil_bench.ability import Verb
from hil_bench.cli import build_parser, main
from hil_bench.cli.exit_codes import ExitCode, exit_code_of
from hil_bench.cli.parser import own_verbs
from hil_bench.errors import (
    BusError,
    ConfigError,
    ControllerError,
    DiskError,
    HilBenchError,
    RecordingError,
    SdoAbort,
    TimingError,
    WaitTimeoutError,
)


class ActModule:
    """A verb that does what a test wants."""

    def __init__(self, action):
        self.action = action

    def add_parser(self, subparsers):
        subparsers.add_parser("act").set_defaults(run=self.action)


@pytest.fixture
def act(monkeypatch):
    def run(action, *arguments):
        verbs = own_verbs() | {"act": Verb("more", 1, "do what a test wants", "act")}
        monkeypatch.setattr(cli, "own_verbs", lambda: verbs)
        monkeypatch.setattr(cli.importlib, "import_module", lambda _name: ActModule(action))
        return main([*arguments] if "act" in arguments else ["act", *arguments])

    return run


def failing(error):
    def action(_args):
        raise error

    return action


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (ConfigError("a: b; c"), 2, "hil-bench: error: a: b; c\n"),
        (ConfigError("a\nb"), 2, "hil-bench: error: a\nhil-bench: error: b\n"),
        (BusError("can0: lost"), 3, "hil-bench: error: can0: lost\n"),
        (
            RuntimeError("oops"),
            70,
            (
                "hil-bench: error: RuntimeError: oops; this is a bug, please report it with the "
                "output of the same command and -vv\n"
            ),
        ),
        (OSError(ENOSPC, "No space left", "a.csv"), 5, "hil-bench: error: a.csv: No space left\n"),
        (KeyboardInterrupt(), 130, ""),
        (BrokenPipeError(), 0, ""),
    ],
)
def test_an_error_is_one_line_and_an_exit_code(act, capsys, monkeypatch, error, code, line):
    monkeypatch.setattr(cli, "discard_output", lambda: None)

    assert act(failing(error)) == code
    assert capsys.readouterr().err == line


def test_two_v_show_the_traceback(act, capsys):
    assert act(failing(ConfigError("a: b; c")), "-vv") == 2

    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "Traceback (most recent call last):"
    assert lines[-1] == "hil-bench: error: a: b; c"


def test_a_bug_with_its_traceback_asks_for_no_more(act, capsys):
    assert act(failing(RuntimeError("oops")), "-vv") == 70
    assert capsys.readouterr().err.endswith("hil-bench: error: RuntimeError: oops\n")


def test_one_v_shows_no_traceback(act, capsys):
    assert act(failing(ConfigError("a: b; c")), "-v") == 2
    assert capsys.readouterr().err == "hil-bench: error: a: b; c\n"


@pytest.mark.parametrize(
    ("arguments", "verbose", "quiet"),
    [
        (["act"], 0, False),
        (["act", "-v"], 1, False),
        (["-vv", "act"], 2, False),
        (["act", "-q"], 0, True),
        (["--quiet", "act"], 0, True),
    ],
)
def test_v_and_q_may_stand_before_the_verb_or_after_it(act, arguments, verbose, quiet):
    seen = []

    def action(args):
        seen.append((args.verbose, args.quiet))
        return 0

    assert act(action, *arguments) == 0
    assert seen == [(verbose, quiet)]


def test_the_code_of_a_verb_is_the_exit_code(act):
    assert act(lambda _args: ExitCode.CHECK_FAILED) == 1
    assert act(lambda _args: ExitCode.TIMING) == 4


def test_each_error_has_its_exit_code():
    expected = {
        ConfigError(""): ExitCode.USAGE,
        DiskError(""): ExitCode.LOST,
        BusError(""): ExitCode.BUS,
        ControllerError(""): ExitCode.BUS,
        WaitTimeoutError(""): ExitCode.BUS,
        RecordingError(""): ExitCode.LOST,
        TimingError(""): ExitCode.TIMING,
        SdoAbort(0x06020000, ""): ExitCode.INTERNAL,
        HilBenchError(""): ExitCode.INTERNAL,
    }
    assert {error: exit_code_of(error) for error in expected} == expected


@from_text("arguments", "message")
def test_wrong_usage_is_one_line_and_exit_code_2(arguments, message, cli):
    assert cli(arguments.split(), 2).err == f"hil-bench: error: {message}\n"


def test_the_version_is_told(cli):
    assert cli("--version").out == f"hil-bench {__version__}\n"


@pytest.mark.parametrize("verb", [None, *own_verbs()])
def test_each_help_ends_with_examples(verb, cli):
    examples = cli([verb, "--help"] if verb else ["--help"]).out.rpartition("\nexamples:\n")[2]
    assert examples.startswith(f"  hil-bench {verb or ''}".rstrip())


HEAVY = {
    *("asyncio", "can", "canopen", "hil_drivers", "lark", "matplotlib", "numba", "numpy"),
    *("pandas", "pymodbus", "scipy"),
}


@pytest.mark.parametrize("words", ["--help", "check", "check bench.toml", "devices"])
def test_what_neither_runs_a_plant_nor_opens_a_bus_imports_nothing_heavy(words, tmp_path):
    (tmp_path / "bench.toml").write_text('[bus]\ninterface = "socketcan"\nchannel = "can0"\n')
    program = (
        f"import sys; from hil_bench.cli import main; code = main({words.split()!r}); "
        f"print(code, *sorted({HEAVY!r} & sys.modules.keys()))"
    )
    done = subprocess.run(  # noqa: S603 - the program just written
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=tmp_path
    )

    assert done.stdout.splitlines()[-1] == "0"


def test_scan_of_a_bus_builds_no_bench(tmp_path):
    program = (
        "import sys; from hil_bench.cli import main; "
        "code = main('scan -i virtual -c nobody --nodes 5 --patience 0.01'.split()); "
        "print(code, 'can' in sys.modules, "
        "*sorted({'numba', 'numpy', 'scipy', 'hil_bench.bench.bench'} & sys.modules.keys()))"
    )
    done = subprocess.run(  # noqa: S603 - the program just written
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=tmp_path
    )

    assert done.stdout.splitlines()[-1] == "6 True"


def test_a_run_imports_what_it_needs(tmp_path):
    """With kernels that want no NumPy, as those that a wheel carries; any bench may have faults.

    All kinds of devices are known, without the devices, and all keys of their tables.
    """
    program = (
        "import sys; from hil_bench.cli import main; "
        "needed = '.verbs options .common. .drive.kind .srdo.nodes .download. .faults. '; "
        "needed = (needed + '.live. .recording.').split(); "
        "code = main('-q run -i virtual -c nobody --speed max --duration 0.001'.split()); "
        "unused = {*'numba numpy scipy canopen hil_drivers'.split()} & sys.modules.keys(); "
        "unused |= {name for name in sys.modules if name.startswith('hil_bench.abilities.') "
        "and name.count('.') > 2 and not any(part in name for part in needed)}; "
        "print(code, *sorted(unused))"
    )
    done = subprocess.run(  # noqa: S603 - the program just written
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
    )

    assert done.stdout.splitlines()[-1] == "0"


@pytest.mark.parametrize(
    ("is_terminal", "words", "says"),
    [(True, [], True), (True, ["-q"], False), (False, [], False), (False, ["-v"], True)],
)
def test_who_waits_at_a_terminal_is_told_of_compiling(monkeypatch, is_terminal, words, says):
    """So it is whatever a call before in this process was told."""
    kernels = logging.getLogger("hil_bench.plants.hydraulic_cylinder.model.kernel")
    level, root = kernels.level, logging.getLogger().level
    monkeypatch.setattr("sys.stderr.isatty", lambda: is_terminal)
    try:
        for before in (logging.NOTSET, logging.INFO):
            kernels.setLevel(before)
            assert main(["completion", "bash", *words]) == 0
            assert kernels.isEnabledFor(logging.INFO) == says
    finally:
        kernels.setLevel(level)
        logging.getLogger().setLevel(root)


def test_python_m_is_the_same_command():
    done = subprocess.run(
        [sys.executable, "-m", "hil_bench", "--version"], capture_output=True, text=True, check=True
    )

    assert done.stdout == f"hil-bench {__version__}\n"


def test_ctrl_c_counts_before_anything_is_imported(monkeypatch):
    class Interrupted(ModuleType):
        def __getattr__(self, name):
            raise KeyboardInterrupt

    monkeypatch.setitem(sys.modules, "hil_bench.cli", Interrupted("hil_bench.cli"))
    assert command() == ExitCode.INTERRUPTED


@pytest.mark.parametrize("verb", ["check", "devices", "--help"])  # more and less than a buffer
def test_a_reader_that_leaves_early_is_no_error(tmp_path, verb):
    # Unbuffered output would hide what happens when the interpreter flushes it at exit.
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONUNBUFFERED"}
    with subprocess.Popen(  # noqa: S603 - our own command
        [sys.executable, "-m", "hil_bench", verb],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=tmp_path,
        env=environment,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""

    assert process.returncode == 0


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.mark.parametrize(("stream", "clear"), [(io.StringIO, ""), (Terminal, "\r\x1b[J")])
def test_a_warning_takes_the_place_of_the_status_lines(monkeypatch, stream, clear):
    monkeypatch.setattr("sys.stderr", stream())
    main(["--version"])
    logging.getLogger("hil_bench.test").warning("careful")
    assert sys.stderr.getvalue() == f"{clear}hil-bench: careful\n"


def test_a_unit_that_nobody_knows_is_named(cli):
    assert (
        "--units: units 'furlong': give some of metric" in cli("plot x.csv --units furlong", 2).err
    )


@pytest.mark.parametrize("before", [None, "psi"])
def test_the_units_of_a_call_are_not_those_of_the_next(monkeypatch, before):
    """A notebook calls `main` again and again in one process."""
    if before is None:
        monkeypatch.delenv(VARIABLE, raising=False)
    else:
        monkeypatch.setenv(VARIABLE, before)
    assert main(["plot", "no.csv", "--units", "MPa"]) == ExitCode.USAGE
    assert os.environ.get(VARIABLE) == before


def test_a_command_line_that_is_only_read_chooses_no_units(monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    args = build_parser(("plot",), own_verbs()).parse_args(["plot", "x.csv", "--units", "MPa"])
    assert VARIABLE not in os.environ
    with args.around():
        assert os.environ[VARIABLE] == "MPa"
    assert VARIABLE not in os.environ


def test_the_help_of_run_ends_with_the_examples_of_its_abilities(cli):
    said = cli("run --help").out
    for words in ("--fault freeze pressure_a at_s=10", "--scenario sag.scenario.toml"):
        assert words in said
