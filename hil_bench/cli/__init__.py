"""The command line: one verb a file.

A verb is a module of this package with ``add_parser(subparsers)``, which sets ``run`` as a
default, and ``run(args) -> int``. It is imported only when it is called, so that ``--help`` and
``--version`` stay quick whatever a verb needs.
"""

import argparse
import importlib
import logging
import platform
import sys
from collections.abc import Container, Sequence
from typing import Any, cast

import hil_bench
from hil_bench.cli.collection import collection_put_off
from hil_bench.cli.exit_codes import ExitCode, report_error, worst
from hil_bench.cli.parser import Parser
from hil_bench.cli.patient_handler import PatientHandler
from hil_bench.cli.streams import discard_output, flush_output, prepare_streams
from hil_bench.cli.verbosity import add_verbosity_arguments, add_verbosity_below

GROUPS = {
    "start": {
        "demo": "watch a controller move the cylinder; needs no set-up",
        "new": "write a bench.toml from data sheets, and print what the axis can do",
        "check": "check a bench.toml, and print each value with its origin",
        "devices": "print the device table: node-IDs, profiles, PDOs",
        "plot": "draw a recording",
    },
    "run": {
        "run": "run the bench in real time on a CAN bus",
        "ctl": "read, set and break a running bench, from a shell",
        "watch": "watch a running bench or any bus, in the terminal",
        "panel": "watch, set and break a running bench, on a web page",
        "replay": "put recorded frames on a bus, or drive the plant with recorded set-points",
    },
    "test": {
        "test": "play scenarios, and judge their requirements",
        "judge": "judge recordings by requirements: verdict, margin, deciding comparison",
        "scenario": "check, list and convert scenario files",
        "campaign": "run scenarios over parameters, benches and firmware, thousands of times",
        "falsify": "search for parameters that make a requirement fail",
        "evidence": "validate this installation, and write the evidence as a folder",
    },
    "bus": {
        "monitor": "print the frames of a bus in words: nodes, objects, values, errors",
        "decode": "print a log of frames in words, or write its values or a DBC file",
        "explain": "find what went wrong in a log, in the order in which an expert looks",
        "record": "record frames and decoded values of any bus",
        "scan": "find the nodes of a bus, with identity and state",
        "boot": "boot a network as its NMT master: check, configure and start its devices",
        "program": "download a program into a device, or show the one that it has",
        "conformance": "check a device against CiA 301 and CiA 305, clause by clause",
        "check-eds": "find errors in EDS files, with line numbers",
        "bus-load": "compute load and response times of a bench on its buses",
        "registers": "print the register maps of the Modbus units",
    },
    "machine": {
        "commission": "take an axis into operation step by step, with report and recording",
        "identify": "estimate the plant's parameters with confidence intervals from recordings",
        "shadow": "run the plant beside a machine on its commands, and show the differences",
    },
    "more": {
        "doctor": "measure what this machine can do in real time, and name what to change",
        "analyse": "analyse valve and cylinder as the paper does: numbers, tables, figures",
        "export-fmu": "write an axis as an FMU for co-simulation in other tools",
        "completion": "print the script by which a shell completes verbs and options",
    },
}
"""Verbs by what they are for; each names its module (with _ for -), and says what it does."""

VERBS = {verb: line for group in GROUPS.values() for verb, line in group.items()}
"""All verbs."""

_EXAMPLES = """\
exit codes:
  0 done; 1 a check failed; 2 usage or configuration; 3 bus or port; 4 real-time budget missed
  under --strict-timing or --overrun stop; 5 a recording, report or server was lost; 6 nothing to
  check was seen; 70 a bug in hil-bench; 130 interrupted (docs/exit-codes.md has their order)

short options, the same in every verb:
  -i --interface, -c --channel, -b --bitrate, -o --output, -k (choose),
  -v --verbose, -q --quiet

examples:
  hil-bench demo
  hil-bench run -i socketcan -c vcan0
  hil-bench check bench.toml
  hil-bench VERB --help
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb and return the exit code; see `ExitCode`."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    verbosity, code = 0, ExitCode.DONE
    try:
        prepare_streams()
        with collection_put_off(freezes=argv is None):
            args = _parse(arguments)
        verbosity = args.verbose
        _set_up_logging(verbosity, quiet=args.quiet)
        code = ExitCode(args.run(args))
        flush_output()  # here, where a closed pipe can still be told from an error
    except BrokenPipeError:
        # The reader of our output, such as `head`, has seen enough.
        discard_output()
    except KeyboardInterrupt:
        return worst(code, ExitCode.INTERRUPTED)
    except Exception as error:  # the last place where it can become one line
        return worst(code, report_error(error, verbosity=verbosity))
    return code


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Return the command line; where argparse has given the answer, nothing is left to be run."""
    try:
        called = next((word for word in arguments if not word.startswith("-")), None)
        parser = build_parser(() if called is None else (called,))
        args = parser.parse_args(arguments, argparse.Namespace(given_words=arguments))
        del args.given_words  # only for --version
    except SystemExit as end:
        code = int(end.code or ExitCode.DONE)
        return argparse.Namespace(run=lambda _args: code, verbose=0, quiet=False)
    return args


