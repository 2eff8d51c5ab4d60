"""Plays each transcript in this folder against a node, in virtual time.

A transcript reads like a candump, one comment a frame. Time is in seconds, a round of the node
takes 1 ms, and the node has node-ID 5 and the objects of tests/unit/canopen_device/device.eds::

    (0.010) > 605#4000100000000000    ; a frame to the node, as can-utils write it (R for remote)
    (0.010) < 585#4300100091010000    ; the frame that the node sends in that round
    (0.020) ! set 2010.00 = 7         ; the application: set, trigger, raise CODE BITS [DATA], clear
    (0.020) ! power                   ; power off and on: the storage stays; `power 255` as node 255
    (0.020) ! damage                  ; one bit of the stored parameters flips
    (0.020) ! break                   ; from now on the storage cannot be written
    (0.020) ? value 2000.00 = 7       ; a look inside after the round: value, state, event, counter,
    (0.020) ? time 1000 5             ; days and milliseconds of the time of day; node-ID with `id`

The node must send exactly the frames of the transcript, in its order and in its rounds.
"""

import re
from pathlib import Path

import pytest

from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.events import NodeEvent, NodeEventKind
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.storage import MemoryStorage
from hil_bench.errors import StorageError

HERE = Path(__file__).parent
EDS = HERE.parent / "unit" / "canopen_device" / "device.eds"
ROUND = 1_000_000
LINE = re.compile(r"\((?P<seconds>\d+\.\d{3})\) (?P<kind>[<>!?]) (?P<text>[^;]*?)\s*;\s*\S.*")


class Transcript:
    """The lines of a file, by round."""

    def __init__(self, path):
        self.frames = []
        self.rounds = {}
        for number, text in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
            if text and not text.startswith("#"):
                self._add(f"{path.name}:{number}", text)

    def _add(self, where, text):
        match = LINE.fullmatch(text)
        assert match, f"{where}: not a line of a transcript: {text}"
        tick = int(match["seconds"].replace(".", ""))
        assert tick >= max(self.rounds, default=0), f"{where}: goes back in time"
        lines = self.rounds.setdefault(tick, [])
        if match["kind"] == "<":
            self.frames.append(f"({match['seconds']}) < {match['text']}")
        else:
            lines.append((where, match["kind"], match["text"]))


class TestStorage(MemoryStorage):
    """Storage that can be damaged."""

    __test__ = False
    is_broken = False

    def write(self, data):
        if self.is_broken:
            raise StorageError("broken")
        super().write(data)

    def damage(self):
        raw = bytearray(self.read())
        raw[0] ^= 1
        super().write(bytes(raw))


class Player:
    """Runs a node through a transcript."""

    def __init__(self):
        self.storage = TestStorage()
        self.sent = []
        self.events = []

    def power_on(self, node_id=5, now=0):
        self.node = Node(load_eds(EDS, node_id), node_id, self.storage)
        self.node.start(now)
        self.now = now

    def play(self, transcript):
        self.power_on()
        for tick in range(max(transcript.rounds) + 1):
            lines = transcript.rounds.get(tick, ())
            self._run_round(tick, lines)
            for where, kind, text in lines:
                if kind == "?":
                    self._look(where, text)

    def _run_round(self, tick, lines):
        self.now = now = tick * ROUND
        for _, kind, text in lines:
            if kind == "!" and text.startswith("power"):
                self.power_on(int([*text.split(), 5][1]), now)
            elif kind == ">":
                self.node.receive(parse_frame(text), now)
        self.node.expire(now)
        for _, kind, text in lines:
            if kind == "!":
                self._act(text)
        self.events += self.node.events
        self.node.events.clear()

        def emit(frame):
            self.sent.append(f"({tick // 1000}.{tick % 1000:03}) < {format_frame(frame)}")

        self.node.transmit_pdos(now, emit)
        self.node.serve(now, emit)

    def _act(self, text):
        verb, *words = text.split()
        if verb == "set":
            self._variable(words[0]).value = float(words[2]) if "." in words[2] else int(words[2])
        elif verb == "trigger":
            self.node.trigger_tpdo(int(words[0]))
        elif verb == "raise":
            code, bits, detail = [*words, ""][:3]
            self.node.emcy.raise_error(int(code, 16), int(bits, 16), bytes.fromhex(detail))
        elif verb == "damage":
            self.storage.damage()
        elif verb == "break":
            self.storage.is_broken = True
        elif verb == "behave":
            self.node.follow_error_behaviour(int(words[0]))
        elif verb == "power":
            pass  # before the frames of the round
        else:
            assert verb == "clear", text
            self.node.emcy.clear_error(int(words[0], 16))

    def _look(self, where, text):
        what, *words = text.split()
        if what == "event":
            event = NodeEvent(NodeEventKind[words[0]], int(words[1]))
            assert event in self.events, f"{where}: {event} is not among {self.events}"
            self.events.remove(event)
        elif what == "state":
            assert self.node.state.name == words[0], where
        elif what == "id":
            assert self.node.node_id == int(words[0]), where
        elif what == "time":
            expected = None if words == ["none"] else tuple(map(int, words))
            assert self.node.time_of_day(self.now) == expected, where
        elif what == "counter":
            assert getattr(self.node.counters, words[0]) == int(words[2]), where
        else:
            assert what == "value", text
            assert self._variable(words[0]).value == int(words[2], 0), where

    def _variable(self, text):
        index, subindex = text.split(".")
        return self.node.object_dictionary.variable(int(index, 16), int(subindex, 16))


def parse_frame(text):
    can_id, data = text.split("#")
    is_extended = len(can_id) == 8
    if data == "R":
        return Frame(int(can_id, 16), is_remote=True, is_extended=is_extended)
    return Frame(int(can_id, 16), bytes.fromhex(data), is_extended=is_extended)


def format_frame(frame):
    return f"{frame.can_id:03X}#{frame.data.hex().upper()}"


@pytest.mark.parametrize("path", sorted(HERE.glob("*.txt")), ids=lambda path: path.stem)
def test_transcript(path):
    transcript = Transcript(path)
    player = Player()

    player.play(transcript)

    assert player.sent == transcript.frames
