"""The controller's end of a CANopen network, in one thread.

Nothing runs beside the caller: frames are received, and heartbeats sent, while the caller waits in
`pump`, `wait_for` or `wait_until`, or in an SDO transfer, which waits the same way. The clock is
passed in, so the same code runs in real time on any python-can bus, and in virtual time on a bus
whose time advances only while it is being read.
"""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import can
import canopen

from hil_drivers.errors import BusLostError, DriverTimeoutError
from hil_drivers.node import NmtState, Node

Handler = Callable[[bytes, float], bool]
"""Takes the data of a frame and its time of reception [s]; False refuses it as malformed."""

RESOLUTION = 1e-6
"""A wait shorter than this [s] is over: some buses and clocks cannot tell it from none."""

CONTROLLER_ID = 127
"""Node-ID under which a controller sends its heartbeat, unless it says otherwise."""

Service = Callable[[float], float]
"""Does what is due at a time [s], and returns when to be called next."""

HEARTBEAT_PERIOD = 0.05
"""Time between two of its heartbeats, likewise [s]."""

BACKLOG = 256
"""Frames taken at once when a wait is over: a flood must not keep the caller from its own work."""

_NMT_START, _NMT_STOP, _NMT_PRE_OPERATIONAL = 1, 2, 128
_NMT_RESET_NODE, _NMT_RESET_COMMUNICATION = 129, 130
_SYNC_COB_ID = 0x80
_BUS_OFF = 0x40
"""Class of SocketCAN's error frames (linux/can/error.h)."""


@dataclass(slots=True)
class ReceiveCounters:
    """Counters of received frames.

    Attributes:
        received: all frames.
        ignored: remote, error and CAN FD frames, and 29-bit ones that nobody takes: CANopen devices
            send none of them.
        unknown: frames that nobody here listens to.
        malformed: frames of a device of ours whose length or contents are wrong.
    """

    received: int = 0
    ignored: int = 0
    unknown: int = 0
    malformed: int = 0


class _SendingNetwork(canopen.Network):
    """The network that canopen's own classes send through."""

    def __init__(self, send: Callable[[int, bytes], None]) -> None:
        super().__init__()
        self._send = send

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        del remote
        self._send(can_id, bytes(data))


