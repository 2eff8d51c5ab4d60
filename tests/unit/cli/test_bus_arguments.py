"""The arguments of a bus, beside those of python-can itself."""

import argparse

import can
import can.cli
import pytest

from hil_bench.bench.configuration.loop import interface
from hil_bench.cli.arguments import add_bus_arguments


def read(add, words):
    parser = argparse.ArgumentParser()
    add(parser)
    return vars(parser.parse_args(words.split()))


@pytest.mark.parametrize(
    "words",
    [
        "",
        "-i socketcan -c can0 -b 500000",
        "--interface=vector --channel 1 --bitrate 250000",
        "-i udp_multicast -c 239.74.163.2 --bus-kwargs hop_limit=2 receive_own_messages=True",
        "--bus-kwargs host=127.0.0.1 port=29536 wait=0.5 low=-1 name= text=a=b _x1=false e=1.5e-3",
    ],
)
def test_the_command_line_is_read_as_by_python_can(words):
    assert read(add_bus_arguments, words) == read(can.cli.add_bus_arguments, words)


@pytest.mark.parametrize("word", ["port", "=1", "a-b=1", "1a=2", "ä=1"])
def test_what_is_no_bus_option_is_refused_as_by_python_can(word, capsys):
    for add in (add_bus_arguments, can.cli.add_bus_arguments):
        with pytest.raises(SystemExit):
            read(add, f"--bus-kwargs {word}")
    assert f"--bus-kwargs: {word!r} is no bus option; give NAME=VALUE" in capsys.readouterr().err


def test_every_interface_of_python_can_is_a_choice(capsys):
    with pytest.raises(SystemExit):
        read(add_bus_arguments, "--help")
    shown = " ".join(capsys.readouterr().out.split())
    assert ", ".join(sorted(can.VALID_INTERFACES)) in shown

    for name in can.VALID_INTERFACES:
        assert read(add_bus_arguments, f"-i {name}") == {"interface": name}
    with pytest.raises(SystemExit):
        read(add_bus_arguments, "-i socketcn")


@pytest.mark.parametrize("name", ["socketcan", "socketcand", "virtual"])
def test_what_a_bench_may_name_without_a_look_at_python_can_is_there(name):
    assert interface(name) == name
    assert name in can.VALID_INTERFACES
