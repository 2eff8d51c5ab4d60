"""`hil-bench completion`: have a shell complete verbs and options."""

import argparse
import sys

import shtab

from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.verbs import all_verbs

SHELLS = ("bash", "zsh", "tcsh")

_EXAMPLES = """\
examples:
  hil-bench completion bash > ~/.local/share/bash-completion/completions/hil-bench
  hil-bench completion zsh > ~/.zfunc/_hil-bench                with ~/.zfunc in fpath
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "completion",
        description="Print a script by which a shell completes verbs and options.",
        epilog=_EXAMPLES,
    )
    parser.add_argument("shell", choices=SHELLS, help="the shell")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    from hil_bench.cli import build_parser  # noqa: PLC0415 - it imports this module

    verbs, _ = all_verbs()
    sys.stdout.write(shtab.complete(build_parser(verbs, verbs), args.shell))
    return ExitCode.DONE
