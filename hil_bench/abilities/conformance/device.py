"""The device under test: its EDS, its bus, and what the checks do with it again and again."""

import contextlib
import struct
from collections.abc import Iterable, Iterator
from functools import cached_property

from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable, NotRun
from hil_bench.abilities.conformance.wire import (
    ANSWER,
    LATEST,
    REQUEST,
    SdoClient,
    Wire,
    download_request,
    is_data,
    upload_request,
)
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import NmtCommand, NmtState
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable
from hil_bench.config.objects import name_object

BOOT_PATIENCE = 5.0
"""Longest wait for the boot-up message [s]; a device may take its time to start."""

HEARTBEAT_MS = 50
"""Heartbeat by which the NMT state is watched [ms]."""

HEARTBEAT_TIME = (0x1017, 0)

_ERROR_CONTROL, _EMERGENCY = 0x700, 0x080
_TOGGLE = 0x80
_NODE_IDS = range(1, 128)


class DeviceUnderTest:
    """One device.

    Attributes:
        wire: the bus it is on.
        node_id: its node-ID.
        objects: what its EDS says of it.
        patience: longest wait for an answer, and how long silence is waited for [s].
        settling: time that the device is given to act on a frame that it does not answer [s].
        sdo: its default SDO channel.
        fall: why it does not stay OPERATIONAL; empty while nothing says so.
        absence: since when it answers nothing; empty while it answers.
        was_started: whether a check has relied on OPERATIONAL since somebody cleared this.
    """

    def __init__(
        self, wire: Wire, node_id: int, objects: ObjectDictionary, patience: float = 0.5
    ) -> None:
        self.wire = wire
        self.node_id = node_id
        self.objects = objects
        self.patience = patience
        self.settling = patience / 25
        self.sdo = SdoClient(wire, REQUEST + node_id, ANSWER + node_id, patience)
        self.fall = ""
        self.absence = ""
        self.was_started = False
        self._sends_boot_up = True

    def command(self, command: NmtCommand, node_id: int | None = None) -> None:
        """Send an NMT command, to this device unless told otherwise."""
        target = self.node_id if node_id is None else node_id
        self.wire.send(Frame(0x000, bytes([command, target])))

    def tell(self, *frames: Frame) -> None:
        """Send frames, and give the device time to act on them."""
        self.wire.send(*frames)
        self.wire.wait(self.settling)

    def rest(self) -> None:
        """Have the device in PRE-OPERATIONAL."""
        self.command(NmtCommand.ENTER_PRE_OPERATIONAL)
        self.wire.wait(self.settling)

    def boot(self, command: NmtCommand = NmtCommand.RESET_COMMUNICATION) -> None:
        """Reset the device and have it in PRE-OPERATIONAL, with or without a boot-up message.

        A device may start by itself (1F80h). `Deviation` where it does not answer again.
        """
        self.reset(command)
        self.rest()

    def reset(self, command: NmtCommand, *, insists: bool = False) -> bool:
        """Reset the device, wait until it is there again; return whether it sent its boot-up.

        Args:
            command: which reset.
            insists: wait for the boot-up even where it stayed out before; without that the device
                is there as soon as it answers an SDO request, `Deviation` where it never does.
        """
        self.wire.forget()
        self.command(command)
        boot_up = None
        if self._sends_boot_up or insists:
            boot_up = self.wire.take(self.is_boot_up, BOOT_PATIENCE)
            self._sends_boot_up = boot_up is not None
        if boot_up is None:
            self._wait_for_answer(command)
        self.wire.wait(self.settling)  # for a device that answers before it can
        return boot_up is not None

    def _wait_for_answer(self, command: NmtCommand) -> None:
        """Read until an answer comes.

        Raises:
            Deviation: none came.
        """
        self.wire.wait(self.patience)  # what still answers now may reset a moment later
        deadline = self.wire.now() + BOOT_PATIENCE
        while self.wire.now() < deadline:
            if self.sdo.catches_up(self.patience):
                return
        raise Deviation(f"no boot-up message and no answer after NMT {command.name}")

    def number(self, index: int, subindex: int = 0) -> int:
        """Return an unsigned number that the device holds."""
        return int.from_bytes(self.sdo.upload(index, subindex), "little")

    def write(self, index: int, subindex: int, value: int) -> None:
        """Write an unsigned number, as long as the EDS says."""
        size = self.variable(index, subindex).data_type.size
        self.sdo.download(index, subindex, value.to_bytes(size, "little"))

    def expect_abort(self, index: int, subindex: int, value: int, *codes: int) -> int:
        """Write a number that must be refused, and return the abort code."""
        size = self.variable(index, subindex).data_type.size
        request = download_request(index, subindex, value.to_bytes(size, "little"))
        return self.sdo.expect_abort(request, *codes)

    def expect_kept(
        self, index: int, subindex: int, values: Iterable[int], *codes: int
    ) -> set[int]:
        """Write numbers that must be refused, and return the abort codes.

        What was there before is restored where one was taken.
        """
        before = self.number(index, subindex)
        found = set()
        for value in values:
            try:
                found.add(self.expect_abort(index, subindex, value, *codes))
            finally:
                if self.number(index, subindex) != before:
                    self.write(index, subindex, before)
        return found

    @contextlib.contextmanager
    def setting(self, index: int, subindex: int, value: int) -> Iterator[None]:
        """Write a number, and restore what was there at the end."""
        before = self.number(index, subindex)
        self.write(index, subindex, value)
        try:
            yield
        finally:
            self.write(index, subindex, before)

    def variable(self, index: int, subindex: int = 0) -> Variable:
        """Return the EDS entry of an object.

        Raises:
            NotApplicable: it does not have it.
        """
        variable = self.objects.find(index, subindex)
        if variable is None:
            raise NotApplicable(f"the EDS has no {name_object(index, subindex)}")
        return variable

    def writable(self, index: int, subindex: int = 0) -> Variable:
        """Return the EDS entry of a writable object.

        Raises:
            NotApplicable: it cannot.
        """
        variable = self.variable(index, subindex)
        if not variable.access.writable:
            raise NotApplicable(
                f"{name_object(index, subindex)} is {variable.access.value} in the EDS"
            )
        return variable

    def need_operational(self) -> None:
        """Rely on OPERATIONAL from here on.

        Raises:
            NotRun: the device is known not to stay there.
        """
        if self.fall:
            raise NotRun(self.fall)
        self.was_started = True

    @contextlib.contextmanager
    def operational(self) -> Iterator[None]:
        """Start the node, and take it back to PRE-OPERATIONAL at the end.

        `NotRun` where the device is known not to stay OPERATIONAL.
        """
        self.need_operational()
        self.wire.forget()
        self.command(NmtCommand.START)
        self.wire.wait(self.settling)
        try:
            yield
        finally:
            self.rest()
            self.wire.forget()

    @contextlib.contextmanager
    def watched(self) -> Iterator[None]:
        """Have the device tell its NMT state by a heartbeat; where it has none, by guarding.

        Raises:
            NotApplicable: it has neither, and the EDS promises neither.
        """
        variable = self.objects.find(*HEARTBEAT_TIME)
        if variable is None and 0x100C not in self.objects and self.guard() is None:
            raise NotApplicable(
                "the device reports its NMT state neither by heartbeat nor guarding"
            )
        if variable is None or not variable.access.writable:
            yield
            return
        with self.setting(*HEARTBEAT_TIME, HEARTBEAT_MS):
            try:
                yield
            finally:
                self.rest()

    def state(self) -> NmtState:
        """Return the NMT state that the device tells now, within `watched`.

        Raises:
            Deviation: it tells none, or an impossible one.
        """
        self.wire.wait(self.settling)  # for a command that was sent just now
        self.wire.forget()
        arrival = self.wire.take(self.is_error_control, max(self.patience, 4 * HEARTBEAT_MS / 1000))
        data = self.guard() if arrival is None else arrival.frame.data
        if data is None:
            raise Deviation("neither a heartbeat nor an answer to node guarding")
        try:
            (state,) = data
            return NmtState(state & ~_TOGGLE)
        except ValueError:
            raise Deviation(f"error control {data.hex()} is no NMT state") from None

    def expect_state(self, right: NmtState, after: str) -> None:
        """Judge the NMT state.

        Raises:
            Deviation: it is another one.
        """
        state = self.state()
        if state is not right:
            raise Deviation(f"{state.name} after {after}; {right.name} is right")

    def guard(self) -> bytes | None:
        """Ask for the NMT state by a remote frame; None where no answer comes."""
        self.wire.forget()
        self.wire.send(Frame(_ERROR_CONTROL + self.node_id, is_remote=True))
        arrival = self.wire.take(self.is_error_control, self.patience)
        return None if arrival is None else arrival.frame.data

    def emergency(self, code: int, cause: str) -> bytes:
        """Return the next emergency message with a code.

        Raises:
            Deviation: none came.
        """
        arrival = self.wire.take(lambda frame: self.reports(frame, code), self.patience)
        if arrival is None:
            raise Deviation(f"no EMCY {code:04X}h within {self.patience:g} s after {cause}")
        return arrival.frame.data

    def reports(self, frame: Frame, code: int) -> bool:
        """Return True if a frame is the device's EMCY with a code."""
        return self.is_emergency(frame) and frame.data[:2] == struct.pack("<H", code)

    def is_error_control(self, frame: Frame) -> bool:
        """Return True if a frame is the device's heartbeat, boot-up or answer to node guarding."""
        return is_data(frame, _ERROR_CONTROL + self.node_id)

    def is_boot_up(self, frame: Frame) -> bool:
        """Return True if a frame is the device's boot-up message."""
        return self.is_error_control(frame) and frame.data == b"\0"

    def is_emergency(self, frame: Frame) -> bool:
        """Return True if a frame is the device's EMCY, by the predefined connection set."""
        return is_data(frame, _EMERGENCY + self.node_id)

    def is_error(self, frame: Frame) -> bool:
        """Return True if a frame is the device's EMCY of an error, not of the end of one."""
        return self.is_emergency(frame) and frame.data[1:2] != b"\0"

    @cached_property
    def others(self) -> frozenset[int]:
        """Node-IDs of the other nodes on the bus: those that answer an SDO request."""
        self.wire.forget()
        for node_id in _NODE_IDS:
            if node_id != self.node_id:
                self.wire.send(Frame(REQUEST + node_id, upload_request(0x1000)))
                self.wire.wait(0.001)
        answers = self.wire.take_all(
            lambda frame: frame.can_id & 0x780 == ANSWER and not frame.is_extended, self.patience
        )
        return frozenset(answer.frame.can_id & 0x7F for answer in answers) - {self.node_id}

    @property
    def free_node_id(self) -> int:
        """The highest node-ID that nobody has.

        Raises:
            NotApplicable: somebody has each.
        """
        free = set(_NODE_IDS) - self.others - {self.node_id}
        if not free:
            raise NotApplicable("no node-ID is free")
        return max(free)


