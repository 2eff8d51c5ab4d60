"""Long messages of the J1939 drivers, frame by frame: SAE J1939-21's order, times and aborts."""

import pytest

from hil_drivers import DriverError, DriverTimeoutError, TransferAbortedError
from hil_drivers.j1939.transmission import GAP, Transmission

DEVICE, GROUP = 0x80, 0xEF00
PGN = "00 ef 00"
TO_ALL = 0xFF


class Line:
    """What is sent, with its time, and answers at any time."""

    def __init__(self):
        self.now = 0.0
        self.sent = []
        self.transmission = Transmission(self._note, self._note)

    def begin(self, size, destination=DEVICE):
        data = bytes(number % 251 for number in range(size))
        return self.transmission.begin(GROUP, data, destination, self.now)

    def run(self, until):
        """Let time pass as a network does: serve whenever something is due."""
        while (due := self.transmission.serve(self.now)) <= until:
            self.now = max(self.now, due)
        self.now = until

    def answer(self, data):
        assert self.transmission.take_control(DEVICE, bytes.fromhex(data), self.now)
        self.transmission.serve(self.now)

    def take(self):
        """Return what was sent since the last call, without the times."""
        sent, self.sent = self.sent, []
        return [data for _, data in sent]

    def _note(self, destination, data):
        assert destination in {DEVICE, TO_ALL}
        self.sent.append((round(self.now, 6), data.hex(" ")))


@pytest.fixture
def line():
    return Line()


def test_packets_go_after_the_clearance_and_the_end_is_acknowledged(line):
    transfer = line.begin(15)
    # RTS: 15 bytes in 3 packets, 3 at once.
    assert line.take() == [f"10 0f 00 03 03 {PGN}"]
    line.answer(f"11 02 01 FF FF {PGN}")
    line.run(0.5)
    assert line.take() == ["01 00 01 02 03 04 05 06", "02 07 08 09 0a 0b 0c 0d"]
    line.answer(f"11 01 03 FF FF {PGN}")
    assert line.take() == ["03 0e ff ff ff ff ff ff"]
    assert not transfer.is_over
    line.answer(f"13 0F 00 03 FF {PGN}")
    assert (transfer.is_over, transfer.error) == (True, None)
    assert line.take() == []


def test_packets_to_one_device_do_not_flood_the_interface(line):
    line.begin(1785)
    line.answer(f"11 FF 01 FF FF {PGN}")
    line.run(0.5)
    times = [time for time, _ in line.sent[1:]]
    # A CTS for more than the 16 that the RTS offers gets 16.
    assert times == pytest.approx([number * GAP for number in range(16)])


def test_to_all_a_packet_goes_each_50_ms(line):
    transfer = line.begin(20, TO_ALL)
    line.run(1.0)
    assert [time for time, _ in line.sent] == pytest.approx([0.0, 0.05, 0.10, 0.15])
    assert line.take()[0] == f"20 14 00 03 ff {PGN}"
    assert (transfer.is_over, transfer.error) == (True, None)


@pytest.mark.parametrize(
    ("answer", "limit"),
    [
        (None, 1.25),  # T3, from the RTS
        (f"11 00 01 FF FF {PGN}", 1.05),  # T4, from a CTS that says wait
        (f"11 03 01 FF FF {PGN}", 2 * GAP + 1.25),  # T3, from the last of three packets
    ],
)
def test_a_silent_device_is_given_up(line, answer, limit):
    transfer = line.begin(20)
    if answer:
        line.answer(answer)
    line.run(limit - 0.001)
    assert not transfer.is_over
    line.take()
    line.run(limit + 0.001)
    assert isinstance(transfer.error, DriverTimeoutError)
    assert line.take() == [f"ff 03 ff ff ff {PGN}"]


def test_a_lost_packet_is_sent_twice_again_and_no_more(line):
    transfer = line.begin(20)
    for _ in range(3):  # the first time, and two more
        line.answer(f"11 01 01 FF FF {PGN}")
    assert line.take()[1:] == ["01 00 01 02 03 04 05 06"] * 3
    line.answer(f"11 01 01 FF FF {PGN}")
    assert line.take() == [f"ff 05 ff ff ff {PGN}"]
    assert transfer.error.reason == 5


@pytest.mark.parametrize(
    ("answers", "reason"),
    [
        ([f"11 01 00 FF FF {PGN}"], 7),  # there is no packet 0
        ([f"11 01 02 FF FF {PGN}"], 7),  # before packet 1
        ([f"11 01 01 FF FF {PGN}", f"11 01 04 FF FF {PGN}"], 7),  # of three
        ([f"11 03 01 FF FF {PGN}", f"11 01 02 FF FF {PGN}"], 4),  # while packets go
        ([f"13 14 00 03 FF {PGN}"], 250),  # the end before the first packet
        ([f"11 03 01 FF FF {PGN}", f"13 14 00 03 FF {PGN}"], 250),  # while packets go
    ],
)
def test_an_answer_against_the_rules_ends_it(line, answers, reason):
    transfer = line.begin(20)
    for answer in answers:
        line.answer(answer)
    assert line.take()[-1] == f"ff {reason:02x} ff ff ff {PGN}"
    assert isinstance(transfer.error, TransferAbortedError)
    assert transfer.error.reason == reason


def test_an_acknowledgement_of_another_length_ends_it(line):
    transfer = line.begin(9)
    line.answer(f"11 02 01 FF FF {PGN}")
    line.run(0.1)
    line.answer(f"13 0A 00 02 FF {PGN}")
    assert transfer.error.reason == 250


@pytest.mark.parametrize(
    "reason",  # SAE J1939-21, and one that it does not know
    [
        "1 busy",
        "2 resources",
        "3 timeout",
        "4 cts while sending",
        "5 retransmissions",
        "6 unexpected data",
        "7 bad sequence",
        "8 duplicate",
        "9 too long",
        "250 other",
        "99",
    ],
)
def test_the_device_may_end_it_and_says_why(line, reason):
    transfer = line.begin(20)
    line.take()
    number = int(reason.split()[0])
    line.answer(f"FF {number:02x} FF FF FF {PGN}")
    assert line.take() == []
    assert transfer.error.reason == number
    assert str(transfer.error) == (
        f"J1939 PGN 61184 to address 128, 20 bytes: ended by it, reason {reason}"
    )


def test_answers_about_other_groups_are_not_for_us(line):
    transfer = line.begin(20)
    for answer in ("11 01 07 FF FF CA FE 00", "FF 02 FF FF FF CA FE 00", "13 14 00 03 FF CA FE 00"):
        line.answer(answer)
    assert not transfer.is_over
    assert not line.transmission.take_control(DEVICE, b"\x11\x01\x01", 0.0)  # malformed


def test_one_message_to_a_device_at_a_time(line):
    line.begin(20)
    line.begin(20, TO_ALL)
    with pytest.raises(DriverError, match="to address 128, 20 bytes: is on its way still"):
        line.begin(30)


@pytest.mark.parametrize("size", [8, 1786])
def test_other_lengths_are_refused(line, size):
    with pytest.raises(ValueError, match=f"{size} bytes: 9 to 1785 can be sent"):
        line.begin(size)
    assert line.take() == []
