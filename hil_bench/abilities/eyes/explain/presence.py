"""Presence of nodes: boot-up, node-ID clashes, restarts, states."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

from hil_bench.abilities.common.identifiers import function_of
from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.finding import (
    Cause,
    Evidence,
    Finding,
    finding,
    milliseconds,
    more,
    seconds,
)
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.canopen_device.nmt import ENTERED, RESTORED, NmtCommand, NmtRequest, NmtState

_TWINS = 200_000_000
"""Two boot-up messages within this time are of two devices: none restarts so fast [ns]."""

_PATIENCE = 1_000_000_000
"""Time that a node may take to follow an NMT command [ns]."""

_SHORT = 0.5
_OPEN = 16
_ACKNOWLEDGED = 0x60
"""First byte of the answer to an SDO download."""
_FLIPS = 3
"""Changes of state without a command, after a boot-up, that one device does not make."""

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
    requests: Evidence = field(default_factory=Evidence)
    is_slave: bool = False  # somebody else asks or commands it alone
    given_up: deque[Sight] = field(default_factory=lambda: deque(maxlen=_OPEN))
    late: tuple[Sight, Sight] | None = None
    late_answers: int = 0
    boots: Evidence = field(default_factory=Evidence)
    restarts: Evidence = field(default_factory=Evidence)
    twins: Evidence = field(default_factory=Evidence)
    is_reset: bool = False
    commanded: tuple[NmtState, int] | None = None
    is_broadcast: bool = False  # the command
    refusals: Evidence = field(default_factory=Evidence)
    is_started: bool = False
    has_run: bool = False  # in OPERATIONAL, at any time
    state: int | None = None  # of the last heartbeat
    last_beat: int | None = None
    beats: int = 0
    is_commanded: bool = False  # since it has entered its state
    left: Evidence = field(default_factory=Evidence)
    flips: Evidence = field(default_factory=Evidence)
    short: Evidence = field(default_factory=Evidence)
    has_answered: bool = False


class Presence:
    """Watches who is there, and whether each is one.

    Args:
        decoder: that gives the sights.
        known: the nodes that ought to be there.

    Attributes:
        scanned: names of those that somebody merely looked for, once `findings` is through.
    """

    hears = frozenset({Service.NMT, Service.EMCY, Service.PDO, Service.SDO, Service.HEARTBEAT})

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
        if sight.node_id is None:
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
            life.is_started = life.has_run = True

    def has_heard(self, bus: int, node_id: int) -> bool:
        """Return True if a node has sent anything."""
        life = self._lives.get((bus, node_id))
        return life is not None and life.is_heard

    def pause(self, length: int) -> None:
        """Give all the more time to follow a command."""
        for life in self._lives.values():
            if life.commanded is not None:
                wanted, when = life.commanded
                life.commanded = wanted, when + length

    def leap(self) -> None:
        """Take note that a time is missing: who boots next may have been told to in it."""
        for life in self._lives.values():
            life.is_reset = True

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
            is_scanned = is_scan and life.requests.total <= _LOOKS
            # One request at the end of the log has had no time for an answer.
            is_last = life.requests.total == 1 and end - life.requests[0].now <= _PATIENCE
            if key in strange and (is_scanned or is_last):
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
                life.is_commanded = True
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
        life.has_run |= state == NmtState.OPERATIONAL
        if life.commanded is not None:
            wanted, when = life.commanded
            if state != wanted and sight.now - when > _PATIENCE:
                life.refusals.append(sight)
            elif state == wanted:  # where it goes from here is not by this command
                life.commanded = None
                life.refusals = Evidence()
        period = life.node.number(0x1017) * 1_000_000
        if period and life.last_beat is not None and sight.now - life.last_beat < period * _SHORT:
            life.short.append(sight)
        life.last_beat, life.beats = sight.now, life.beats + 1
        self._hear_change(life, sight, state)

    def _hear_change(self, life: _Life, sight: Sight, state: int) -> None:
        """Note where a node goes to another state, and nobody has commanded it."""
        before, life.state = life.state, state
        was_commanded = life.is_commanded
        if life.commanded is None:
            life.is_commanded = False
        if before is None or state == before:
            return
        if was_commanded:
            life.flips = Evidence()
            return
        life.flips.append(sight)
        if before == NmtState.OPERATIONAL:
            life.left.append(sight)

    def _hear_boot(self, life: _Life, sight: Sight) -> None:
        if not life.is_reset and (life.boots or life.beats):
            last = life.boots.latest
            is_twin = last is not None and sight.now - last.now < _TWINS
            (life.twins if is_twin else life.restarts).append(sight)
        life.is_reset, life.commanded, life.is_started = False, None, False
        life.state, life.is_commanded = None, False
        life.boots.append(sight)

    def _hear_answer(self, life: _Life, sight: Sight) -> None:
        transfer = sight.transfer
        if transfer is not None:
            life.is_slave = True
            is_by_node = transfer.is_done or not transfer.is_aborted_by_client
            life.has_answered = transfer.has_ended and is_by_node
        elif life.given_up and len(sight.frame.data) == 8:
            given_up = life.given_up.popleft()
            life.late = life.late or (given_up, sight)
            if given_up.transfer is not None and sight.frame.data[0] == _ACKNOWLEDGED:
                self._decoder.accept_late(life.node, given_up.transfer)
            life.late_answers += 1
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
        is_short = life.short.total >= max(_FEWEST, life.beats // 4)
        twins = [life.twins, *([life.short] if is_short else [])]
        if life.flips.total >= _FLIPS and life.restarts:
            twins += [life.restarts, life.flips]
        if any(twins):
            text = (
                f"{name}: more boot-up messages, answers or heartbeats than one device sends: "
                f"node-ID {life.node.node_id} is given twice"
            )
            shown = Evidence(sight for each in twins for sight in each)
            yield finding(Cause.NODE_ID_CLASH, name, shown, text)
        elif life.restarts:
            count = life.restarts.total
            when = seconds(life.restarts[0].now)
            text = f"{name} restarts by itself at {when}{more(count, ', and')}"
            text += ": its supply, or its watchdog; it then waits to be configured and started"
            yield finding(Cause.RESTART, name, life.restarts, text)
        elif life.late:
            yield _slowness(life, life.late)
        elif life.refusals and (life.is_slave or not life.is_broadcast or self._is_known(life)):
            # What a broadcast asks for, its own producer need not do.
            wanted = life.commanded[0].name if life.commanded else ""
            text = f"{name} was commanded to {wanted}, and says {life.refusals[0].words}"
            yield finding(Cause.START_REFUSED, name, life.refusals, text)
        elif life.left and (life.is_slave or self._is_known(life)):
            text = f"{name} says {life.left[0].words} from {seconds(life.left[0].now)} on, and "
            text += "nobody has commanded it"
            yield finding(Cause.STATE_LEFT, name, life.left, text)
        elif self._is_left(life, end) and (since := life.boots.latest) is not None:
            waited = milliseconds(end - since.now)
            text = f"{name} gets no NMT start in {waited} after its boot-up: its PDOs stay off"
            yield Finding(Cause.NOT_STARTED, name, since.now, text, (since,))

    def _is_known(self, life: _Life) -> bool:
        return (life.node.bus, life.node.node_id) in self._known

    def _is_left(self, life: _Life, end: int) -> bool:
        """Return True if a node was left out while others were started or commanded."""
        if not (life.is_slave or self._is_known(life)):
            return False  # it may be the master itself
        is_used = self._has_started or self._has_commands or life.has_run
        last = life.boots.latest
        is_late = last is not None and end - last.now > _PATIENCE
        return is_used and is_late and not life.is_started and life.commanded is None


def _absence(life: _Life) -> Finding:
    name, asked = life.node.name, life.requests
    text = f"{name} sends nothing, no boot-up message either"
    if asked:
        text += f", though it is spoken to from {seconds(asked[0].now)} on"
    return finding(Cause.NO_BOOT_UP, name, asked, text, asked[0].now if asked else 0)


def _slowness(life: _Life, late: tuple[Sight, Sight]) -> Finding:
    name, (given_up, answer) = life.node.name, late
    after = milliseconds(answer.now - given_up.now)
    text = f"{name} answers {after} after its client has given up, at {seconds(answer.now)}"
    text += more(life.late_answers, ", and")
    text += ": it is slow, or the client's time-out short"
    return Finding(Cause.SDO_LATE, name, given_up.now, text, late, life.late_answers)
