"""Presence of nodes: boot-up, node-ID clashes, restarts, states."""

from collections.abc import Iterator
from dataclasses import dataclass, field

from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.finding import Cause, Finding, milliseconds, seconds
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.canopen_device.identifiers import function_of
from hil_bench.canopen_device.nmt import ENTERED, RESTORED, NmtCommand, NmtRequest, NmtState
from hil_bench.canopen_device.pdo_mapping import Direction

_TWINS = 200_000_000
"""Two boot-up messages within this time are of two devices: none restarts so fast [ns]."""

_PATIENCE = 1_000_000_000
"""Time that a node may take to follow an NMT command [ns]."""

_SHORT = 0.5
_FEWEST = 4
_SCAN = 8
"""Unknown node-IDs without an answer from which on somebody looks who is there ..."""
_LOOKS = 2
"""... unless he speaks to one of them more often than this."""


@dataclass(slots=True)
class _Life:
    """The observations of one node."""

    node: KnownNode
    is_heard: bool = False
    requests: list[Sight] = field(default_factory=list)
    is_slave: bool = False  # somebody else asks or commands it alone
    given_up: list[Sight] = field(default_factory=list)
    late: list[tuple[Sight, Sight]] = field(default_factory=list)
    boots: list[Sight] = field(default_factory=list)
    restarts: list[Sight] = field(default_factory=list)
    twins: list[Sight] = field(default_factory=list)
    is_reset: bool = False
    commanded: tuple[NmtState, int] | None = None
    is_broadcast: bool = False  # the command
    refusals: list[Sight] = field(default_factory=list)
    is_started: bool = False
    heartbeats: list[Sight] = field(default_factory=list)
    short: list[Sight] = field(default_factory=list)
    has_answered: bool = False


