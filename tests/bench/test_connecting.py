"""The frames of docs/connecting.md, sent as its tables show them, get the answers shown there."""

import re

import can
from support.documents import ROOT

from hil_bench import VirtualBench, load_config

PAGE = (ROOT / "docs/connecting.md").read_text(encoding="utf-8")
WATCHED = re.search(r"```toml\n(\[nodes\.valve\.objects\].*?)```", PAGE, re.DOTALL)


class Controller:
    """Sends frames as cansend writes them, and keeps the last data of each COB-ID."""

    def __init__(self, bench):
        self.bench, self.heard = bench, {}
        self.run(0.05)  # the nodes boot

    def send(self, text):
        identifier, data = text.split("#")
        frame = can.Message(
            arbitration_id=int(identifier, 16), data=bytes.fromhex(data), is_extended_id=False
        )
        self.bench.bus.send(frame)

    def run(self, seconds):
        self.bench.run(seconds)
        while (message := self.bench.bus.recv(0)) is not None:
            self.heard[message.arbitration_id] = bytes(message.data)

    def say(self, text, seconds=0.05):
        self.send(text)
        self.run(seconds)

    @property
    def status_word(self):
        return int.from_bytes(self.heard[0x181][:2], "little")


def steps(heading):
    """Return step, frame and answer of each row of the table below a heading."""
    section = PAGE.split(heading)[1].split("\n## ")[0]
    rows = re.findall(r"^\| ([^|]+) \| `?([^|`]*)`? \| ([^|]+) \|$", section, re.MULTILINE)
    return [(step, frame.strip(), answer) for step, frame, answer in rows if "#" in frame]


def test_the_first_motion_is_as_shown():
    with VirtualBench() as bench:
        controller = Controller(bench)
        places = []
        for _, frame, answer in steps("## 3."):
            controller.say(frame, 0.2)
            shown = re.search(r"0x[0-9A-F]{4}", answer)
            assert controller.status_word == int(shown.group(), 16)
            places.append(int.from_bytes(controller.heard[0x184][:4], "little", signed=True))

        assert places[0] == places[1] < places[2]
        controller.run(0.2)
        assert (
            abs(bench.signals["axis1.position"][-1] - bench.signals["axis1.position"][-50]) < 1e-5
        )


def test_a_controller_that_dies_is_noticed_and_the_fault_is_reset_as_shown(tmp_path):
    path = tmp_path / "bench.toml"
    time_out = [line for line in WATCHED[1].splitlines() if "0x1016" not in line]
    nodes = '[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n'
    path.write_text(nodes + "\n".join(time_out) + "\n", encoding="utf-8")
    with VirtualBench(load_config(path)) as bench:
        controller = Controller(bench)
        controller.say("000#0100")
        controller.say("201#07000020")
        assert controller.status_word == 0x000F

        controller.run(0.2)
        assert controller.status_word == 0x0003
        assert controller.heard[0x081][:2] == b"\x50\x82"  # 0x8250, RPDO time-out

        controller.say("201#00000000")
        controller.say("201#07000000")
        assert controller.status_word == 0x0000  # no edge, no reset
        for _, frame, answer in steps("## 5."):
            controller.say(frame)
            assert f"{controller.status_word:#06x}".upper().replace("X", "x") in answer


def test_a_lost_heartbeat_is_noticed(tmp_path):
    path = tmp_path / "bench.toml"
    nodes = '[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n'
    path.write_text(nodes + WATCHED[1].replace('"0x1400.05" = 100', ""), encoding="utf-8")
    with VirtualBench(load_config(path)) as bench:
        controller = Controller(bench)
        controller.say("000#0100")
        controller.send("77F#05")
        controller.say("201#07000020", 0.1)
        assert controller.status_word == 0x000F
        controller.run(0.2)

        assert controller.heard[0x081][:2] == b"\x30\x81"  # 0x8130, heartbeat lost
        assert bench.signals["axis1.spool_setpoint"][-1] == 0.0
