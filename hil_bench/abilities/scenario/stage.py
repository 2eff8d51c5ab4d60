"""A scenario on a session: its steps act there at the start of their ticks."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

from hil_bench.abilities.common.commands import SetObject, SetPlant
from hil_bench.abilities.controllers.power import ONLY
from hil_bench.abilities.faults.commands import BeginFault
from hil_bench.abilities.faults.fault import FaultConfig
from hil_bench.abilities.faults.faults import Faults
from hil_bench.abilities.j1939.kinds.auxiliary_valve import SET_POINT
from hil_bench.abilities.j1939.protocol.auxiliary_valve import (
    COMMAND,
    PERIOD,
    PRIORITY,
    pack_command,
)
from hil_bench.abilities.j1939.protocol.signals import join
from hil_bench.abilities.modbus.binding import ModbusBinding
from hil_bench.abilities.scenario.monitor import Monitor
from hil_bench.abilities.scenario.reach import names_in
from hil_bench.abilities.scenario.recorded import Finding, Trace, judge_trace
from hil_bench.abilities.scenario.records import FirmwareStep, NmtStep, NmtVerb, SyncStep
from hil_bench.abilities.scenario.resolve import PreparedScenario, SetAction, TimedAction
from hil_bench.abilities.scenario.targets import (
    ALL,
    ObjectTarget,
    PlantTarget,
    RegisterTarget,
    SignalTarget,
    Target,
    Targets,
    ValveTarget,
    WriteRegister,
)
from hil_bench.abilities.scenario.witness import Witness
from hil_bench.bench.assembly import number_buses
from hil_bench.bench.commands import Command
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.session import Session
from hil_bench.canopen_device.frame import DISABLED, Frame, can_id
from hil_bench.canopen_device.nmt import NMT_COB_ID, NmtCommand, NmtState
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.pdo_parameters import (
    COMMUNICATION_INDICES,
    Direction,
    MappingEntry,
    PdoMapping,
)
from hil_bench.canopen_device.sync import SYNC_COB_ID
from hil_bench.errors import ConfigError
from hil_bench.plants.plant import SUPPLY

if TYPE_CHECKING:
    from concurrent.futures import Future


# The hand of a scenario on its bench: what its steps do, as frames and as commands.
#
# What an RPDO carries goes as that RPDO, by the COB-ID and the mapping that the node has at the
# time: as a controller sends it. Other objects are written as an SDO server writes them, with the
# device's limits and checks, but without frames, which the controller's own SDO client would take
# for answers. A Modbus register is written as a request of a client writes it, without a client.

_TO_MAPPING = 0x200
_SERVICE_TOOL = 249
"""Source address of the valve commands of steps, that of an off-board service tool."""

_COMMANDS: Mapping[NmtVerb, NmtCommand] = {
    NmtVerb.START: NmtCommand.START,
    NmtVerb.STOP: NmtCommand.STOP,
    NmtVerb.PRE_OPERATIONAL: NmtCommand.ENTER_PRE_OPERATIONAL,
    NmtVerb.RESET_NODE: NmtCommand.RESET_NODE,
    NmtVerb.RESET_COMMUNICATION: NmtCommand.RESET_COMMUNICATION,
}


class Hand:
    """Sets things on a bench.

    Args:
        config: the bench.
        session: that bench.
    """

    def __init__(self, config: BenchConfig, session: Session) -> None:
        names = [node.name for node in config.nodes]
        self._nodes = dict(zip(names, session.bench.nodes, strict=True))
        self._buses = number_buses(config)

    def set(self, target: Target, value: float) -> Frame | SetObject | SetPlant | WriteRegister:
        """Return a frame to the bench, or a command to its door, that sets a target's value."""
        if isinstance(target, PlantTarget):
            return SetPlant(target.axis, target.influence.name, value)
        if isinstance(target, RegisterTarget):
            return WriteRegister(target, value)
        if isinstance(target, SignalTarget):
            return SetObject(target.device, target.name, target.raw(value))
        if isinstance(target, ValveTarget):
            can_id = join(PRIORITY, COMMAND + target.config.number, _SERVICE_TOOL)
            bus = self._buses[target.device]
            return Frame(can_id, pack_command(value), is_extended=True, bus=bus)
        raw = target.raw(value)
        node = self._nodes[target.node]
        if node.state is NmtState.OPERATIONAL:
            for identifier, mapping, shift in _carriers(node, target):
                data = _overlaid(mapping, target, raw, shift)
                return Frame(identifier, data, bus=self._buses[target.node])
        return SetObject(target.node, target.name, raw)

    def present(self, target: Target) -> float:
        """Return the value that a target has; of a plant, where nothing acts on it."""
        if isinstance(target, PlantTarget):
            return target.influence.usual
        if isinstance(target, RegisterTarget):
            held = target.read()
            return 0.0 if math.isnan(held) else held
        if isinstance(target, SignalTarget):
            shown = target.handle[target.name]
            return 0.0 if math.isnan(shown) else shown * target.factor
        if isinstance(target, ValveTarget):
            return target.handle[SET_POINT]
        return float(target.variable.value or 0) / target.scale

    def holds(self, target: Target, value: float) -> bool:
        """Return True if a target is known to have a value already; of a plant, as it begins."""
        match target:
            case PlantTarget():
                is_fixed = target.influence.name != SUPPLY  # a pump's varies
                return is_fixed and target.influence.usual == value
            case RegisterTarget():
                return target.read() == value
            case SignalTarget():
                return bool(target.handle[target.name] == target.raw(value))
            case ValveTarget():
                return target.handle[SET_POINT] == value
            case ObjectTarget():
                return bool(target.variable.value == target.raw(value))

    def command(self, step: NmtStep) -> list[Frame]:
        """Return the frames of an NMT command: one a bus where it is for all."""
        code = int(_COMMANDS[step.command])
        if step.target == ALL:
            buses = sorted(set(self._buses.values()))
            return [Frame(NMT_COB_ID, bytes((code, 0)), bus=bus) for bus in buses]
        data = bytes((code, self._nodes[step.target].node_id))
        return [Frame(NMT_COB_ID, data, bus=self._buses[step.target])]


