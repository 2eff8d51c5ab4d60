"""The command line: one verb a file.

A verb is a module with ``add_parser(subparsers)``, which sets ``run`` as a default, and
``run(args) -> int``; `parser` has those of the core and of all abilities. It is imported only when
it is called, so that ``--help`` and ``--version`` stay quick whatever a verb needs.
"""

import argparse
import importlib
import logging
import platform
import sys
from collections.abc import Container, Mapping, Sequence
from contextlib import nullcontext
from typing import Any, cast

import hil_bench
from hil_bench.ability import GROUPS, Verb
from hil_bench.cli.exit_codes import ExitCode, interrupted_once, report_error, worst
from hil_bench.cli.parser import Parser, all_verbs, own_verbs
from hil_bench.cli.process import (
    PatientHandler,
    add_verbosity_arguments,
    add_verbosity_below,
    collection_put_off,
    discard_output,
    flush_output,
    keep_output,
    prepare_streams,
)

_EXAMPLES = """\
exit codes, the most severe first (docs/exit-codes.md):
   70  a bug in hil-bench
    3  a bus or a port cannot be used
    1  a check failed
    2  command line, configuration or a file is wrong
    5  a recording, report or server was lost
    4  late, under --strict-timing or --overrun stop
  130  interrupted
    6  what was to be checked was not seen
    0  done

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
    prepare_streams()  # before anything is opened, which would get the number of a closed one
    with interrupted_once() if argv is None else nullcontext():
        return _main(arguments, freezes=argv is None)


def _main(arguments: Sequence[str], *, freezes: bool) -> int:
    verbosity, code = 0, ExitCode.DONE
    try:
        with collection_put_off(freezes=freezes):
            args = _parse(arguments)
        if freezes and getattr(args, "json", False):
            keep_output()
        verbosity = args.verbose
        _set_up_logging(verbosity, quiet=args.quiet)
        with getattr(args, "around", nullcontext)():  # an option's own, such as --units
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
        parser = build_parser(() if called is None else (called,), _find_verbs(called, arguments))
        args = parser.parse_args(arguments, argparse.Namespace(given_words=arguments))
        del args.given_words  # only for --version
    except SystemExit as end:
        code = int(end.code or ExitCode.DONE)
        return argparse.Namespace(run=lambda _args: code, verbose=0, quiet=False)
    return args


def _find_verbs(called: str | None, arguments: Sequence[str]) -> Mapping[str, Verb]:
    """The verbs; without a look at other distributions, which is slow, where that is enough."""
    own = own_verbs()
    if called in own or (called is None and not {"-h", "--help"} & {*arguments}):
        return own
    verbs, problems = all_verbs()
    for problem in problems:
        print(f"hil-bench: warning: {problem}", file=sys.stderr)
    return verbs


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
    """Lists each verb with its line, whether it is there in full or by name."""

    known: Mapping[str, Verb]

    @property
    def headings(self) -> list[_Heading]:
        """The groups of verbs, for the help."""
        actions = {action.dest: action for action in self._choices_actions}
        return [
            _Heading(
                group,
                [
                    actions[name]
                    for name, verb in self.known.items()
                    if verb.group == group and name in actions
                ],
            )
            for group in GROUPS
        ]

    def add_name(self, name: str) -> None:
        """Add a verb that nobody calls: parsers for all of them take 4 ms."""
        self._choices_actions.append(self._ChoicesPseudoAction(name, (), self.known[name].summary))
        self.choices[name] = None

    def add_parser(self, name: str, **options: Any) -> argparse.ArgumentParser:  # noqa: ANN401 - as argparse
        """Add a verb."""
        summary = self.known[name].summary
        parser: argparse.ArgumentParser = super().add_parser(name, help=summary, **options)
        return parser


def build_parser(called: Container[str], verbs: Mapping[str, Verb]) -> argparse.ArgumentParser:
    """Return the parser with every verb by name, and those that are called in full."""
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
    subparsers.known = verbs
    for name, verb in verbs.items():
        if name in called:
            importlib.import_module(verb.module).add_parser(subparsers)
            add_verbosity_below(subparsers.choices[name])
        else:
            subparsers.add_name(name)
    return parser


def _set_up_logging(verbosity: int, *, quiet: bool) -> None:
    level = logging.ERROR if quiet else max(logging.DEBUG, logging.WARNING - 10 * verbosity)
    # On a terminal, in place of the status lines, which are written anew below.
    clear = "\r\x1b[J" if sys.stderr.isatty() else ""
    text = f"{clear}hil-bench: %(message)s"
    logging.basicConfig(level=level, format=text, force=True, handlers=[PatientHandler()])
    is_awaited = sys.stderr.isatty() and not quiet  # somebody waits for the kernels
    kernel = logging.getLogger("hil_bench.plants.hydraulic_cylinder.model.kernel")
    kernel.setLevel(logging.INFO if is_awaited else logging.NOTSET)
    # What python-can logs of a bus that it cannot open, our own message says too.
    logging.getLogger("can").setLevel(logging.NOTSET if verbosity else logging.CRITICAL)
