"""Signals by their names in a DBC file: what comes from there, and what is refused."""

import shutil
import sys
from pathlib import Path

import pytest
from support.tables import from_text

from hil_bench import ConfigError, VirtualBench, load_config
from hil_bench.abilities.j1939.protocol.signals import Signal

EXAMPLES = Path(__file__).parents[3] / "examples"
LEVER = '[j1939.lever]\naddress = 19\ndbc = "joystick.dbc"\n[j1939.lever.signals]\n'


@pytest.fixture
def read(tmp_path, load_bench):
    shutil.copy(EXAMPLES / "joystick.dbc", tmp_path)
    return load_bench


def test_place_scaling_unit_period_and_spn_come_from_the_file(read):
    (lever,) = read(LEVER + 'x = { message = "BJM1", signal = "JoystickXPosition" }\n').ecus
    (x,) = lever.sent

    # SG_ JoystickXPosition : 6|10@1+ (0.1,0) "%"; identifier 0x0CFDD613: priority 3, PGN 0xFDD6.
    assert x.signal == Signal(6, 10, 0.1, 0.0)
    assert (x.group, x.priority, x.period, x.unit) == (0xFDD6, 3, 20_000_000, "%")
    assert x.trouble == (2660, 2)


def test_the_line_wins(read):
    text = LEVER + 'x = { message = "BJM1", signal = "JoystickXPosition", rate_ms = 50, spn = 1 }\n'
    text += 'JoystickButton1 = { message = "BJM1" }\n'
    x, button = read(text).ecus[0].sent

    assert (x.period, x.trouble) == (50_000_000, (1, 2))
    assert button.period is None  # one of a group says it
    assert (button.name, button.signal) == ("JoystickButton1", Signal(46, 2))


def test_a_command_comes_from_the_file_too(read):
    text = LEVER + 'JoystickXPosition = { message = "BJM1", sink = "axis1.spool_setpoint" }\n'
    (taken,) = read("[plant.axis1]\n" + text).ecus[0].taken

    assert (taken.group, taken.signal) == (0xFDD6, Signal(6, 10, 0.1, 0.0))


def test_the_bus_shows_what_the_table_without_a_dbc_shows():
    """The layouts of both examples are the same, and so must be the bytes."""
    seen = []
    for name in ("j1939_dbc.toml", "j1939_lever.toml"):
        with VirtualBench(load_config(EXAMPLES / name)) as bench:
            bench.ecus["joystick"]["x"] = -40
            bench.run(0.3)
            frames = [each.frame for each in bench.frames]
            seen.append([frame.data for frame in frames if frame.can_id == 0x0CFDD613][-1])
    by_file, by_table = seen

    # -40 % of 0.1 % a bit is 400 = 0x190 from bit 6; left of neutral.
    assert by_file[:2].hex(" ") == "04 64"
    assert by_table[:2] == bytes((by_file[0] | 3, by_file[1]))  # which has no signal for neutral


@from_text("line", "message")
def test_what_the_file_cannot_give_is_one_line(read, tmp_path, line, message):
    with (tmp_path / "joystick.dbc").open("a") as file:
        file.write('BO_ 2566853260 Other: 8 Joystick\n SG_ Motorola : 7|8@0+ (1,0) [0|250] "" C\n')
        file.write(' SG_ Signed : 16|8@1- (1,0) [0|1] "" C\n SG_ Flag : 24|1@1+ (1,0) [0|1] "" C\n')
    with pytest.raises(ConfigError) as caught:
        read(LEVER + line + "\n")

    assert message in str(caught.value)
    assert "j1939.lever.signals." in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"garbage", b"\0\0\0", b"\xff" * 40, b"BO_ x"])
def test_a_file_that_is_no_dbc_is_one_line(read, tmp_path, content):
    (tmp_path / "joystick.dbc").write_bytes(content)
    with pytest.raises(ConfigError, match=r"joystick\.dbc: cannot be read as a DBC file") as caught:
        read(LEVER + 'x = { message = "BJM1" }\n')
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("BO_ 8192 A: 8 X", "A has the identifier 0x2000, of more than 11 bits; one of 29 "),
        ("BO_ 8192 A: 8 X", "has bit 31 set, as 2147491840 has"),  # 0x80002000
        ("BO_ 4294967295 A: 8 X", "of more than 29 bits; 0x1FFFFFFF is the highest"),
        ('VAL_ 9 a 1 "on" ;', "the signal a, which no message 9 has; correct its name, or delete"),
        ("BO_ 9 2017: 8 X", 'column 7: "2017: 8 X" does not fit here; a name begins with a'),
        ('BO_ 9 A: 8 X SG_ a : 0|8@1+ (.5,0) [0|0] "" X', "a number has a digit before its point"),
        ('CM_ SG_ 9 "text";', "the name of the signal is missing before its comment"),
        ('CM_ 9 "text";', "write CM_ BO_ before the identifier of a message"),
        ('CM_ "no end"', "correct this line, or the end of the one before it"),
        ('BO_ 9 A: 8 X\n SG_ a : 0|0@1+ (1,0) [0|0] "" X', "a of A has 0 bits; 1 to 64 are right"),
    ],
)
def test_what_is_wrong_in_a_dbc_is_said_with_its_line(read, tmp_path, line, said):
    """As in 19 of 208 public files."""
    with (tmp_path / "joystick.dbc").open("a") as file:
        file.write(f"\n{line}\n\nBO_ 10 B: 8 X\n")
    text = (tmp_path / "joystick.dbc").read_text()
    at = text[: text.index(line) + len(line)].count("\n") + 1
    at += 2 * line.endswith('end"')  # it is missed where the next statement begins
    with pytest.raises(ConfigError) as caught:
        read(LEVER + 'x = { message = "BJM1" }\n')
    assert f"joystick.dbc: cannot be read as a DBC file: line {at}" in str(caught.value)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_name_of_two_messages_is_refused(read, tmp_path):
    with (tmp_path / "joystick.dbc").open("a") as file:
        file.write("BO_ 2566853260 BJM1: 8 Joystick\n")
    with pytest.raises(ConfigError, match='the DBC has 2 messages "BJM1"; rename them there'):
        read(LEVER + 'x = { message = "BJM1" }\n')


def test_a_file_that_is_not_there_is_one_line(read):
    with pytest.raises(ConfigError, match=r"no\.dbc: cannot be read: No such file") as caught:
        read(LEVER.replace("joystick.dbc", "no.dbc") + 'x = { message = "BJM1" }\n')
    assert "\n" not in str(caught.value)


def test_a_device_without_a_file_is_told_so(read):
    with pytest.raises(ConfigError, match="the device has no DBC; give it dbc"):
        read(LEVER.replace('dbc = "joystick.dbc"\n', "") + 'x = { message = "BJM1" }\n')


def test_without_the_extra_it_says_which(read, monkeypatch):
    monkeypatch.setitem(sys.modules, "cantools.database", None)
    with pytest.raises(
        ConfigError, match=r"dbc needs the extra dbc: pip install 'hil-bench\[dbc\]'"
    ):
        read(LEVER.replace("joystick.dbc", "./joystick.dbc") + 'x = { message = "BJM1" }\n')
