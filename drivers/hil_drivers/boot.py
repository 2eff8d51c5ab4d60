"""The NMT master: boots a network as CiA 302-2 says, and keeps it up.

A master knows which slaves there are, which of them the network cannot do without, what each of
them must be, and how it is configured. The process, with the objects of a master that hold the
same, and the letters by which the standard calls what went wrong (`BootError`):

==== ==========================================================================================
step what happens
==== ==========================================================================================
1    reset communication, of all nodes at once, or one by one where a slave has `keep_alive`
2    0x1000 is read (B) and compared with 0x1F84 (C)
3    0x1018.01 to .04 are compared with 0x1F85 to 0x1F88 (D, M, N, O)
4    the state of a slave with `keep_alive` is found by its heartbeat (E), or by node guarding
     where none is expected (F); in OPERATIONAL it is left alone (L)
5    0x1020 is compared with 0x1F26 and 0x1F27; where it differs, the configuration of 0x1F22 is
     written (J)
6    its heartbeat is waited for, by the time of 0x1016 (K)
7    it is started, or all are when each mandatory slave is ready (0x1F80)
8    its state is looked at, which the standard does not ask for: started is what is OPERATIONAL
==== ==========================================================================================

Slaves are booted one after the other, where the standard has them booted side by side: the
order, and so what passes on the bus, is that of the list.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

from hil_drivers.boot_records import (
    BootError,
    BootResult,
    Configured,
    Loss,
    Slave,
    Start,
    Startup,
)
from hil_drivers.boot_states import GUARD, state_after_start
from hil_drivers.errors import DriverError
from hil_drivers.network import Network
from hil_drivers.node import NmtState, Node, object_name

RETRY: Final = 1.0
"""Time between two attempts at a slave that does not answer [s]."""

RESET: Final = 2.0
"""Longest wait for the boot-up messages after a reset [s]."""

_DEVICE_TYPE, _IDENTITY, _VERIFY, _STORE, _RESTORE = 0x1000, 0x1018, 0x1020, 0x1010, 0x1011
_SAVE, _LOAD = b"save", b"load"
_ALL = 0
_USUAL: Final = Startup()


_BY_SUBINDEX: Final = {1: BootError.D, 2: BootError.M, 3: BootError.N, 4: BootError.O}


class _Failure(Exception):  # noqa: N818 - never leaves this module
    """The boot process of a slave ends with this."""

    def __init__(self, error: BootError, reason: str = "") -> None:
        super().__init__(error, reason)
        self.error, self.reason = error, reason


class NetworkManager:
    """Boots the slaves of a network and watches them.

    Args:
        network: the network that they are on.
        slaves: the network list, in the order in which they are booted.
        startup: how.
        tell: told each result and each event, a line each; None for nobody.

    Attributes:
        slaves: node-ID to slave.
        startup: as passed in.
        results: node-ID to what came of the last attempt at a slave.
        states: node-ID to the state that a slave reported after the master had started it; None
            where it reported none.

    Raises:
        ValueError: two slaves have one node-ID.
    """

    def __init__(
        self,
        network: Network,
        slaves: Sequence[Slave],
        startup: Startup = _USUAL,
        tell: Callable[[str], None] | None = None,
    ) -> None:
        self.slaves = {slave.node_id: slave for slave in slaves}
        if len(self.slaves) < len(slaves):
            raise ValueError(f"{len(slaves)} slaves have {len(self.slaves)} node-IDs; one each")
        self.startup = startup
        self.results: dict[int, BootResult] = {}
        self.states: dict[int, NmtState | None] = {}
        self._network = network
        self._tell = tell or (lambda _line: None)
        self._nodes = {
            node_id: network.nodes.get(node_id) or network.add_node(node_id)
            for node_id in self.slaves
        }
        self._boot_ups: dict[int, int] = {}
        self._retry_at: dict[int, float] = {}
        self._guarded: dict[int, int] = {}
        for node_id in range(1, 128):
            hear = self._hear_slave if node_id in self.slaves else self._hear_stranger
            network.subscribe(0x700 + node_id, partial(hear, node_id))

    @property
    def is_started(self) -> bool:
        """Return True if every mandatory slave takes part; none reports another state."""
        return not self.left_out and all(
            slave.node_id in self.results and self.results[slave.node_id].is_up
            for slave in self.slaves.values()
            if slave.mandatory
        )

    @property
    def left_out(self) -> list[Slave]:
        """Mandatory slaves that were started and report another state than OPERATIONAL."""
        there = NmtState.OPERATIONAL, None
        return [s for s in self.slaves.values() if s.mandatory and self._state_of(s) not in there]

    @property
    def unseen(self) -> list[Slave]:
        """Mandatory slaves that were started and report no state."""
        return [s for s in self.slaves.values() if s.mandatory and self._state_of(s) is None]

    def boot(self) -> bool:
        """Boot the network and return whether it was started: every mandatory slave takes part.

        One that reports another state than OPERATIONAL does not; `unseen` has those without a word.

        A slave that does not answer is asked again until it does, or until the boot time is over;
        the others, once each, before that. Optional ones do not hold the network up.
        """
        self.results.clear()
        self.states.clear()
        network = self._network
        network.heartbeat_state = NmtState.PRE_OPERATIONAL
        deadline = network.now() + (self.startup.boot_time or math.inf)
        self._reset()
        for slave in self.slaves.values():
            self._attempt(slave)
        while (waiting := self._silent_mandatory()) and network.now() < deadline:
            network.pump_until(min(network.now() + RETRY, deadline))
            for slave in waiting:
                self._attempt(slave)
        if not self.is_started:
            return False
        network.heartbeat_state = NmtState.OPERATIONAL
        if self.startup.start is Start.ALL:
            self._start_all()
        self._look_at_states()
        return self.is_started

    def watch(self, duration: float) -> bool:
        """Keep the network up for some seconds, and return whether it still is.

        A slave that boots up, or whose heartbeat stays away, is booted anew, or what `Loss` says;
        optional slaves that did not answer are asked again.
        """
        network = self._network
        deadline = network.now() + duration
        while network.now() < deadline:
            network.wait_for(self._has_event, min(deadline, self._next_deadline()) - network.now())
            for slave in self.slaves.values():
                if (event := self._event_of(slave)) and not self._handle(slave, event):
                    return False
        self._look_at_states()
        return self.is_started

    def _look_at_states(self) -> None:
        """Note the states of the slaves that the master has started."""
        if self.startup.start is Start.NONE:
            return
        since = self._network.now()
        started = [result.slave for result in self.results.values() if result.is_up]
        for slave in [slave for slave in started if slave.boots]:
            self.states[slave.node_id] = state_after_start(
                self._network,
                self._nodes[slave.node_id],
                since,
                partial(self._guard, slave.node_id),
            )
            if slave in self.left_out:
                self._tell(f"{slave}: {self._state_text(slave)} after its start")

    def _state_of(self, slave: Slave) -> NmtState | None:
        """Return the state seen of a slave; OPERATIONAL for one that nobody has looked at."""
        return self.states.get(slave.node_id, NmtState.OPERATIONAL)

    def _state_text(self, slave: Slave) -> str:
        """Describe the state of a slave, with the error that it has reported and not taken back."""
        state, error = self._state_of(slave), self._nodes[slave.node_id].active_emergency
        text = state.name.replace("_", "-") if state else "reports no state"
        return f"{text}, EMCY 0x{error.code:04X}" if error else text

    def _reset(self) -> None:
        """Reset the communication of all nodes that need not be kept alive, and wait for them."""
        reset = [slave for slave in self.slaves.values() if not slave.keep_alive]
        self._boot_ups = {node_id: node.boot_ups for node_id, node in self._nodes.items()}
        before = dict(self._boot_ups)
        if len(reset) == len(self.slaves):
            self._network.command_reset_communication(_ALL)
        else:
            for slave in reset:
                self._network.command_reset_communication(slave.node_id)

        def are_up() -> bool:
            return all(
                self._nodes[slave.node_id].boot_ups > before[slave.node_id] for slave in reset
            )

        self._network.wait_for(are_up, min(RESET, self.startup.boot_time or RESET))

    def _silent_mandatory(self) -> list[Slave]:
        return [
            result.slave
            for result in self.results.values()
            if result.slave.mandatory and result.error is BootError.B
        ]

    def _attempt(self, slave: Slave) -> BootResult:
        """Boot a slave; tell what came of it where that is not what the last attempt brought."""
        node = self._nodes[slave.node_id]
        self._boot_ups[slave.node_id] = node.boot_ups
        try:
            result = BootResult(slave, None, configured=self._boot_slave(slave, node))
        except _Failure as failure:
            result = BootResult(slave, failure.error, failure.reason)
        before = self.results.get(slave.node_id)
        self.results[slave.node_id] = result
        self._retry_at[slave.node_id] = self._network.now() + RETRY
        if before is None or before.error is not result.error or result.error is None:
            self._tell(str(result))
        return result

    def _boot_slave(self, slave: Slave, node: Node) -> Configured:
        configured = Configured.NOTHING
        if slave.boots:
            self._check_identity(slave, node)
            if slave.keep_alive and self._state(slave, node) is NmtState.OPERATIONAL:
                raise _Failure(BootError.L)
            configured = self._configure(slave, node)
        if slave.heartbeat_time:
            self._await_heartbeat(slave, node, BootError.K)
        is_running = self._network.heartbeat_state is NmtState.OPERATIONAL
        starts = self.startup.start
        if slave.boots and (starts is Start.EACH or (starts is Start.ALL and is_running)):
            self._network.start_node(slave.node_id)
        return configured

    def _check_identity(self, slave: Slave, node: Node) -> None:
        try:
            found = node.upload(_DEVICE_TYPE)
        except DriverError as error:
            raise _Failure(BootError.B, _without_object(error)) from None
        _compare(found, slave.device_type, BootError.C)
        for subindex, expected in enumerate(slave.identity, 1):
            if not expected:
                continue
            try:
                found = node.upload(_IDENTITY, subindex)
            except DriverError as error:
                raise _Failure(_BY_SUBINDEX[subindex], error.what) from None
            _compare(found, expected, _BY_SUBINDEX[subindex])

    def _state(self, slave: Slave, node: Node) -> NmtState | None:
        """Return the NMT state of a slave that is to be kept alive.

        Raises:
            _Failure: neither a heartbeat nor an answer to node guarding tells it.
        """
        if slave.heartbeat_time:
            self._await_heartbeat(slave, node, BootError.E)
            return node.nmt_state
        state = self._guard(slave.node_id)
        if slave.node_id not in self._guarded:
            raise _Failure(BootError.F, f"not within {1000.0 * GUARD:g} ms")
        return state

    def _guard(self, node_id: int) -> NmtState | None:
        """Return the state that a node answers to node guarding; None without a sound answer."""
        self._guarded.pop(node_id, None)
        self._network.request(0x700 + node_id, 1)
        self._network.wait_for(lambda: node_id in self._guarded, GUARD)
        state = self._guarded.get(node_id)
        return NmtState(state) if state in frozenset(NmtState) else None

    def _hear_slave(self, node_id: int, data: bytes, _now: float) -> bool:
        """Note the state of a heartbeat or an answer to guarding, without the toggle bit."""
        if len(data) == 1:
            self._guarded[node_id] = data[0] & 0x7F
        return True

    def _hear_stranger(self, node_id: int, data: bytes, _now: float) -> bool:
        """Tell who boots up without being in the network list."""
        if data == b"\0" and node_id != self._network.heartbeat_node_id:
            self._tell(str(BootResult(Slave(node_id), BootError.A)))
        return True

    def _await_heartbeat(self, slave: Slave, node: Node, error: BootError) -> None:
        """Wait for one heartbeat from now on.

        Raises:
            _Failure: none came in time.
        """
        since = self._network.now()
        if not self._network.wait_for(lambda: node.heard_at >= since, slave.heartbeat_time):
            raise _Failure(error, f"not within {1000.0 * slave.heartbeat_time:g} ms")

    def _configure(self, slave: Slave, node: Node) -> Configured:
        if not slave.configuration:
            return Configured.NOTHING
        if self._is_configured(slave, node):
            return Configured.KEPT
        try:
            if slave.restore:
                node.download(_RESTORE, slave.restore, _LOAD)
                self._network.reset_node(slave.node_id, timeout=RESET)
                self._boot_ups[slave.node_id] = node.boot_ups
            for entry in slave.configuration:
                node.download(entry.index, entry.subindex, entry.data)
            if slave.date or slave.time:
                node.download(_VERIFY, 1, slave.date.to_bytes(4, "little"))
                node.download(_VERIFY, 2, slave.time.to_bytes(4, "little"))
            if slave.store:
                node.download(_STORE, 1, _SAVE)
        except DriverError as error:
            raise _Failure(BootError.J, error.what) from None
        return Configured.WRITTEN

    def _is_configured(self, slave: Slave, node: Node) -> bool:
        """Return True if the slave says by its 0x1020 that it has this configuration already."""
        if not (slave.date or slave.time):
            return False
        try:
            stamps = [int.from_bytes(node.upload(_VERIFY, sub), "little") for sub in (1, 2)]
        except DriverError:
            return False
        return stamps == [slave.date, slave.time]

    def _start_all(self) -> None:
        """Start all slaves, by one command where each of them is to be started."""
        up = [result.slave for result in self.results.values() if result.is_up]
        if all(slave.boots for slave in self.slaves.values()) and len(up) == len(self.slaves):
            self._network.start_node(_ALL)
            return
        for slave in up:
            if slave.boots:
                self._network.start_node(slave.node_id)

    def _has_event(self) -> bool:
        return any(self._event_of(slave) for slave in self.slaves.values())

    def _next_deadline(self) -> float:
        """Return when a heartbeat is too late, or a silent slave is to be asked again [s]."""
        deadlines = [math.inf]
        for node_id, result in self.results.items():
            if not result.is_up:
                deadlines.append(self._retry_at[node_id])
            elif result.slave.heartbeat_time:
                deadlines.append(self._nodes[node_id].heard_at + result.slave.heartbeat_time)
        return min(deadlines)

    def _event_of(self, slave: Slave) -> str:
        """Return the event of a slave that calls for action; empty where all is well."""
        node, result = self._nodes[slave.node_id], self.results.get(slave.node_id)
        now = self._network.now()
        if node.boot_ups > self._boot_ups.get(slave.node_id, 0):
            return "has booted up"
        if result is None or not result.is_up:
            is_silent = result is None or result.error in {BootError.B, BootError.E, BootError.K}
            return "is asked again" if is_silent and now >= self._retry_at[slave.node_id] else ""
        if slave.heartbeat_time and now - node.heard_at >= slave.heartbeat_time:
            return f"no heartbeat for {1000.0 * slave.heartbeat_time:g} ms"
        return ""

    def _handle(self, slave: Slave, event: str) -> bool:
        """Answer an event; return whether the network goes on."""
        result = self.results.get(slave.node_id)
        was_up = result is not None and result.is_up
        if was_up:
            self._tell(f"{slave}: {event}")
        if was_up and slave.mandatory and self.startup.loss is Loss.STOP_ALL:
            self._network.stop_node(_ALL)
            self._tell("all nodes are stopped")
            return False
        if was_up and slave.mandatory and self.startup.loss is Loss.RESET_ALL:
            self._network.command_reset_node(_ALL)
            self._tell("all nodes are reset")
            return self.boot()
        if was_up and event != "has booted up":
            self._network.command_reset_communication(slave.node_id)
            self._network.wait_for(
                lambda: self._nodes[slave.node_id].boot_ups > self._boot_ups[slave.node_id], RESET
            )
        self._attempt(slave)
        return True


def _compare(found: bytes, expected: int, error: BootError) -> None:
    """Compare an UNSIGNED32 with what is right; 0 is right for any.

    Raises:
        _Failure: they differ.
    """
    if not expected:
        return
    if len(found) != 4:
        raise _Failure(error, f"came as {len(found)} bytes; 4 are right")
    number = int.from_bytes(found, "little")
    if number != expected:
        raise _Failure(error, f"it is 0x{number:08X}; 0x{expected:08X} is right")


def _without_object(error: DriverError) -> str:
    """Return the text of an error without the object that the letter names already."""
    return error.what.removeprefix(f"cannot read {object_name(_DEVICE_TYPE)}: ")