class Network:
    """The nodes on one bus, and everything sent to or received from them.

    Args:
        bus: any open python-can bus; it stays the caller's to shut down.
        clock: seconds on a clock that never steps back; the bus's own where its time is virtual.

    Attributes:
        bus: as passed in.
        counters: what came in.
        nodes: node-ID to node.
        heartbeat_node_id: node-ID under which we send heartbeats, None while we do not.
        heartbeat_state: NMT state that they tell.
        take_extended: takes frames with a 29-bit identifier and their time of reception [s]; None
            counts them as ignored. `hil_drivers.j1939` puts itself here.
        returns: how often the bus came back: a frame came after it could not send or receive, or
            after the adapter had reported bus-off.
        observe: told each frame, received (its `is_rx` says so) or sent; None for nobody.
    """

    def __init__(self, bus: can.BusABC, *, clock: Callable[[], float] = time.monotonic) -> None:
        self.bus = bus
        self.counters = ReceiveCounters()
        self.nodes: dict[int, Node] = {}
        self.heartbeat_node_id: int | None = None
        self.heartbeat_state = NmtState.OPERATIONAL
        self.returns = 0
        self.observe: Callable[[can.Message], None] | None = None
        self.take_extended: Callable[[can.Message, float], bool] | None = None
        self._clock = clock
        self._services: list[Service] = []
        self._handlers: dict[int, tuple[Handler, ...]] = {}
        self._canopen = _SendingNetwork(self.send)
        self._sync = can.Message(arbitration_id=_SYNC_COB_ID, is_extended_id=False)
        self._heartbeat_period = 0.0
        self._heartbeat_due = 0.0
        self._is_lost = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def now(self) -> float:
        """Return the time on the network's clock [s]."""
        return self._clock()

    def add_node(
        self, node_id: int, eds: Path | str | None = None, *, sdo_timeout: float = 0.5
    ) -> Node:
        """Return the node with this node-ID; drivers of one device share one node.

        Args:
            node_id: 1 to 127.
            eds: path of its EDS or DCF; None for a device of which nothing else is known.
            sdo_timeout: longest wait for each SDO answer [s].

        Raises:
            ValueError: the node-ID is out of range, or is there already with another EDS.
        """
        eds = None if eds is None else Path(eds)
        known = self.nodes.get(node_id)
        if known is not None:
            if known.eds != eds:
                raise ValueError(f"{known} is {known.eds} already; {eds} needs another node-ID")
            return known
        node = Node(node_id, eds, self.wait_for, sdo_timeout=sdo_timeout, clock=self.now)
        node.associate_network(self._canopen)
        for cob_id, handler in node.handlers().items():
            self.subscribe(cob_id, handler)
        self.nodes[node_id] = node
        return node

    def deliver(self, message: can.Message) -> None:
        """Take a frame as if it had just come on the bus: one that somebody else overheard."""
        self._dispatch(message)

    def subscribe(self, cob_id: int, handler: Handler) -> None:
        """Have a handler told each frame with this COB-ID; more than one may listen."""
        handlers = self._handlers.get(cob_id, ())
        if handler not in handlers:
            self._handlers[cob_id] = (*handlers, handler)

    def send(self, cob_id: int, data: bytes) -> None:
        """Send one frame."""
        self._send(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))

    def send_extended(self, can_id: int, data: bytes) -> None:
        """Send one frame with a 29-bit identifier."""
        self._send(can.Message(arbitration_id=can_id, data=data, is_extended_id=True))

    def add_service(self, service: Service) -> None:
        """Have something done at its times, while the caller waits."""
        self._services.append(service)

    def remove_service(self, service: Service) -> None:
        """Remove a service; without effect where it is not registered."""
        if service in self._services:
            self._services.remove(service)

    def request(self, cob_id: int, length: int) -> None:
        """Send one remote frame, which asks for a frame of that length."""
        self._send(
            can.Message(
                arbitration_id=cob_id, is_remote_frame=True, dlc=length, is_extended_id=False
            )
        )

    def sync(self) -> None:
        """Send one SYNC."""
        self._send(self._sync)

    def pump(self, timeout: float = 0.0) -> None:
        """Receive for `timeout` seconds; with 0, take what is there."""
        self.pump_until(self._clock() + timeout)

    def pump_until(self, deadline: float) -> None:
        """Receive until `deadline` on the network's clock [s], then take what is there."""
        while (remaining := deadline - self._clock()) > RESOLUTION:
            self._receive(remaining)
        self._drain()

    def wait_for(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Receive until `condition` holds, and return whether it did within `timeout` seconds."""
        deadline = self._clock() + timeout
        while not condition():
            remaining = deadline - self._clock()
            if remaining <= RESOLUTION:
                # This process may have been held up longer than the device: look before judging.
                self._drain()
                return condition()
            self._receive(remaining)
        return True

    def wait_until(self, condition: Callable[[], bool], timeout: float, what: str) -> None:
        """Receive until `condition` holds.

        Args:
            condition: asked after each frame.
            timeout: longest wait [s].
            what: what is waited for, for the message: "node 1: boot-up".

        Raises:
            DriverTimeoutError: it did not hold in time.
        """
        if not self.wait_for(condition, timeout):
            raise DriverTimeoutError(f"{what}: not within {timeout:g} s")

    def start_heartbeat(
        self, node_id: int = CONTROLLER_ID, period: float = HEARTBEAT_PERIOD
    ) -> None:
        """Send our boot-up message, and from then on a heartbeat each `period` seconds.

        Heartbeats are sent while the caller waits, so whoever computes for longer than the period
        sends them late.

        Raises:
            ValueError: the node-ID is out of range or a node's, or the period is not positive.
        """
        if not 1 <= node_id <= 127 or node_id in self.nodes:
            raise ValueError(
                f"heartbeat under node-ID {node_id}: 1 to 127 without {sorted(self.nodes)} is right"
            )
        if not period > 0:
            raise ValueError(f"heartbeat period {period} s: a positive time is right")
        self.heartbeat_node_id = node_id
        self._heartbeat_period = period
        self.send(0x700 + node_id, bytes([NmtState.INITIALISING]))
        self._heartbeat_due = self._clock()

    def stop_heartbeat(self) -> None:
        """End our heartbeat."""
        self.heartbeat_node_id = None

    def start_node(self, node_id: int = 0) -> None:
        """Command a node, or with 0 all of them, to NMT state OPERATIONAL."""
        self._command(_NMT_START, node_id)

    def stop_node(self, node_id: int = 0) -> None:
        """Command a node, or with 0 all of them, to NMT state STOPPED."""
        self._command(_NMT_STOP, node_id)

    def enter_pre_operational(self, node_id: int = 0) -> None:
        """Command a node, or with 0 all of them, to NMT state PRE-OPERATIONAL."""
        self._command(_NMT_PRE_OPERATIONAL, node_id)

    def command_reset_node(self, node_id: int = 0) -> None:
        """Command a node, or with 0 all of them, to reset; wait for nothing."""
        self._command(_NMT_RESET_NODE, node_id)

    def command_reset_communication(self, node_id: int = 0) -> None:
        """Command a node, or with 0 all of them, to reset its communication; wait for nothing."""
        self._command(_NMT_RESET_COMMUNICATION, node_id)

    def reset_node(self, node_id: int, *, timeout: float = 2.0) -> None:
        """Reset a node and wait for its boot-up message."""
        self._reset(_NMT_RESET_NODE, node_id, timeout)

    def reset_communication(self, node_id: int, *, timeout: float = 2.0) -> None:
        """Reset a node's communication and wait for its boot-up message."""
        self._reset(_NMT_RESET_COMMUNICATION, node_id, timeout)

    def wait_for_state(self, node_ids: Iterable[int], state: NmtState, timeout: float) -> None:
        """Wait until each of these nodes has sent a heartbeat in NMT state `state`."""
        for node in [self.nodes[node_id] for node_id in node_ids]:
            self.wait_until(
                lambda node=node: node.nmt_state is state,  # type: ignore[misc]
                timeout,
                f"{node}: heartbeat in NMT state {state.name}",
            )

    def close(self) -> None:
        """End our heartbeat and listen no longer; the bus stays open."""
        self.stop_heartbeat()
        self._services.clear()
        self.take_extended = None
        self._handlers.clear()

    def _reset(self, command: int, node_id: int, timeout: float) -> None:
        node = self.nodes[node_id]
        before = node.boot_ups
        self._command(command, node_id)
        self.wait_until(lambda: node.boot_ups > before, timeout, f"{node}: boot-up after reset")

    def _command(self, command: int, node_id: int) -> None:
        if not 0 <= node_id <= 127:
            raise ValueError(f"NMT command to node-ID {node_id}: 1 to 127, or 0 for all, is right")
        self.send(0, bytes([command, node_id]))

    def _send(self, message: can.Message) -> None:
        try:
            self.bus.send(message)
        except (can.CanError, OSError) as error:
            raise self._lost("send", error) from error
        if self.observe is not None:
            message.is_rx = False
            self.observe(message)

    def _lost(self, verb: str, error: Exception) -> BusLostError:
        # Some interfaces put a traceback into their message: what is before it says what happened.
        self._is_lost = True
        text = str(error).partition("Traceback (most recent call last)")[0]
        reason = (text.splitlines() or [type(error).__name__])[0].strip()
        return BusLostError(f"cannot {verb} on {self.bus.channel_info}: {reason}")

    def _drain(self) -> None:
        """Take what is there, but no more than `BACKLOG` frames."""
        for _ in range(BACKLOG):
            if not self._receive(0.0):
                return

    def _receive(self, timeout: float) -> bool:
        """Wait at most `timeout` seconds for one frame and hand it on; False if none came."""
        if self.heartbeat_node_id is not None:
            timeout = self._serve_heartbeat(self.heartbeat_node_id, timeout)
        for service in self._services:
            now = self._clock() + RESOLUTION  # what is due within it is due
            timeout = min(timeout, max(service(now) - now, RESOLUTION))
        try:
            message = self.bus.recv(timeout)
        except (can.CanError, OSError) as error:
            raise self._lost("receive", error) from error
        if message is None:
            return False
        self._dispatch(message)
        return True

    def _dispatch(self, message: can.Message) -> None:
        counters = self.counters
        counters.received += 1
        if self.observe is not None:
            self.observe(message)
        if message.is_error_frame and message.arbitration_id & _BUS_OFF:
            self._is_lost = True
        elif self._is_lost:
            self._is_lost = False
            self.returns += 1
        if message.is_remote_frame or message.is_error_frame or message.is_fd:
            counters.ignored += 1
            return
        if message.is_extended_id:
            self._dispatch_extended(message)
            return
        handlers = self._handlers.get(message.arbitration_id)
        if handlers is None:
            counters.unknown += 1
            return
        data, now = bytes(message.data), self._clock()
        for handle in handlers:
            if not handle(data, now):
                counters.malformed += 1

    def _dispatch_extended(self, message: can.Message) -> None:
        if self.take_extended is None:
            self.counters.ignored += 1
        elif not self.take_extended(message, self._clock()):
            self.counters.malformed += 1

    def _serve_heartbeat(self, node_id: int, timeout: float) -> float:
        """Send the heartbeat if it is due, and return how long [s] we may wait until the next."""
        now = self._clock()
        if now >= self._heartbeat_due:
            self.send(0x700 + node_id, bytes([self.heartbeat_state]))
            self._heartbeat_due += self._heartbeat_period
            if self._heartbeat_due <= now:  # a missed heartbeat is not made up for by a burst
                self._heartbeat_due = now + self._heartbeat_period
        return min(timeout, max(self._heartbeat_due - now, 0.0))
