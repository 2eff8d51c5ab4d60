"""NMT slave: commands, states, what lives in which state (CiA 301, 7.2.8 and 7.3.2).

And what is stored beyond a reset (7.5.2.13 and 7.5.2.14).
"""

import contextlib
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Final

from hil_bench.abilities.conformance.check import Chapter, Degree, Impact
from hil_bench.abilities.conformance.device import (
    BOOT_PATIENCE,
    HEARTBEAT_TIME,
    DeviceUnderTest,
    find_fall,
)
from hil_bench.abilities.conformance.pdo import COB_ID, INVALID, RPDOS, TPDOS
from hil_bench.abilities.conformance.scratch import HARMLESS
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable, Refused
from hil_bench.abilities.conformance.wire import download_request, upload_request
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import NmtCommand, NmtState
from hil_bench.config.objects import name_object

NMT = Chapter("NMT", Degree.REQUIRED)
STORAGE = Chapter("Store and restore")

_STORE, _RESTORE, _STARTUP = 0x1010, 0x1011, 0x1F80
_NO_SELF_START = 1 << 2
_ALL = 1
_NOT_STORED = (0x08000020, 0x08000021, 0x08000022)
_ON_COMMAND = 1
_TRIAL_MS = 4321
_BITS_TO_CHANGE: Final[Mapping[tuple[int, int], int]] = MappingProxyType(
    {(0x1005, 0): 0x40, (0x1014, 0): INVALID, (0x1019, 0): 0x40, (0x1029, 1): 1}
    | dict.fromkeys(HARMLESS, 0x40)
)
"""Numbers of the communication profile, and bits whose change moves nothing."""
_PATIENCE = 10.0
"""Longest wait until a device has stored its parameters [s]."""


@NMT.check("7.2.8.3.3", "reset node is followed by the boot-up message")
def reset_node(dut: DeviceUnderTest) -> None:
    """Send command 129."""
    _expect_boot_up(dut, NmtCommand.RESET_NODE)


@NMT.check("7.2.8.3.3", "reset communication is followed by the boot-up message")
def reset_communication(dut: DeviceUnderTest) -> None:
    """Send command 130."""
    _expect_boot_up(dut, NmtCommand.RESET_COMMUNICATION)


@NMT.check("7.3.2.2.3", "a started node stays OPERATIONAL")
def stays_operational(dut: DeviceUnderTest) -> None:
    """Reset, start, and watch: what needs OPERATIONAL is not run where this fails.

    Raises:
        Deviation: it does not stay there; the message names the cause.
    """
    dut.fall = find_fall(dut)
    if dut.fall:
        raise Deviation(dut.fall)


@NMT.check("7.3.2.2", "the node enters PRE-OPERATIONAL after the boot-up message")
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


@NMT.check("7.2.8.3.1", "start, stop and enter pre-operational do what they say")
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


@NMT.check("7.2.8.3.1", "a command to node 0 is for all nodes")
def broadcast(dut: DeviceUnderTest) -> None:
    """Start and stop all, where nobody else is on the bus."""
    if dut.others:
        raise NotApplicable(f"nodes {', '.join(map(str, sorted(dut.others)))} would obey, too")
    with dut.watched():
        dut.command(NmtCommand.STOP, 0)
        dut.expect_state(NmtState.STOPPED, "STOP to node 0")
        dut.command(NmtCommand.ENTER_PRE_OPERATIONAL, 0)
        dut.expect_state(NmtState.PRE_OPERATIONAL, "ENTER_PRE_OPERATIONAL to node 0")


@NMT.check("7.2.8.3.1", "a command to another node is not obeyed")
def other_node(dut: DeviceUnderTest) -> None:
    """Stop a node-ID that nobody has."""
    other = dut.free_node_id
    with dut.watched():
        dut.command(NmtCommand.STOP, other)
        dut.expect_state(NmtState.PRE_OPERATIONAL, f"STOP to node {other}")


@NMT.check("7.2.8.3.1", "what is no NMT command is not obeyed")
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


