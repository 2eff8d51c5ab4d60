"""NMT slave: commands, states, what lives in which state (CiA 301, 7.2.8 and 7.3.2)."""

from hil_bench.abilities.conformance.check import Chapter, Degree, Impact
from hil_bench.abilities.conformance.device import BOOT_PATIENCE, DeviceUnderTest, find_fall
from hil_bench.abilities.conformance.scratch import scratch
from hil_bench.abilities.conformance.sdo_client import upload_request
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import NmtCommand, NmtState

CHAPTER = Chapter("NMT", Degree.REQUIRED)


@CHAPTER.check("7.2.8.3.3", "reset node is followed by the boot-up message", Impact.WRITE)
def reset_node(dut: DeviceUnderTest) -> None:
    """Send command 129."""
    _expect_boot_up(dut, NmtCommand.RESET_NODE)


@CHAPTER.check("7.2.8.3.3", "reset communication is followed by the boot-up message", Impact.WRITE)
def reset_communication(dut: DeviceUnderTest) -> None:
    """Send command 130."""
    _expect_boot_up(dut, NmtCommand.RESET_COMMUNICATION)


@CHAPTER.check("7.3.2.2.3", "a started node stays OPERATIONAL", Impact.WRITE)
def stays_operational(dut: DeviceUnderTest) -> None:
    """Reset, start, and watch: what needs OPERATIONAL is not run where this fails.

    Raises:
        Deviation: it does not stay there; the message names the cause.
    """
    dut.fall = find_fall(dut)
    if dut.fall:
        raise Deviation(dut.fall)


@CHAPTER.check("7.3.2.2", "the node enters PRE-OPERATIONAL after the boot-up message", Impact.WRITE)
def after_boot_up(dut: DeviceUnderTest) -> str | None:
    """Reset, then look; 1F80h may ask for OPERATIONAL instead (CiA 302-2).

    A device without it may start by itself: transitions may be initiated locally.
    """
    dut.reset(NmtCommand.RESET_COMMUNICATION)
    right = NmtState.PRE_OPERATIONAL
    if 0x1F80 in dut.objects and not dut.number(0x1F80) & 4:
        right = NmtState.OPERATIONAL
        dut.need_operational()
    with dut.watched():
        if 0x1F80 not in dut.objects and dut.state() is NmtState.OPERATIONAL:
            return "OPERATIONAL, by itself"
        dut.expect_state(right, "boot-up")
    return right.name


@CHAPTER.check("7.2.8.3.1", "start, stop and enter pre-operational do what they say", Impact.WRITE)
def commands(dut: DeviceUnderTest) -> None:
    """Command each change of state between the three states."""
    dut.need_operational()
    path = (
        NmtCommand.START,
        NmtCommand.STOP,
        NmtCommand.START,
        NmtCommand.ENTER_PRE_OPERATIONAL,
        NmtCommand.STOP,
        NmtCommand.ENTER_PRE_OPERATIONAL,
    )
    right = {
        NmtCommand.START: NmtState.OPERATIONAL,
        NmtCommand.STOP: NmtState.STOPPED,
        NmtCommand.ENTER_PRE_OPERATIONAL: NmtState.PRE_OPERATIONAL,
    }
    with dut.watched():
        for command in path:
            dut.command(command)
            dut.expect_state(right[command], command.name)


@CHAPTER.check("7.2.8.3.1", "a command to node 0 is for all nodes", Impact.WRITE)
def broadcast(dut: DeviceUnderTest) -> None:
    """Start and stop all, where nobody else is on the bus."""
    if dut.others:
        raise NotApplicable(f"nodes {', '.join(map(str, sorted(dut.others)))} would obey, too")
    with dut.watched():
        dut.command(NmtCommand.STOP, 0)
        dut.expect_state(NmtState.STOPPED, "STOP to node 0")
        dut.command(NmtCommand.ENTER_PRE_OPERATIONAL, 0)
        dut.expect_state(NmtState.PRE_OPERATIONAL, "ENTER_PRE_OPERATIONAL to node 0")


@CHAPTER.check("7.2.8.3.1", "a command to another node is not obeyed", Impact.WRITE)
def other_node(dut: DeviceUnderTest) -> None:
    """Stop a node-ID that nobody has."""
    other = dut.free_node_id
    with dut.watched():
        dut.command(NmtCommand.STOP, other)
        dut.expect_state(NmtState.PRE_OPERATIONAL, f"STOP to node {other}")


@CHAPTER.check("7.2.8.3.1", "what is no NMT command is not obeyed", Impact.WRITE)
def malformed(dut: DeviceUnderTest) -> None:
    """Send an unknown command, commands of one and of no byte, remote and 29-bit frames."""
    stop = bytes([NmtCommand.STOP, dut.node_id])
    with dut.watched():
        for frame, what in (
            (Frame(0x000, bytes([3, dut.node_id])), "command 3"),
            (Frame(0x000, stop[:1]), "one byte"),
            (Frame(0x000, b""), "no byte"),
            (Frame(0x000, is_remote=True), "a remote frame"),
            (Frame(0x000, stop, is_extended=True), "a 29-bit identifier"),
        ):
            dut.wire.send(frame)
            dut.expect_state(NmtState.PRE_OPERATIONAL, what)


@CHAPTER.check("7.3.2.3", "STOPPED has no SDO; leaving it brings SDO back", Impact.WRITE)
def stopped_has_no_sdo(dut: DeviceUnderTest) -> None:
    """Read in STOPPED, then in PRE-OPERATIONAL."""
    dut.command(NmtCommand.STOP)
    try:
        dut.sdo.expect_silence(upload_request(0x1000))
    finally:
        dut.command(NmtCommand.ENTER_PRE_OPERATIONAL)
    dut.wire.wait(dut.settling)
    dut.sdo.upload(0x1000)


@CHAPTER.check("7.3.2.3", "OPERATIONAL has SDO", Impact.WRITE)
def operational_has_sdo(dut: DeviceUnderTest) -> None:
    """Read in OPERATIONAL."""
    with dut.operational():
        dut.sdo.upload(0x1000)


@CHAPTER.check(
    "7.3.2.2.1", "reset communication restores the communication parameters", Impact.WRITE
)
def reset_restores(dut: DeviceUnderTest) -> str:
    """Change a time of the communication profile, reset, read it."""
    with scratch(dut) as variable:
        key = variable.index, variable.subindex
        dut.boot()
        power_on = dut.number(*key)
        dut.write(*key, power_on ^ 0x40)
        dut.boot()
        found = dut.number(*key)
        if found != power_on:
            raise Deviation(f"{variable.name} is {found} after the reset; {power_on} is right")
        return variable.name


def _expect_boot_up(dut: DeviceUnderTest, command: NmtCommand) -> None:
    """Judge that a reset is followed by a boot-up message; no other check does.

    Raises:
        Deviation: none came.
    """
    if not dut.reset(command, insists=True):
        raise Deviation(f"no boot-up message within {BOOT_PATIENCE:g} s after NMT {command.name}")
    dut.command(NmtCommand.ENTER_PRE_OPERATIONAL)
    dut.wire.wait(dut.settling)