# Causes that many checks would find again: a device that leaves OPERATIONAL, or falls silent.
#
# CiA 301 lets a device leave OPERATIONAL by an error of its own (1029h). It then sends no PDO and
# takes none: the checks of these would each find a consequence. A device that no longer answers
# passes no check at all, and fails none by itself.


def find_fall(dut: DeviceUnderTest, *, reset: bool = True) -> str:
    """Start the node, watch it, and return why it does not stay OPERATIONAL; empty where it does.

    Args:
        dut: the device; it is in PRE-OPERATIONAL afterwards.
        reset: whether to reset its communication first, and with it what passed before.

    `NotApplicable` where the device reports its state by no service, `Deviation` where it should.
    """
    if reset:
        dut.boot()
    errors_before = _errors(dut, _taken(dut, 0.0))
    with dut.watched():
        dut.wire.forget()
        dut.command(NmtCommand.START)
        frames = _taken(dut, max(dut.patience, 4 * HEARTBEAT_MS / 1000))
        state = dut.state()
        if state is NmtState.OPERATIONAL:
            return ""
        was_there = any(dut.is_error_control(f) and _is_operational(f) for f in frames)
        errors = _errors(dut, frames)
        if errors and was_there:
            return f"the device leaves OPERATIONAL by EMCY 0x{errors[0]:04X}"
        if errors:
            return f"the device does not become OPERATIONAL: EMCY 0x{errors[0]:04X} after START"
        begin = "leaves OPERATIONAL" if was_there else "does not become OPERATIONAL"
        return f"the device {begin}: {_errors_present(dut, errors_before)}"