@NMT.check("7.3.2.3", "STOPPED has no SDO; leaving it brings SDO back")
def stopped_has_no_sdo(dut: DeviceUnderTest) -> None:
    """Read in STOPPED, then in PRE-OPERATIONAL."""
    dut.command(NmtCommand.STOP)
    try:
        dut.sdo.expect_silence(upload_request(0x1000))
    finally:
        dut.command(NmtCommand.ENTER_PRE_OPERATIONAL)
    dut.wire.wait(dut.settling)
    dut.sdo.upload(0x1000)


@NMT.check("7.3.2.3", "OPERATIONAL has SDO")
def operational_has_sdo(dut: DeviceUnderTest) -> None:
    """Read in OPERATIONAL."""
    with dut.operational():
        dut.sdo.upload(0x1000)


@NMT.check("7.3.2.2.1", "reset communication restores the communication parameters")
def reset_restores(dut: DeviceUnderTest) -> str:
    """Change numbers of the communication profile, reset, read them."""
    dut.boot()
    changed = dict(_change(dut))
    if not changed:
        raise NotApplicable("no number of the communication profile could be changed")
    dut.boot()
    wrong = []
    for key, right in changed.items():
        found = dut.number(*key)
        if found != right:
            wrong.append(f"{name_object(*key)} is {found:X}h after the reset; {right:X}h is right")
            dut.write(*key, right)
    if wrong:
        raise Deviation("; ".join(wrong))
    return ", ".join(name_object(*key) for key in changed)


def _change(dut: DeviceUnderTest) -> Iterator[tuple[tuple[int, int], int]]:
    """Change numbers of the communication profile, where the device takes another value.

    Yields:
        The object of each, and what it was before.
    """
    pdos = [(index, COB_ID) for among in (RPDOS, TPDOS) for index in dut.objects.indices(among)[:1]]
    for key, bits in {**_BITS_TO_CHANGE, **dict.fromkeys(pdos, INVALID)}.items():
        variable = dut.objects.find(*key)
        if variable is None or not (variable.access.writable and variable.access.readable):
            continue
        before = dut.number(*key)
        with contextlib.suppress(Refused):
            dut.write(*key, before ^ bits)
            if dut.number(*key) != before:
                yield key, before


def _expect_boot_up(dut: DeviceUnderTest, command: NmtCommand) -> None:
    """Judge that a reset is followed by a boot-up message; no other check does.

    Raises:
        Deviation: none came.
    """
    if not dut.reset(command, insists=True):
        raise Deviation(f"no boot-up message within {BOOT_PATIENCE:g} s after NMT {command.name}")
    if dut.wire.take(dut.is_boot_up, dut.patience) is not None:
        raise Deviation(
            f"more than one boot-up message after NMT {command.name}: does another node have this "
            "node-ID, too?"
        )
    dut.rest()


# What a device stores, and what a reset brings back.


@STORAGE.check("7.5.2.13", "1010h shows what it can store, in bits 0 and 1", Impact.READ)
def store_ability(dut: DeviceUnderTest) -> str:
    """Read 1010h.01."""
    return _ability(dut, _STORE)


@STORAGE.check("7.5.2.14", "1011h shows whether it can restore, in bit 0", Impact.READ)
def restore_ability(dut: DeviceUnderTest) -> str:
    """Read 1011h.01."""
    return _ability(dut, _RESTORE)


@STORAGE.check("7.5.2.13", "a wrong signature aborts with 0800 0020h to 0022h")
def wrong_signature(dut: DeviceUnderTest) -> None:
    """Write "load" to 1010h and "save" to 1011h; beyond sub-index 1 any abort is right."""
    dut.variable(_STORE, _ALL)
    for index, wrong in ((_STORE, b"load"), (_RESTORE, b"save")):
        for variable in dut.objects.entries(index):
            if variable.subindex:
                codes = _NOT_STORED if variable.subindex == _ALL else ()
                dut.sdo.expect_abort(download_request(*variable.key, wrong), *codes)