class _ShowVersion(argparse.Action):
    """The version action of argparse, which looks up the version only where it is asked for.

    With -v, before or behind it, it shows what runs as well.
    """

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, *_: object
    ) -> None:
        print(f"{parser.prog} {hil_bench.__version__}")
        if {"-v", "-vv", "--verbose"} & set(namespace.given_words):
            from hil_bench.bench.compiled import look_at_core  # noqa: PLC0415 - for this alone
            from hil_bench.plants.hydraulic_cylinder.model.moving import (  # noqa: PLC0415
                describe_kernels,
            )

            print(f"core of the bench: {look_at_core()}")
            print(f"plant kernel: {describe_kernels()}")
            print(f"Python {platform.python_version()}")
        parser.exit()


class _Heading(argparse.Action):
    """The name of a group of verbs in the help, above them."""

    def __init__(self, name: str, verbs: Sequence[argparse.Action]) -> None:
        super().__init__((), name, metavar=name)
        self._verbs = verbs

    def _get_subactions(self) -> Sequence[argparse.Action]:
        return self._verbs


class _Verbs(argparse._SubParsersAction):  # type: ignore[type-arg]  # noqa: SLF001 - no other way
    """Lists each verb with its line of `VERBS`, whether it is there in full or by name."""

    @property
    def headings(self) -> list[_Heading]:
        """The groups of verbs, for the help."""
        known = {action.dest: action for action in self._choices_actions}
        return [
            _Heading(name, [known[verb] for verb in verbs if verb in known])
            for name, verbs in GROUPS.items()
        ]

    def add_name(self, name: str) -> None:
        """Add a verb that nobody calls: parsers for all of them take 4 ms."""
        self._choices_actions.append(self._ChoicesPseudoAction(name, (), VERBS[name]))
        self.choices[name] = None

    def add_parser(self, name: str, **options: Any) -> argparse.ArgumentParser:  # noqa: ANN401 - as argparse
        """Add a verb."""
        parser: argparse.ArgumentParser = super().add_parser(name, help=VERBS[name], **options)
        return parser


def build_parser(verbs: Container[str]) -> argparse.ArgumentParser:
    """Return the parser with every verb by name, and some of them in full."""
    parser = Parser(
        prog="hil-bench",
        description="A hydraulic axis behind CANopen devices, in software: a test bench.",
        epilog=_EXAMPLES,
    )
    parser.add_argument(
        "--version",
        action=_ShowVersion,
        nargs=0,
        help="show the version and exit; with -v also what is compiled",
    )
    add_verbosity_arguments(parser, verbose=0, quiet=False)
    subparsers = cast(
        "_Verbs",
        parser.add_subparsers(
            title="verbs", metavar="VERB", required=True, parser_class=Parser, action=_Verbs
        ),
    )
    for verb in VERBS:
        if verb in verbs:
            importlib.import_module(f"hil_bench.cli.{verb.replace('-', '_')}").add_parser(
                subparsers
            )
            add_verbosity_below(subparsers.choices[verb])
        else:
            subparsers.add_name(verb)
    return parser


def _set_up_logging(verbosity: int, *, quiet: bool) -> None:
    level = logging.ERROR if quiet else max(logging.DEBUG, logging.WARNING - 10 * verbosity)
    # On a terminal, in place of the status lines, which are written anew below.
    clear = "\r\x1b[J" if sys.stderr.isatty() else ""
    text = f"{clear}hil-bench: %(message)s"
    logging.basicConfig(level=level, format=text, force=True, handlers=[PatientHandler()])
    if sys.stderr.isatty() and not quiet:  # somebody waits for it
        logging.getLogger("hil_bench.plants.hydraulic_cylinder.model.kernel").setLevel(logging.INFO)
    # What python-can logs of a bus that it cannot open, our own message says too.
    logging.getLogger("can").setLevel(logging.NOTSET if verbosity else logging.CRITICAL)