class Presence:
    """Watches who is there, and whether each is one.

    Args:
        decoder: that gives the sights.
        known: the nodes that ought to be there.

    Attributes:
        scanned: names of those that somebody merely looked for, once `findings` is through.
    """

    def __init__(self, decoder: Decoder, known: list[KnownNode]) -> None:
        self._decoder = decoder
        self._known = {(node.bus, node.node_id) for node in known}
        self._lives = {(node.bus, node.node_id): _Life(node) for node in known}
        self.scanned: set[str] = set()
        self._has_started = False
        self._has_commands = False

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        if sight.service is Service.NMT:
            self._hear_command(sight)
            return
        if sight.node_id is None or sight.service in {Service.SYNC, Service.OTHER}:
            return
        life = self._life(sight.frame.bus, sight.node_id)
        if not self._is_from(sight):
            if sight.service is Service.PDO:
                self._has_commands = True
                return
            life.is_slave |= sight.service is Service.SDO
            transfer = sight.transfer
            if transfer is None or not transfer.is_answered:
                life.requests.append(sight)
            if transfer is not None and transfer.is_aborted_by_client:
                life.given_up.append(sight)
            return
        life.is_heard = True
        if sight.service is Service.HEARTBEAT and len(sight.frame.data) == 1:
            self._hear_state(life, sight)
        elif sight.service is Service.SDO:
            self._hear_answer(life, sight)
        elif sight.service is Service.PDO:
            life.is_started = True

    def findings(self, end: int) -> Iterator[Finding]:
        """Yield who is missing, double, or not in its state.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        known = [life for key, life in self._lives.items() if key in self._known]
        if len(known) > 1 and not any(life.is_heard for life in known):
            names = ", ".join(life.node.name for life in known)
            others = ", ".join(life.node.name for life in self._lives.values() if life.is_heard)
            text = f"none of {names} is heard"
            text += f", but {others}: the log is of another bus" if others else ": have they power?"
            yield Finding(Cause.OTHER_BUS, "", 0, text)
            return
        missing = {key: life for key, life in self._lives.items() if self._is_missing(key, life)}
        strange = [key for key in missing if key not in self._known]
        is_scan = len(strange) >= _SCAN
        for key, life in missing.items():
            if is_scan and key in strange and len(life.requests) <= _LOOKS:
                self.scanned.add(life.node.name)
            else:
                yield _absence(life)
        for life in self._lives.values():
            if life.is_heard:
                yield from self._judge(life, end)

    def _life(self, bus: int, node_id: int) -> _Life:
        key = bus, node_id
        if key not in self._lives:
            self._lives[key] = _Life(self._decoder.nodes.get(key) or KnownNode(node_id, bus=bus))
        return self._lives[key]

    def _is_from(self, sight: Sight) -> bool:
        """Return True if a node has sent the frame itself."""
        if sight.frame.is_remote:
            return False
        if sight.service is Service.PDO:
            owners = self._decoder.owners(sight.frame)
            if owners:
                return owners[0].pdo.direction is Direction.TPDO
            return sight.name.startswith("TPDO")
        if sight.service is Service.SDO:
            return function_of(sight.frame.can_id).name == "SDO answer"
        return True

    def _hear_command(self, sight: Sight) -> None:
        request = NmtRequest.parse(sight.frame.data)
        if request is None:
            return
        self._has_started |= request.command is NmtCommand.START
        for life in self._lives.values():
            if life.node.bus == sight.frame.bus and request.addresses(life.node.node_id):
                life.is_reset = request.command in RESTORED
                life.commanded = ENTERED[request.command], sight.now
                life.is_broadcast = request.node_id == 0
                life.is_started |= not life.is_reset
                if request.node_id:
                    life.requests.append(sight)
                    life.is_slave = True

    def _hear_state(self, life: _Life, sight: Sight) -> None:
        if sight.name == "boot-up":
            self._hear_boot(life, sight)
            return
        state = sight.frame.data[0] & 0x7F
        life.is_started |= state == NmtState.OPERATIONAL
        if life.commanded is not None:
            wanted, when = life.commanded
            if state != wanted and sight.now - when > _PATIENCE:
                life.refusals.append(sight)
            elif state == wanted:  # where it goes from here is not by this command
                life.commanded = None
                life.refusals.clear()
        period = life.node.number(0x1017) * 1_000_000
        if period and life.heartbeats and sight.now - life.heartbeats[-1].now < period * _SHORT:
            life.short.append(sight)
        life.heartbeats.append(sight)

    def _hear_boot(self, life: _Life, sight: Sight) -> None:
        if not life.is_reset and (life.boots or life.heartbeats):
            is_twin = bool(life.boots) and sight.now - life.boots[-1].now < _TWINS
            (life.twins if is_twin else life.restarts).append(sight)
        life.is_reset, life.commanded, life.is_started = False, None, False
        life.boots.append(sight)

    def _hear_answer(self, life: _Life, sight: Sight) -> None:
        transfer = sight.transfer
        if transfer is not None:
            life.is_slave = True
            is_by_node = transfer.is_done or not transfer.is_aborted_by_client
            life.has_answered = transfer.has_ended and is_by_node
        elif life.given_up and len(sight.frame.data) == 8:
            life.late.append((life.given_up.pop(0), sight))
        elif life.has_answered and len(sight.frame.data) == 8:
            life.twins.append(sight)  # a second answer to one request

    def _is_missing(self, key: tuple[int, int], life: _Life) -> bool:
        if life.is_heard:
            return False
        is_asked = bool(life.requests)
        if key not in self._known:
            return is_asked
        others_boot = any(other.boots for other in self._lives.values())
        return is_asked or others_boot or bool(life.node.number(0x1017))

    def _judge(self, life: _Life, end: int) -> Iterator[Finding]:
        name = life.node.name
        short = life.short if len(life.short) >= max(_FEWEST, len(life.heartbeats) // 4) else []
        if twins := [*life.twins, *short]:
            text = (
                f"{name}: more boot-up messages, answers or heartbeats than one device sends: "
                f"node-ID {life.node.node_id} is given twice"
            )
            yield Finding(Cause.NODE_ID_CLASH, name, twins[0].now, text, tuple(twins))
        elif life.restarts:
            count = len(life.restarts)
            when = seconds(life.restarts[0].now)
            text = f"{name} restarts by itself at {when}" + (
                f", and {count - 1} times more" if count > 1 else ""
            )
            text += ": its supply, or its watchdog; it then waits to be configured and started"
            yield Finding(Cause.RESTART, name, life.restarts[0].now, text, tuple(life.restarts))
        elif life.late:
            yield _slowness(life)
        elif life.refusals and (life.is_slave or not life.is_broadcast or self._is_known(life)):
            # What a broadcast asks for, its own producer need not do.
            wanted = life.commanded[0].name if life.commanded else ""
            text = f"{name} was commanded to {wanted}, and says {life.refusals[0].words}"
            yield Finding(
                Cause.START_REFUSED, name, life.refusals[0].now, text, tuple(life.refusals)
            )
        elif self._is_left(life, end):
            since = life.boots[-1]
            waited = milliseconds(end - since.now)
            text = f"{name} gets no NMT start in {waited} after its boot-up: its PDOs stay off"
            yield Finding(Cause.NOT_STARTED, name, since.now, text, (since,))

    def _is_known(self, life: _Life) -> bool:
        return (life.node.bus, life.node.node_id) in self._known

    def _is_left(self, life: _Life, end: int) -> bool:
        """Return True if a node was left out while others were started or commanded."""
        is_used = self._has_started or self._has_commands
        is_late = bool(life.boots) and end - life.boots[-1].now > _PATIENCE
        return is_used and is_late and not life.is_started and life.commanded is None


def _absence(life: _Life) -> Finding:
    name, asked = life.node.name, life.requests
    text = f"{name} sends nothing, no boot-up message either"
    if asked:
        text += f", though it is spoken to from {seconds(asked[0].now)} on"
    return Finding(Cause.NO_BOOT_UP, name, asked[0].now if asked else 0, text, tuple(asked))


def _slowness(life: _Life) -> Finding:
    name, (given_up, answer) = life.node.name, life.late[0]
    after = milliseconds(answer.now - given_up.now)
    text = f"{name} answers {after} after its client has given up, at {seconds(answer.now)}"
    text += f", and {len(life.late) - 1} times more" if len(life.late) > 1 else ""
    text += ": it is slow, or the client's time-out short"
    return Finding(Cause.SDO_LATE, name, given_up.now, text, life.late[0])
