"""Where positional arguments may stand."""

import pytest

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
