"""A bus in virtual time for ECUs of J1939, and a partner that sends what a test says."""

from collections.abc import Iterable

from hil_bench.abilities.j1939.protocol.ecu import Ecu
from hil_bench.abilities.j1939.protocol.signals import Name, split
from hil_bench.canopen_device.frame import Frame

MILLISECOND = 1_000_000


class J1939Bus:
    """ECUs that hear each other, a millisecond after they have sent.

    Attributes:
        now: time [ns].
        log: time [ms], identifier and data of all frames that the ECUs have sent.
    """

    def __init__(self, *ecus: Ecu) -> None:
        self.now = 0
        self.log: list[tuple[int, int, str]] = []
        self._ecus = ecus
        self._sent: list[tuple[Ecu, Frame]] = []
        for ecu in ecus:
            ecu.start(0)
        self._serve()

    def run(self, milliseconds: int) -> None:
        """Let time pass."""
        for _ in range(milliseconds):
            self.now += MILLISECOND
            heard, self._sent = self._sent, []
            for sender, frame in heard:
                for ecu in self._ecus:
                    if ecu is not sender:
                        ecu.receive(frame, self.now)
            self._serve()

    def say(self, can_id: int, data: str) -> list[tuple[int, str]]:
        """Send a frame from nobody of them; return what the ECUs answer at once."""
        before = len(self.log)
        frame = Frame(can_id, bytes.fromhex(data), is_extended=True)
        for ecu in self._ecus:
            ecu.receive(frame, self.now)
        self._serve()
        return [(can_id, data) for _, can_id, data in self.log[before:]]

    def sent(self, group: int) -> list[tuple[int, str]]:
        """Return time [ms] and data of the frames of a parameter group."""
        return [(time, data) for time, can_id, data in self.log if split(can_id).group == group]

    def _serve(self) -> None:
        for ecu in self._ecus:
            frames: list[Frame] = []
            ecu.serve(self.now, frames.append)
            self._sent += [(ecu, frame) for frame in frames]
            self.log += [
                (self.now // MILLISECOND, frame.can_id, frame.data.hex(" ")) for frame in frames
            ]


def make_ecu(address: int, identity: int = 1, *, arbitrary: bool = False) -> Ecu:
    """Return an ECU of a NAME that only its identity tells from others."""
    return Ecu(Name(identity=identity, arbitrary_address=arbitrary), address)


def collect(ecu: Ecu, groups: Iterable[int]) -> list[tuple[int, int, bytes]]:
    """Return the list that the ECU's messages of these groups come to: PGN, source, data."""
    found: list[tuple[int, int, bytes]] = []
    for group in groups:
        ecu.take(group, lambda source, data, _, group=group: found.append((group, source, data)))
    return found
