"""A bus that plays a transcript: it answers what it expects, and nothing else may be sent."""

import re
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import can
import pytest

from drivers import Network

Step = tuple[str | None, str | Sequence[str] | None]
"""A frame that the driver must send, and what then comes back; None for nothing.

Frames are written as candump writes them: "601#40.00.10.00.00.00.00.00", "R" for a remote frame.
"""


def parse(text: str) -> can.Message:
    """Returns the message that candump would print so; eight digits are a 29-bit identifier."""
    identifier, data = text.split("#")
    remote = data == "R"
    return can.Message(
        arbitration_id=int(identifier, 16),
        is_extended_id=len(identifier) == 8,
        is_remote_frame=remote,
        data=None if remote else bytes.fromhex(data.replace(".", "")),
    )


def show(message: can.Message) -> str:
    return f"{message.arbitration_id:03X}#{message.data.hex('.').upper()}"


class TranscriptBus(can.BusABC):
    """Plays a transcript in virtual time: only waiting in `recv` lets it pass."""

    def __init__(self) -> None:
        self.channel_info = "transcript"
        self.time = 100.0
        self.sent: list[str] = []
        self.steps: deque[Step] | None = None
        self.waiting: deque[can.Message] = deque()
        super().__init__(channel="transcript")

    def now(self) -> float:
        return self.time

    def play(self, *frames: str) -> None:
        """Puts frames on the bus now."""
        self.waiting.extend(parse(frame) for frame in frames)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        frame = show(msg)
        self.sent.append(frame)
        if self.steps is None:
            return
        assert self.steps, f"sent {frame} after the end of the transcript"
        expected, answer = self.steps.popleft()
        assert frame == expected
        self.play(*([answer] if isinstance(answer, str) else answer or []))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if self.waiting:
            return self.waiting.popleft()
        assert timeout is not None, "waits for ever"
        self.time += timeout
        return None


@pytest.fixture
def bus() -> Iterator[TranscriptBus]:
    bus = TranscriptBus()
    yield bus
    bus.shutdown()


@pytest.fixture
def network(bus: TranscriptBus) -> Network:
    return Network(bus, clock=bus.now)


@pytest.fixture
def expected_protocol(bus: TranscriptBus) -> Callable:
    """Context in which exactly these pairs of frames must pass, in this order."""

    @contextmanager
    def expect(steps: Sequence[Step]) -> Iterator[None]:
        bus.steps = deque(steps)
        yield
        left, bus.steps = bus.steps, None
        assert not left, f"not sent: {[expected for expected, _ in left]}"

    return expect


@pytest.fixture
def upload() -> Callable[[int, str, str], Step]:
    """SDO upload: upload(1, "6311.01", "00.40") is the request and the device's answer."""

    def pair(node_id: int, name: str, raw: str) -> Step:
        data = bytes.fromhex(raw.replace(".", ""))
        command = 0x43 | 4 - len(data) << 2
        answer = f"{580 + node_id}#{command:02X}{multiplexer(name)}{data.ljust(4, bytes(1)).hex()}"
        return f"{600 + node_id}#" + dotted(f"40{multiplexer(name)}00000000"), answer

    return pair


@pytest.fixture
def download() -> Callable[[int, str, str], Step]:
    """SDO download: download(1, "1017.00", "64.00") is the request and the device's answer."""

    def pair(node_id: int, name: str, raw: str) -> Step:
        data = bytes.fromhex(raw.replace(".", ""))
        command = 0x23 | 4 - len(data) << 2
        request = f"{command:02X}{multiplexer(name)}{data.ljust(4, bytes(1)).hex()}"
        return (
            f"{600 + node_id}#" + dotted(request),
            f"{580 + node_id}#60{multiplexer(name)}00000000",
        )

    return pair


def multiplexer(name: str) -> str:
    index, subindex = name.split(".")
    return index[2:] + index[:2] + subindex


def dotted(digits: str) -> str:
    return ".".join(re.findall("..", digits.upper()))
