"""The lines of `hil-bench commission` on the settings that it changed, and `--restore`."""

import argparse
import shlex
import sys
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path

from hil_bench.abilities.commissioning.borrowed import Returned
from hil_bench.abilities.commissioning.journal import BorrowedSetting, SettingsJournal
from hil_bench.cli.arguments import bus_words
from hil_bench.cli.controller_side import OpenNetwork
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.errors import ConfigError
from hil_drivers import NmtState

_FILE = "unrestored.jsonl"


def open_journal(args: argparse.Namespace) -> SettingsJournal:
    """Return the journal of a run; a virtual machine needs no file, it is gone with its process.

    Raises:
        ConfigError: an earlier run has left settings changed.
    """
    if args.virtual:
        return SettingsJournal()
    path = journal_path(args)
    if path.exists():
        raise ConfigError(
            f"{path}: an earlier run was ended before it could restore these settings; "
            f"restore them: {restore_command(args)} (or remove the file)"
        )
    return SettingsJournal(path)


def journal_path(args: argparse.Namespace) -> Path:
    """Return the file that holds what is not restored yet."""
    path: Path = args.output / _FILE
    return path


def restore_command(args: argparse.Namespace) -> str:
    """Return the command that restores what is left changed."""
    words = ["hil-bench", "commission", str(args.plan)]
    words += [args.config] if args.config else []
    words += bus_words(args)
    words += ["--lockstep"] if args.lockstep else []
    return shlex.join([*words, "--output", str(args.output), "--restore"])


def restore(args: argparse.Namespace, opened: OpenNetwork) -> int:
    """Restore what an earlier run has left changed."""
    journal = SettingsJournal.read(journal_path(args))
    journal.restore(opened.network)
    print_returned(Returned(tuple(journal.settings)), restore_command(args))
    return ExitCode.CHECK_FAILED if journal.unrestored else ExitCode.DONE


def print_returned(returned: Returned, command: str, *, is_quiet: bool = False) -> None:
    """Say what was changed and is restored; on standard error what is not, with a command."""
    settings = returned.settings
    if settings and not is_quiet and not returned.unrestored:
        print(f"settings  restored: {len(settings)} of {_nodes(settings)}")
    for line in _state_lines(returned) if not is_quiet else ():
        print(line)
    for line in _unrestored_lines(returned.unrestored, command):
        print(line, file=sys.stderr)


def _nodes(settings: Sequence[BorrowedSetting]) -> str:
    numbers = sorted({setting.node_id for setting in settings})
    return f"node{'s' if len(numbers) > 1 else ''} {', '.join(map(str, numbers))}"


def _state_lines(returned: Returned) -> Iterator[str]:
    """Yield how the nodes were left."""
    texts = {
        NmtState.PRE_OPERATIONAL: "PRE-OPERATIONAL again",
        NmtState.OPERATIONAL: "OPERATIONAL, as before",
        None: "left OPERATIONAL; how they were before they do not say",
    }
    for state, text in texts.items():
        nodes = [
            str(node_id) for node_id, found in sorted(returned.states.items()) if found is state
        ]
        if nodes:
            yield f"nodes     {', '.join(nodes)}: {text}"


def _unrestored_lines(settings: Sequence[BorrowedSetting], command: str) -> Iterator[str]:
    ordered = sorted(settings, key=lambda setting: (setting.node_id, setting.problem))
    for (node_id, problem), group in groupby(ordered, lambda s: (s.node_id, s.problem)):
        of_node = list(group)
        yield f"settings  not restored: {len(of_node)} of node {node_id}: {problem}"
        for setting in of_node:
            was, wrote = setting.text(setting.before), setting.text(setting.during)
            yield f"          {setting}: was {was}, may be {wrote}"
    if settings:
        yield f"          mend: {command}"
        yield "          or power-cycle the device, which brings back what it has stored"