def _carriers(node: Node, target: ObjectTarget) -> Iterator[tuple[int, PdoMapping, int]]:
    """Yield COB-ID and mapping of each RPDO that carries an object, and its place there [bit]."""
    objects = node.object_dictionary
    wanted = target.variable.index, target.variable.subindex
    for index in objects.indices(COMMUNICATION_INDICES[Direction.RPDO]):
        identifier = can_id(objects.number(index, 1, absent=DISABLED))
        count = objects.number(index + _TO_MAPPING)
        if identifier is None or not count:
            continue
        raws = [objects.number(index + _TO_MAPPING, sub) for sub in range(1, count + 1)]
        entries = [MappingEntry.parse(raw) for raw in raws]
        shift = 0
        for entry in entries:
            if (entry.index, entry.subindex) == wanted:
                yield identifier, PdoMapping(objects, entries, Direction.RPDO), shift
                break
            shift += entry.bits


def _overlaid(mapping: PdoMapping, target: ObjectTarget, raw: object, shift: int) -> bytes:
    """Return a PDO with what the node holds, but one object."""
    data_type = target.variable.data_type
    mask = ((1 << data_type.bits) - 1) << shift
    value = int.from_bytes(data_type.encode(raw), "little") << shift  # type: ignore[arg-type]
    word = int.from_bytes(mapping.read(), "little") & ~mask | value & mask
    return word.to_bytes(mapping.length, "little")


# Does the steps of a scenario, each at the start of its tick.


class Move(NamedTuple):
    """A value that is on its way.

    Attributes:
        target: whose value.
        points: ticks and values, straight lines between.
    """

    target: Target
    points: tuple[tuple[int, float], ...]

    def at(self, tick: int) -> float:
        """Return the value at a tick, the first one or later; behind the last one, its value."""
        for (start, low), (end, high) in pairwise(self.points):
            if start <= tick < end:
                return low + (high - low) * (tick - start) / (end - start)
        return self.points[-1][1]


