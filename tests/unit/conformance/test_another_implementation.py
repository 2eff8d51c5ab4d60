"""The suite on a device that is not ours: `canopen.LocalNode`, whose gaps are known.

What it does rightly passes, so the suite does not merely know our own frames; what it is documented
not to do, or what its sources show, fails under its clause.
"""

import canopen
import pytest

from hil_bench.abilities.conformance.check import Impact
from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.suite import CHAPTERS, Outcome, run_suite
from hil_bench.abilities.conformance.wire import Wire
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.transports.embedded import EmbeddedBus

CHECKED = {"NMT", "Object dictionary", "SDO upload", "SDO download", "SDO block transfer"}


class CaptiveNetwork(canopen.Network):
    """Hands a `LocalNode` its frames, and keeps what it sends."""

    def __init__(self):
        super().__init__()
        self.sent = []

    def send_message(self, can_id, data, remote=False):
        self.sent.append(Frame(can_id, bytes(data), is_remote=remote))

    def send_periodic(self, _can_id, _data, _period, _remote=False):
        class Task:  # its heartbeat is a thread of python-can, which has no virtual time
            def stop(self):
                pass

            def update(self, data):
                pass

        return Task()

    def tick(self, frames, now):
        for frame in frames:
            # Remote and 29-bit frames do not get as far as a node's SDO server.
            if not frame.is_remote and not frame.is_extended and frame.data:
                self.notify(frame.can_id, bytearray(frame.data), now * 1e-9)
        sent, self.sent = self.sent, []
        return sent


@pytest.fixture(scope="module")
def outcomes(request):
    """What each check found, by clause and text."""
    eds = request.config.rootpath / "tests" / "unit" / "canopen_device" / "device.eds"
    network = CaptiveNetwork()
    node = canopen.LocalNode(5, str(eds))
    node.associate_network(network)
    chapters = [chapter for chapter in CHAPTERS if chapter.title in CHECKED]
    with EmbeddedBus(network.tick) as bus:
        dut = DeviceUnderTest(Wire(bus, bus.now), 5, load_eds(eds, 5))
        results = list(run_suite(dut, Impact.WRITE, chapters))
    return {(result.check.clause, result.check.text): result.outcome for result in results}


@pytest.mark.parametrize(
    ("clause", "text"),
    [
        ("7.5.2.1", "1000h has the device type of the EDS"),
        ("7.5.2.21", "1018h has the identity of the EDS"),
        ("7.2.4.3.17", "reading a write-only object aborts with 0601 0001h"),
        ("7.2.4.3.17", "reading an object that does not exist aborts with 0602 0000h"),
        ("7.2.4.3.6", "an expedited answer states its length and names the object"),
        ("7.2.4.3.7", "a longer object comes in segments with alternating toggle bits"),
        ("7.2.4.3.17", "a toggle bit that does not alternate aborts with 0503 0000h"),
        ("7.2.4.3.3", "an expedited download is confirmed and can be read back"),
        ("7.2.4.3.4", "a segmented download of a long object is read back"),
        (
            "7.2.4.3.17",
            "a segment with a wrong toggle bit aborts with 0503 0000h, or counts for nothing",
        ),
        ("7.3.2.3", "OPERATIONAL has SDO"),
    ],
)
def test_what_it_does_rightly_passes(outcomes, clause, text):
    assert outcomes[clause, text] is Outcome.PASSED


@pytest.mark.parametrize(
    ("clause", "text"),
    [
        # NmtSlave sends a boot-up message when it leaves INITIALISING by a command, not by a reset.
        ("7.2.8.3.3", "reset communication is followed by the boot-up message"),
        ("7.3.2.3", "STOPPED has no SDO; leaving it brings SDO back"),
        # LocalNode.set_data knows no limits, _find_object no sub-index of a VAR.
        ("7.2.4.3.17", "a value beyond the EDS's limits aborts and changes nothing"),
        ("7.2.4.3.17", "reading a sub-index that does not exist aborts with 0609 0011h"),
        # SdoServer keeps its buffer after an abort, and answers a block upload by a plain one.
        ("7.2.4.3.17", "an abort from the client gets no answer, and ends the transfer"),
        ("7.2.4.3.13", "a plain upload takes its place up to the threshold only"),
    ],
)
def test_what_it_does_not_fails_under_its_clause(outcomes, clause, text):
    assert outcomes[clause, text] is Outcome.FAILED


def test_block_transfer_that_it_does_not_have_is_no_failure(outcomes):
    clause = "7.2.4.3.9", "a block download with CRC is taken and read back"
    assert outcomes[clause] is Outcome.NOT_APPLICABLE
