"""Any dialogue with the SDO server: the answer is legal or silence, and nothing is left behind."""

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule, run_state_machine_as_test

from hil_bench.canopen_device.sdo import BUFFER_SIZE
from hil_bench.canopen_device.sdo_block import SEGMENTS_PER_ROUND, BlockUpload

NODE_ID = 5
OBJECTS = st.sampled_from(
    [0x1003, 0x1008, 0x1010, 0x1017, 0x1018, 0x1201, 0x1600, 0x1800, 0x2020, 0x2021, 0x2022, 0x2024]
)
TAIL = st.binary(min_size=4, max_size=4) | st.sampled_from([bytes(4), b"\x09\0\0\0", b"\x7f\0\0\0"])
BEGINNINGS = st.sampled_from(
    [0x20, 0x21, 0x22, 0x23, 0x2B, 0x2F, 0x40, 0xA0, 0xA4, 0xC0, 0xC2, 0xC6]
)
CONTINUATIONS = st.sampled_from([0x00, 0x01, 0x10, 0x11, 0x60, 0x70, 0xA1, 0xA3, 0xC1, 0xC5, 0xD9])


def is_legal(answer):
    """Whether it is a frame of an SDO server (CiA 301), but for a segment of a block upload."""
    command = answer[0]
    scs, rest, unused = command >> 5, command & 0x1F, command >> 1 & 7
    return {
        # Upload segment: toggle, number of unused bytes, last.
        0: answer[8 - unused :] == bytes(unused),
        1: rest & 0x0F == 0 and answer[1:] == bytes(7),  # download segment
        2: rest & 0x13 == 0x03 or rest == 0x01,  # initiate upload: expedited, or a size alone
        3: rest == 0 and answer[4:] == bytes(4),  # initiate download
        4: command == 0x80 and answer[7] in {0x05, 0x06, 0x08},  # abort
        5: command in {0xA4, 0xA2, 0xA1},  # block download: initiate with CRC, confirmation, end
        # Block upload: initiate with CRC and size, or end with the number of unused bytes.
        6: command == 0xC6 or command & 0xE3 == 0xC1,
        7: False,
    }[scs]


class Dialogue(RuleBasedStateMachine):
    """A client that says what it likes, when it likes."""

    def __init__(self, rig):
        super().__init__()
        self.rig = rig

    @rule(command=BEGINNINGS, index=OBJECTS, subindex=st.integers(0, 2), tail=TAIL)
    def begin(self, command, index, subindex, tail):
        self.ask(bytes([command]) + index.to_bytes(2, "little") + bytes([subindex]) + tail)

    @rule(command=CONTINUATIONS, tail=st.binary(min_size=7, max_size=7) | st.just(bytes(7)))
    def go_on(self, command, tail):
        self.ask(bytes([command]) + tail)

    @rule(count=st.integers(1, 130), is_last=st.booleans(), skipped=st.sets(st.integers(1, 130)))
    def send_sub_block(self, count, is_last, skipped):
        for number in range(1, count + 1):
            if number not in skipped:
                last = is_last and number == count
                self.ask(bytes([number & 0x7F | last << 7]) + bytes(7))

    @rule(acknowledged=st.integers(0, 130), size=st.integers(0, 130))
    def confirm(self, acknowledged, size):
        self.ask(bytes([0xA2, acknowledged, size]) + bytes(5))

    @rule(request=st.binary(max_size=8))
    def say_anything(self, request):
        self.ask(request)

    @rule(code=st.binary(min_size=7, max_size=7))
    def abort(self, code):
        self.ask(b"\x80" + code)

    @rule(milliseconds=st.integers(0, 1500))
    def wait(self, milliseconds):
        self.run(milliseconds)

    @rule(command=st.sampled_from([0x01, 0x02, 0x80, 0x81, 0x82]))
    def command(self, command):
        self.rig.receive(0x000, bytes([command, NODE_ID]))
        self.run()

    @invariant()
    def memory_is_bounded(self):
        transfer = self.server._transfer
        assert len(self.server._queue) == 0
        assert len(getattr(transfer, "_data", b"")) <= BUFFER_SIZE + 7

    def teardown(self):
        """Leave the client silent: what it left behind is freed, and the next one is served."""
        self.rig.receive(0x000, bytes([0x80, NODE_ID]))
        for _ in range(20):
            self.rig.run(1000)
        assert self.server._transfer is None
        answers = self.rig.request(bytes.fromhex("4000100000000000"))
        assert answers == [bytes.fromhex("4300100091010000")]

    @property
    def server(self):
        return self.rig.node._sdo._default

    def ask(self, request):
        self.rig.receive(0x600 + NODE_ID, request)
        self.run()

    def run(self, milliseconds=1):
        was_uploading = isinstance(self.server._transfer, BlockUpload)
        frames = self.rig.run(milliseconds)
        answers = [frame.data for frame in frames if frame.can_id == 0x580 + NODE_ID]
        assert all(len(answer) == 8 for answer in answers)
        if was_uploading:
            assert len(answers) <= 1 + SEGMENTS_PER_ROUND
            assert all(is_legal(answer) or answer[0] & 0x7F for answer in answers)
        else:
            assert len(answers) <= 1
            assert all(map(is_legal, answers))


def test_any_dialogue(make_rig):
    run_state_machine_as_test(
        lambda: Dialogue(make_rig()),
        settings=settings(max_examples=60, stateful_step_count=40, deadline=None),
    )