@STORAGE.check("7.5.2.13", "what was stored is there after a reset of the node", Impact.STORE)
def store(dut: DeviceUnderTest) -> None:
    """Change 1017h, store, reset; then store what was there before."""
    dut.writable(*HEARTBEAT_TIME)
    _check_ability(dut, _STORE)
    before = dut.number(*HEARTBEAT_TIME)
    dut.write(*HEARTBEAT_TIME, _TRIAL_MS)
    try:
        _command(dut, _STORE, b"save")
        dut.boot(NmtCommand.RESET_NODE)
        found = dut.number(*HEARTBEAT_TIME)
    finally:
        dut.write(*HEARTBEAT_TIME, before)
        _command(dut, _STORE, b"save")
    if found != _TRIAL_MS:
        raise Deviation(f"1017h is {found} after the reset; {_TRIAL_MS} was stored")


@STORAGE.check(
    "7.5.2.14", "after restore and a reset the defaults of the EDS are there", Impact.STORE
)
def restore(dut: DeviceUnderTest) -> None:
    """Store another 1017h, restore, reset: the default shows after the reset, not before."""
    heartbeat = dut.writable(*HEARTBEAT_TIME)
    if heartbeat.is_open:
        raise NotApplicable("the EDS gives 1017h no default")
    default = int(heartbeat.default)
    _check_ability(dut, _STORE)
    _check_ability(dut, _RESTORE)
    dut.write(*HEARTBEAT_TIME, _TRIAL_MS)
    _command(dut, _STORE, b"save")
    _command(dut, _RESTORE, b"load")
    at_once = dut.number(*HEARTBEAT_TIME)
    dut.boot(NmtCommand.RESET_NODE)
    found = dut.number(*HEARTBEAT_TIME)
    if found != default:
        raise Deviation(f"1017h is {found} after restore and reset; {default} by the EDS")
    if at_once != _TRIAL_MS:
        raise Deviation(f"1017h was {at_once} before the reset; {_TRIAL_MS} is right")


@STORAGE.check(
    "CiA 302-2, 1F80h", "with bit 2 clear and stored, the node starts by itself", Impact.STORE
)
def self_start(dut: DeviceUnderTest) -> None:
    """Store 1F80h with bit 2 clear, reset the node, look; then with bit 2 set."""
    dut.writable(_STARTUP)
    _check_ability(dut, _STORE)
    dut.need_operational()
    before = dut.number(_STARTUP)
    try:
        for bit, right in ((0, NmtState.OPERATIONAL), (_NO_SELF_START, NmtState.PRE_OPERATIONAL)):
            value = before & ~_NO_SELF_START | bit
            try:
                dut.write(_STARTUP, 0, value)
            except Refused as refused:
                raise NotApplicable(f"the device does not take {value:X}h: {refused}") from None
            _command(dut, _STORE, b"save")
            dut.reset(NmtCommand.RESET_NODE)
            with dut.watched():
                dut.expect_state(right, f"boot-up with 1F80h = {value:X}h")
    finally:
        dut.rest()
        dut.write(_STARTUP, 0, before)
        _command(dut, _STORE, b"save")


def _ability(dut: DeviceUnderTest, index: int) -> str:
    dut.variable(index, _ALL)
    found = dut.number(index, _ALL)
    if found & ~3:
        raise Deviation(f"{index:04X}h.01 is {found:08X}h; bits 0 and 1 only")
    return f"{found:X}h"


def _check_ability(dut: DeviceUnderTest, index: int) -> None:
    dut.variable(index, _ALL)
    if not dut.number(index, _ALL) & _ON_COMMAND:
        raise NotApplicable(f"{index:04X}h.01 says that the device does not do it on command")


def _command(dut: DeviceUnderTest, index: int, signature: bytes) -> None:
    """Send a signature in PRE-OPERATIONAL: in OPERATIONAL a device may refuse it.

    Raises:
        Deviation: it is not confirmed.
    """
    dut.rest()
    answer = dut.sdo.exchange(download_request(index, _ALL, signature), timeout=_PATIENCE)
    if answer[0] != 0x60:
        said = answer.hex(" ").upper()
        raise Deviation(f"{signature.decode()} to {index:04X}h.01: {said}; 60 ... is right")