def fall_after(dut: DeviceUnderTest) -> str:
    """Return why a device was not OPERATIONAL during a check that has just failed; empty if it was.

    Where it does not recover by a reset, `dut.fall` keeps the cause for the checks to come.
    """
    with contextlib.suppress(Deviation, NotApplicable):
        dut.sdo.abort()
        cause = find_fall(dut, reset=False)
        if not cause:
            return ""
        dut.fall = find_fall(dut)
        return dut.fall or f"{cause}, until its reset"
    return ""


def absence_after(dut: DeviceUnderTest, check: str) -> str:
    """Return that a device has answered nothing since a check has just failed; empty if it answers.

    Args:
        dut: the device; `dut.absence` keeps the cause for the checks to come.
        check: the text of the check.
    """
    deadline = dut.wire.now() + BOOT_PATIENCE
    while (remaining := deadline - dut.wire.now()) > 0.0:
        if is_there(dut, min(LATEST, remaining)):
            return ""
    dut.absence = f'the device answers no SDO request since the check "{check}"'
    return f"the device answers no SDO request afterwards, for {BOOT_PATIENCE:g} s"


def is_there(dut: DeviceUnderTest, timeout: float) -> bool:
    """Return True if a device answers a read, with whatever, within a time [s]."""
    if not dut.sdo.catches_up(timeout):
        return False
    dut.absence = ""
    dut.wire.forget()
    return True


