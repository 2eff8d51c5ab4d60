"""`hil-bench program`: download a program into a device."""

import argparse
import sys
from functools import partial
from pathlib import Path

from hil_bench.abilities.common.arguments import add_network_arguments
from hil_bench.abilities.common.controller_side import open_network
from hil_bench.abilities.common.progress import Work, shown_work
from hil_bench.cli.arguments import add_bench_arguments, load_bench_config
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.results import add_json_argument, is_silent, print_results
from hil_bench.errors import ConfigError
from hil_drivers import BusLostError, DeviceMismatchError, DriverError
from hil_drivers.program import ProgramDownload, ProgramState

MOST_BYTES = 1 << 26
"""Largest program that is read [byte]."""

_EXAMPLES = """\
examples:
  hil-bench program -i socketcan -c can0 --node 5                       what the device says
  hil-bench program -i socketcan -c can0 --node 5 --file firmware.bin   a new program, started
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "program",
        description="Download a program into a CANopen device (CiA 302-3, 0x1F50 to 0x1F57): stop\n"
        "and clear the old one, download, wait until it is flashed, start it. Without --file,\n"
        "show what the device says of the program that it has.",
        epilog=_EXAMPLES,
    )
    add_bench_arguments(parser)
    add_network_arguments(parser)
    parser.add_argument("--node", type=int, required=True, metavar="N", help="node-ID, 1 to 127")
    parser.add_argument("--file", type=Path, metavar="FILE", help="the program, as it is sent")
    parser.add_argument(
        "--number", type=int, default=1, metavar="N", help="of the program, its sub-index (1)"
    )
    parser.add_argument(
        "--segmented", action="store_true", help="in segments, where a device has no block transfer"
    )
    parser.add_argument("--no-start", action="store_true", help="leave the new program stopped")
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Download, or look; exit code 0 where the device has a valid program in the end.

    It is 6 where no device answers: nothing has been asked of it.

    Raises:
        ConfigError: the command line is wrong.
        BusLostError: the bus was lost.
        DeviceMismatchError: told like every refusal of the device, and not raised.
    """
    for name, low, high in (("node", 1, 127), ("number", 1, 254)):
        if not low <= getattr(args, name) <= high:
            wrong = f"--{name} {getattr(args, name)}"
            raise ConfigError(f"{wrong}: a number from {low} to {high} is right")
    program = None if args.file is None else _read(args.file)
    config = load_bench_config(args)
    work = Work("program", None if program is None else len(program), "bytes")
    with open_network(args, config) as opened, shown_work(args, work):
        node = opened.network.add_node(args.node)
        download = ProgramDownload(opened.network, node, args.number)
        is_there = False
        try:
            node.await_answer()
            is_there = True
            if program is None:
                state = download.read()
            else:
                state = download.update(
                    program,
                    block=not args.segmented,
                    start=not args.no_start,
                    progress=partial(setattr, work, "done"),
                )
            if state == ProgramState(None, None, None):
                what = f"has no program {args.number}; a device with 0x1F50 to 0x1F57 is right"
                raise DeviceMismatchError(what, device=node)
        except BusLostError:
            raise
        except DriverError as error:
            if is_silent(args):
                print_results(args, [], {"done": False, "error": str(error)})
            print(f"hil-bench: error: {error}", file=sys.stderr)
            return ExitCode.CHECK_FAILED if is_there else ExitCode.INCONCLUSIVE
    lines = _lines(state)
    if program is not None:
        lines.insert(0, f"downloaded      {len(program)} bytes")
    code, problem = _verdict(state, starts=program is not None and not args.no_start)
    content = {"done": not problem, "state": state, "error": problem or None}
    print_results(args, lines, content)
    if problem and problem != state.error:
        print(f"hil-bench: error: node {args.node}: {problem}", file=sys.stderr)
    return code


def _verdict(state: ProgramState, *, starts: bool) -> tuple[ExitCode, str]:
    """Return the exit code of a state, and what is wrong with it.

    Args:
        state: what the device says in the end.
        starts: whether the program was started.
    """
    if state.error:
        return ExitCode.CHECK_FAILED, state.error
    if starts and state.is_running is False:
        return ExitCode.CHECK_FAILED, "the program was started, and 0x1F51 says that it is stopped"
    if starts and state.is_running is None:
        return ExitCode.INCONCLUSIVE, "0x1F51 does not say that the program runs"
    if state.is_busy:
        return ExitCode.INCONCLUSIVE, "0x1F57 says that the device flashes or clears"
    return ExitCode.DONE, ""


def _read(path: Path) -> bytes:
    """Return the bytes of a program.

    Raises:
        ConfigError: there is none.
    """
    try:
        with path.open("rb") as file:
            program = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise ConfigError(f"--file {path}: cannot be read: {error.strerror}") from None
    if not program:
        raise ConfigError(f"--file {path}: is empty; give a program")
    if len(program) > MOST_BYTES:
        raise ConfigError(f"--file {path}: is longer than {MOST_BYTES} bytes; give a program")
    return program


def _lines(state: ProgramState) -> list[str]:
    running = {None: "not reported", True: "running", False: "stopped"}[state.is_running]
    identification = "not reported"
    if state.identification is not None:
        identification = f"0x{state.identification:08X}"
    status = "not reported"
    if state.status is not None:
        status = "busy" if state.is_busy else state.error or "no error"
    return [
        f"program         {running}",
        f"identification  {identification}",
        f"flash           {status}",
    ]
