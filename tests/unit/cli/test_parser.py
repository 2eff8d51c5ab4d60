"""Where positional arguments may stand."""

import pytest

from hil_bench.cli import VERBS, build_parser
from hil_bench.cli.parser import Parser


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
    parser = build_parser(VERBS)
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