class Director:
    """The steps of a run; it is the `intercept` of a session.

    Args:
        prepared: what to do.
        session: on which bench.
        targets: what may be set there.
        hand: sets it.

    Attributes:
        is_over: whether the run has come to its end.
        problem: what a step could not do; empty where all went well.
        sent: how many frames of steps the bench has got.
        is_changed: of each target that a step has set, whether one found another value there.
        overwrites: says of a target whether the controller, as it begins, overwrites its value.
    """

    overwrites: Callable[[str], bool] = staticmethod(lambda _name: False)

    def __init__(
        self, prepared: PreparedScenario, session: Session, targets: Targets, hand: Hand
    ) -> None:
        self.is_over = False
        self.problem = ""
        self.sent = 0
        self.is_changed: dict[str, bool] = {}
        self._actions, self._tick_ns = prepared.actions, prepared.config.tick_ns
        self._last_tick = prepared.last_tick
        # Ticks from SYNC to SYNC, where the scenario itself sends it; else 0.
        self._sync_ticks = 0 if prepared.scenario.controller else prepared.config.ticks_per_sync
        self._session, self._hand = session, hand
        self._targets = targets
        self._waiting = list(reversed(prepared.actions))
        self._courses: dict[str, Move] = {}
        self._values: dict[str, float] = {}
        self._repeated: dict[str, ValveTarget] = {}
        self._repeats_at: dict[str, int] = {}
        self._tick = 0
        self._sends_sync, self._passes_sync = False, True
        self._answers: list[tuple[str, Future[Any]]] = []
        session.watch(ticks=self._settle)

    def adopt(self, actions: Sequence[TimedAction]) -> None:
        """Go on with the actions of another run, whose first ones are those that have begun."""
        done = self.done
        self._actions = tuple(actions)
        self._waiting = list(reversed(actions[done:]))

    @property
    def done(self) -> int:
        """The number of actions that have begun, the first ones of the plan."""
        return len(self._actions) - len(self._waiting)

    def __call__(self, frames: Sequence[Frame], now: int) -> Sequence[Frame]:
        """Do what is due; return the frames of the controller, and behind them those of steps."""
        tick = self._tick = now // self._tick_ns
        if self.is_over or tick > self._last_tick:
            self.is_over = True
            return frames
        waiting = self._waiting
        is_due = bool(self._courses or self._repeated) or bool(waiting and waiting[-1].tick <= tick)
        own = list(self._due(tick)) if is_due else []
        if self._sends_sync and tick % self._sync_ticks == 0:
            own.append(Frame(SYNC_COB_ID))
        self.sent += len(own)
        if not self._passes_sync:
            frames = [frame for frame in frames if frame.can_id != SYNC_COB_ID]
        return [*frames, *own] if own else frames

    def _due(self, tick: int) -> Iterator[Frame]:
        while self._waiting and self._waiting[-1].tick <= tick:
            yield from self._act(self._waiting.pop(), tick)
        for name, course in list(self._courses.items()):
            if tick < course.points[0][0]:
                continue
            yield from self._set(name, course.target, course.at(tick))
            if tick >= course.points[-1][0]:
                del self._courses[name]
                if self.overwrites(name) and not self.problem:
                    when = f"has its value at {tick * self._tick_ns / 1e9:g} s"
                    why = "before the example has enabled the valve, and loses it then"
                    self.problem = f"{name}: {when}, {why}; give a later at_s"
                    self.is_over = True
        for name, target in self._repeated.items():
            if tick >= self._repeats_at[name]:
                yield from self._set(name, target, self._values[name])

    def _act(self, timed: TimedAction, tick: int) -> Iterator[Frame]:
        action = timed.action
        match action:
            case SetAction():
                self._courses[action.target] = self._course(action, tick)
            case FaultConfig():
                times = {} if action.duration is None else {"duration": action.duration}
                begin = BeginFault(action.kind, action.target, {**action.values, **times})
                self._put(timed.place, begin)
            case NmtStep():
                yield from self._hand.command(action)
            case SyncStep() if self._sync_ticks:
                self._sends_sync = action.is_on
            case SyncStep():
                self._passes_sync = action.is_on
            case FirmwareStep():
                self._switch(action)

    def _switch(self, step: FirmwareStep) -> None:
        """Switch a controller: the one that is named, the scenario's own, or the bench's only."""
        switches = self._session.switches
        name = step.target or (ONLY if ONLY in switches else next(iter(switches)))
        switches[name](step.command)

    def _course(self, action: SetAction, tick: int) -> Move:
        target = self._targets.find(action.target)
        start = self._values.get(action.target, self._hand.present(target))
        return Move(target, action.points(tick, start))

    def _set(self, name: str, target: Target, value: float) -> Iterator[Frame]:
        if not self.is_changed.get(name):
            is_set_before = isinstance(target, PlantTarget) and name in self._values
            held = self._values[name] == value if is_set_before else self._hand.holds(target, value)
            self.is_changed[name] = not held
        self._values[name] = value
        done = self._hand.set(target, value)
        if isinstance(target, ValveTarget):
            self._repeated[name] = target
            self._repeats_at[name] = self._tick + -(-PERIOD // self._tick_ns)
        if isinstance(done, Frame):
            yield done
        else:
            self._put(name, done)

    def _put(self, place: str, command: Command) -> None:
        self._answers.append((place, self._session.door.put(command)))

    def _settle(self, _now: int) -> None:
        """See whether all commands of the tick could act; end the run where one could not."""
        for place, answer in self._answers:
            error = answer.exception(0.0)
            if error is not None and not self.problem:
                self.problem, self.is_over = f"{place}: {error}", True
        self._answers.clear()


# A scenario on a session: its steps act there, and what its expectations need is taken down.

_BLOCK = 64  # ticks between two looks at whether a requirement has failed


class Stage:
    """The stage of a scenario: its actions on a session and its view of it.

    Args:
        prepared: the scenario.
        session: of its bench, before the first tick.
        stops_at_failure: whether the run is over when a requirement has failed.

    Attributes:
        director: does the steps; it knows when the run is over.
        witness: takes down what the expectations need.
    """

    def __init__(
        self, prepared: PreparedScenario, session: Session, *, stops_at_failure: bool = False
    ) -> None:
        config = prepared.config
        self._prepared, self._faults = prepared, session.bench.part(Faults)
        targets, hand = Targets(config, session), Hand(config, session)
        self.director = Director(prepared, session, targets, hand)
        names = names_in(each.condition for each in prepared.requirements)
        self.witness = Witness(config, session, names, prepared.last_tick)
        self._received, self._session = 0, session
        session.watch(frames=self._count)
        if stops_at_failure:
            session.watch(ticks=_Stopper(prepared, self.witness, self.director).look)
        session.intercept = self.director
        if session.bench.medium is not None:
            session.bench.medium.is_direct = False  # the director sees frames before the bus does

    def adopt(self, prepared: PreparedScenario) -> None:
        """Go on as another run of the scenario, which was the same up to now.

        Args:
            prepared: that run; its expectations name the same signals, states and events.
        """
        self._prepared = prepared
        self.director.adopt(prepared.actions)

    def _count(self, received: Sequence[Frame], _sent: Sequence[Frame], _now: int) -> None:
        self._received += len(received)

    @property
    def is_silent(self) -> bool:
        """Return True if nobody but the steps has sent a frame or written a register."""
        modbus = self._session.bench.find(ModbusBinding)
        return self._received <= self.director.sent and not (modbus and modbus.orders)

    def end(self) -> None:
        """Let the run be over."""
        self.director.is_over = True

    def judge(self, absent: Sequence[str] = ()) -> tuple[Finding, ...]:
        """Return the judgement on each requirement, by the ticks so far; the others are unknown.

        Args:
            absent: who was to act beside the stage and did not, in words.

        Raises:
            ConfigError: a step could not act.
        """
        if self.director.problem:
            raise ConfigError(self.director.problem)
        witness, planned = self.witness, self._prepared.last_tick + 1
        tick_ns = self._prepared.config.tick_ns
        actions = [each.action for each in self._prepared.actions]
        faults = [each for each in actions if isinstance(each, FaultConfig) and each.is_baseline]
        asked = {f"{each.kind} {each.target}" for each in faults}
        changed = self.director.is_changed
        remarks = [
            f"{name} was so already when a step set it" for name in changed if not changed[name]
        ]
        idle = list(absent)
        for fault in self._faults.idle:
            if fault in asked:
                remarks.append(f"the fault {fault} has an amount that changes nothing")
            else:
                idle.append(f"the fault {fault} has changed nothing")
        trace = Trace(
            witness.columns(), witness.ticks, tick_ns, planned, idle=idle, remarks=remarks
        )
        return tuple(judge_trace(each, trace) for each in self._prepared.requirements)


class _Stopper:
    """Ends a run when a requirement has failed."""

    def __init__(self, prepared: PreparedScenario, witness: Witness, director: Director) -> None:
        tick_ns = prepared.config.tick_ns
        self._monitors = [Monitor(each.condition, tick_ns) for each in prepared.requirements]
        self._witness, self._director = witness, director
        self._seen = 0

    def look(self, _now: int) -> None:
        """Judge the ticks since the last look, where they are enough."""
        ticks = self._witness.ticks
        if ticks - self._seen < _BLOCK or self._director.is_over:
            return
        columns = self._witness.columns(self._seen)
        for monitor in self._monitors:
            monitor.push(columns, ticks - self._seen)
        self._seen = ticks
        self._director.is_over = any(monitor.is_failed for monitor in self._monitors)
