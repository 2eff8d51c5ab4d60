"""Where positional arguments may stand."""

import argparse
import re

import pytest

from hil_bench.ability import GROUPS
from hil_bench.cli import build_parser, main
from hil_bench.cli.parser import Parser, own_verbs

VERBS = own_verbs()


@pytest.fixture
def parser():
    parser = Parser(exit_on_error=False)
    parser.add_argument("recording")
    parser.add_argument("config", nargs="?")
    parser.add_argument("--speed")
    parser.add_argument("--virtual", action="store_true")
    return parser


@pytest.mark.parametrize(
    "text",
    [
        "run.mf4 bench.toml --virtual --speed 2",
        "run.mf4 --virtual bench.toml --speed 2",
        "run.mf4 --virtual --speed 2 bench.toml",
        "--virtual run.mf4 --speed 2 bench.toml",
        "--virtual --speed 2 run.mf4 bench.toml",
    ],
)
def test_options_may_stand_between_positional_arguments(parser, text):
    found = parser.parse_args(text.split())
    assert (found.recording, found.config, found.speed) == ("run.mf4", "bench.toml", "2")


def test_the_optional_one_may_be_left_out(parser):
    assert parser.parse_args(["run.mf4", "--speed", "2"]).config is None


@pytest.mark.long  # imports every verb
def test_no_help_is_wider_than_a_terminal_of_80_columns(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    parser = build_parser(VERBS, VERBS)
    verbs = parser._subparsers._group_actions[0].choices
    texts = [parser.format_help(), *(verb.format_help() for verb in verbs.values())]
    lines = [line for text in texts for line in text.splitlines()]
    # A command to be copied stays in one piece.
    assert [line for line in lines if len(line) > 80 and "  hil-bench" not in line] == []


def test_examples_and_paragraphs_fit_a_narrow_terminal(monkeypatch):
    monkeypatch.setenv("COLUMNS", "42")
    epilog = """\
A paragraph that has more words in one line than there
is room for.

examples:
  hil-bench demo
  hil-bench run --hub          a bus for other programs
                               where there is none
"""
    help_text = Parser(prog="hil-bench", epilog=epilog).format_help()
    assert help_text.endswith("""\
A paragraph that has more words in one
line than there is room for.

examples:
  hil-bench demo
  hil-bench run --hub
        a bus for other programs
        where there is none
""")


SHORT = {
    "-b": "--bitrate",
    "-c": "--channel",
    "-h": "--help",
    "-i": "--interface",
    "-k": None,
    "-o": "--output",
    "-q": "--quiet",
    "-v": "--verbose",
}
"""What each short option stands for, in every verb that has it; the help of hil-bench shows it."""


def parsers(parser):
    """Yield a parser and all below it."""
    yield parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from parsers(below)


@pytest.mark.long  # imports every verb
def test_a_short_option_means_the_same_in_every_verb():
    for parser in parsers(build_parser(VERBS, VERBS)):
        for action in parser._actions:
            short, long = (
                [each for each in action.option_strings if each.startswith("--") is is_long]
                for is_long in (False, True)
            )
            assert [SHORT[each] for each in short] == ([*long] or [None])[: len(short)], parser.prog
            assert not set(long) & set(SHORT.values()) or short, parser.prog


def test_the_help_names_the_short_options():
    shown = build_parser((), VERBS).epilog.partition("short options")[2].partition("\n\n")[0]
    named = dict(re.findall(r"(-\w)(?: (--\w+))?", shown))
    assert named == {short: long or "" for short, long in SHORT.items() if short != "-h"}


def test_the_help_has_each_verb_once_below_the_heading_of_its_group():
    shown = build_parser((), VERBS).format_help().partition("\nverbs:\n")[2].partition("\n\n")[0]
    found, verbs = {}, []
    for indent, word in re.findall(r"^( {2,4})([a-z-]+)", shown, re.MULTILINE):
        if len(indent) == 2:
            verbs = found[word] = []
        else:
            verbs.append(word)
    assert found == {
        group: [name for name, verb in VERBS.items() if verb.group == group] for group in GROUPS
    }


def test_the_options_of_run_begin_with_those_that_are_used_most(capsys):
    main(["run", "--help"])
    text = capsys.readouterr().out
    order = [
        "most used:",
        "  --duration",
        "  --record",
        "  --scenario",
        "bus (",
        "real time (",
        "seldom",
    ]
    places = [text.index(f"\n{each}") for each in order]
    assert places == sorted(places)
