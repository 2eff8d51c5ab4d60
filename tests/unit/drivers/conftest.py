"""A bus that plays a transcript: it answers what it expects, and nothing else may be sent."""

import configparser
import re
from collections import deque
from collections.abc import Sequence
from contextlib import contextmanager

import can
import pytest

from device_profiles import ENCODER_406, VALVE_408
from hil_drivers import Network

Step = tuple[str | None, str | Sequence[str] | None]
"""A frame that the driver must send, and what then comes back; None for nothing.

Frames are written as candump writes them: "601#40.00.10.00.00.00.00.00", "R" for a remote frame.
"""


def parse(text):
    """Returns the message that candump would print so; eight digits are a 29-bit identifier."""
    identifier, data = text.split("#")
    remote = data == "R"
    return can.Message(
        arbitration_id=int(identifier, 16),
        is_extended_id=len(identifier) == 8,
        is_remote_frame=remote,
        data=None if remote else bytes.fromhex(data.replace(".", "")),
    )


def show(message):
    return f"{message.arbitration_id:03X}#{message.data.hex('.').upper()}"


class TranscriptBus(can.BusABC):
    """Plays a transcript in virtual time: only waiting in `recv` lets it pass."""

    def __init__(self):
        self.channel_info = "transcript"
        self.time = 100.0
        self.sent: list[str] = []
        self.steps: deque[Step] | None = None
        self.waiting: deque[can.Message] = deque()
        super().__init__(channel="transcript")

    def now(self):
        return self.time

    def play(self, *frames):
        """Puts frames on the bus now."""
        self.waiting.extend(parse(frame) for frame in frames)

    def send(self, msg, timeout=None):  # noqa: ARG002 - BusABC's
        frame = show(msg)
        self.sent.append(frame)
        if self.steps is None:
            return
        assert self.steps, f"sent {frame} after the end of the transcript"
        expected, answer = self.steps.popleft()
        assert frame == expected
        self.play(*([answer] if isinstance(answer, str) else answer or []))

    def recv(self, timeout=None):
        if self.waiting:
            return self.waiting.popleft()
        assert timeout is not None, "waits for ever"
        self.time += timeout
        return None


@pytest.fixture
def bus():
    bus = TranscriptBus()
    yield bus
    bus.shutdown()


@pytest.fixture
def network(bus):
    return Network(bus, clock=bus.now)


@pytest.fixture
def expected_protocol(bus):
    """Context in which exactly these pairs of frames must pass, in this order."""

    @contextmanager
    def expect(steps):
        bus.steps = deque(steps)
        yield
        left, bus.steps = bus.steps, None
        assert not left, f"not sent: {[expected for expected, _ in left]}"

    return expect


@pytest.fixture
def upload():
    """SDO upload: upload(1, "6311.01", "00.40") is the request and the device's answer."""

    def pair(node_id, name, raw):
        data = bytes.fromhex(raw.replace(".", ""))
        command = 0x43 | 4 - len(data) << 2
        answer = (
            f"{0x580 + node_id:X}#{command:02X}{multiplexer(name)}{data.ljust(4, bytes(1)).hex()}"
        )
        return f"{0x600 + node_id:X}#" + dotted(f"40{multiplexer(name)}00000000"), answer

    return pair


@pytest.fixture
def download():
    """SDO download: download(1, "1017.00", "64.00") is the request and the device's answer."""

    def pair(node_id, name, raw):
        data = bytes.fromhex(raw.replace(".", ""))
        command = 0x23 | 4 - len(data) << 2
        request = f"{command:02X}{multiplexer(name)}{data.ljust(4, bytes(1)).hex()}"
        return (
            f"{0x600 + node_id:X}#" + dotted(request),
            f"{0x580 + node_id:X}#60{multiplexer(name)}00000000",
        )

    return pair


def multiplexer(name):
    index, subindex = name.split(".")
    return index[2:] + index[:2] + subindex


def dotted(digits):
    return ".".join(re.findall("..", digits.upper()))


@pytest.fixture
def valve_eds():
    return VALVE_408


@pytest.fixture
def encoder_eds():
    return ENCODER_406


@pytest.fixture
def edit_eds(tmp_path):
    """Another maker's EDS: edit_eds(ENCODER_406, {"1A00sub1": 0x60200120}) sets default values."""

    def edit(eds, defaults, *, removed=()):
        parser = configparser.RawConfigParser()
        parser.optionxform = str
        parser.read(eds)
        for section, value in defaults.items():
            parser[section]["DefaultValue"] = str(value)
        for section in list(parser.sections()):
            if section.startswith(tuple(removed)) and removed:
                parser.remove_section(section)
        copy = tmp_path / f"maker_{eds.name}"
        with copy.open("w") as file:
            parser.write(file, space_around_delimiters=False)
        return copy

    return edit


@pytest.fixture
def set_up_tpdo(upload, download):
    """What `setup` says to a device of ours whose TPDO1 has the mapping given.

    The device has an event-driven TPDO1 with a 10 ms timer, and gets type 1 without a timer.
    """

    def steps(node_id, profile, mapping):
        def number(value, size):
            return value.to_bytes(size, "little").hex()

        cob_id = 0x40000180 + node_id
        return [
            upload(node_id, "1000.00", number(profile, 4)),
            # Our EDS files carry vendor 0, which stands for none, and the profile as product code.
            upload(node_id, "1018.02", number(int(str(profile), 16), 4)),
            upload(node_id, "1A00.00", number(len(mapping), 1)),
            *(
                upload(node_id, f"1A00.{place:02X}", number(entry, 4))
                for place, entry in enumerate(mapping, 1)
            ),
            upload(node_id, "1800.01", number(cob_id, 4)),
            upload(node_id, "1800.02", "FF"),
            upload(node_id, "1800.05", "0A.00"),
            download(node_id, "1800.01", number(cob_id | 1 << 31, 4)),
            download(node_id, "1800.02", "01"),
            download(node_id, "1800.05", "00.00"),
            download(node_id, "1800.01", number(cob_id, 4)),
            download(node_id, "1017.00", "64.00"),
        ]

    return steps