def _errors_present(dut: DeviceUnderTest, errors_before: list[int]) -> str:
    """Describe the errors that the device reports, where no EMCY followed the command."""
    words = [f"EMCY 0x{code:04X} came before" for code in errors_before[:1]]
    register = dut.number(0x1001)
    if register:
        words.append(f"error register 0x{register:02X}")
    if register and not errors_before and 0x1003 in dut.objects and dut.number(0x1003):
        words.append(f"latest error 0x{dut.number(0x1003, 1) & 0xFFFF:04X}")
    return ", ".join(words) or "it reports no error"


def _taken(dut: DeviceUnderTest, duration: float) -> list[Frame]:
    """Return the frames that report an error or the NMT state, and come within a time [s]."""

    def is_report(frame: Frame) -> bool:
        return dut.is_emergency(frame) or dut.is_error_control(frame)

    return [arrival.frame for arrival in dut.wire.take_all(is_report, duration)]


def _is_operational(frame: Frame) -> bool:
    return len(frame.data) == 1 and frame.data[0] & 0x7F == NmtState.OPERATIONAL


def _errors(dut: DeviceUnderTest, frames: Iterable[Frame]) -> list[int]:
    """Return the codes of the errors that begin among some frames, in order."""
    codes = [
        int.from_bytes(frame.data[:2], "little") for frame in frames if dut.is_emergency(frame)
    ]
    return [code for code in codes if code >> 8]  # 00xxh reports the end of one
