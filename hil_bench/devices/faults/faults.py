"""The faults of a bench: `bench.faults.freeze("pressure_a")`.

Each verb makes one fault and returns it. It begins with the next tick, or `at` a bench time; it
lasts until it is cleared, or for `duration`::

    with bench.faults.freeze("pressure_a"):            # for the block
        bench.run(0.5)
    fault = bench.faults.offset("pressure_a", 20e5)    # until fault.clear()
    bench.faults.silence("valve", at=2.0, duration=1.0)

Amounts and times are in SI. Whatever makes no sense is refused with a `ConfigError`.
"""

from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Unpack

from hil_bench.canopen_device.node import Node
from hil_bench.devices.faults.checks import (
    bounded,
    choose,
    count,
    find,
    identifier,
    to_ns,
)
from hil_bench.devices.faults.ecu_point import (
    AddressEffect,
    IndicationEffect,
    RestartEffect,
    TroubleEffect,
)
from hil_bench.devices.faults.effects import (
    BabbleEffect,
    EnableEffect,
    LineEffect,
    ResetEffect,
    SensorEffect,
    SpoolEffect,
    SupplyEffect,
    WireEffect,
)
from hil_bench.devices.faults.fault import Fault
from hil_bench.devices.faults.kinds import BrokenReading, FaultDirection, FaultKind
from hil_bench.devices.faults.line import (
    Line,
    Meeting,
    Rule,
    babble,
    corruption,
    delay,
    disturbance,
    loss,
    repetition,
    silence,
    truncation,
)
from hil_bench.devices.faults.physical_faults import PhysicalFaults
from hil_bench.devices.faults.points import FaultPoints, Places
from hil_bench.devices.faults.schedule import When
from hil_bench.devices.faults.sensor_stages import (
    Broken,
    Frozen,
    Lag,
    Noisy,
    SensorStage,
    Shifted,
    Slowed,
)
from hil_bench.devices.faults.wire_point import WirePoint
from hil_bench.devices.j1939.diagnostics import HIGHEST_FMI, HIGHEST_SPN, Lamp
from hil_bench.devices.j1939.identifier import NULL
from hil_bench.devices.j1939.signal_table import Indication, SentSignal
from hil_bench.devices.measurement.noise import normal_numbers, random_stream
from hil_bench.errors import ConfigError

if TYPE_CHECKING:
    from numpy.random import Generator

_SHORTEST_LAG = 1e-6
_LONGEST_LAG = 1e6
_HIGHEST_SUPPLY = 1e9  # [Pa], ten times that of a water jet cutter
_MOST_FRAMES = 1000


class Which(When, total=False):
    """The frames of a node that a fault meets, and the times.

    Attributes:
        direction: "sent", "received" or "both", seen from the node.
        can_id: their identifier; without it, all.
    """

    direction: FaultDirection | str
    can_id: int | None


class Faults(PhysicalFaults):
    """The faults of one bench.

    Args:
        points: the targets of faults.
        places: where they act in a tick, those of the bench that this is to join; without them,
            nowhere.
        tick_ns: time between two ticks [ns].
        seed: of the random faults.

    Attributes:
        lines: connections that have or had a fault, by node; a new object whenever one comes in.
    """

    lines: Mapping[Node, Line]

    def __init__(
        self,
        points: FaultPoints | None = None,
        places: Places | None = None,
        *,
        tick_ns: int = 1_000_000,
        seed: int = 0,
    ) -> None:
        super().__init__(points or FaultPoints(), tick_ns, places.holds if places else [])
        self._places = places
        self._tick_ns = tick_ns
        self.lines = {}
        self._seed = seed
        self._streams: Counter[str] = Counter()

    def join(self, bench: Places) -> None:
        """Begin and end what is due at the beginning of each tick of a bench."""
        board = bench.switchboard

        def begin(now: int) -> None:
            if now >= self.due:
                self.advance(now)
                board.lay(self, self.lines)

        board.lay(self, self.lines)
        bench.begins.append(begin)

    def rehearsal(self) -> "Faults":
        """Faults of the same bench to try a schedule on; those that are tried here never begin."""
        return Faults(self._points, tick_ns=self._tick_ns, seed=self._seed)

    @property
    def targets(self) -> dict[str, list[str]]:
        """Names of the fault targets: sensors, valves, supplies, plants that wear, nodes, ECUs."""
        points = self._points
        return {
            "sensors": [*points.sensors],
            "valves": [*points.valves],
            "supplies": [*points.supplies],
            "plants": [name for name, point in points.plants.items() if point.known],
            "nodes": [*points.nodes, *points.ecus],
            "wired": [*points.wires],
            "ecus": [*points.ecus],
            "signals": [*self._signals],
        }

    @property
    def defects(self) -> dict[str, list[str]]:
        """Names of the defects that a plant or a supply can have, by its name."""
        return {name: sorted(point.known) for name, point in self._points.plants.items()}

    def freeze(self, sensor: str, **when: Unpack[When]) -> Fault:
        """Freeze the value of a sensor."""
        return self._measure(FaultKind.FREEZE, sensor, Frozen, when)

    def offset(self, sensor: str, amount: float, **when: Unpack[When]) -> Fault:
        """Add an offset [Pa or m] to the value of a sensor."""
        make = partial(Shifted, bounded("amount", amount), 0.0, self._tick)
        return self._measure(FaultKind.OFFSET, sensor, make, when)

    def drift(self, sensor: str, rate: float, **when: Unpack[When]) -> Fault:
        """Let the value of a sensor drift at a rate [Pa/s or m/s]."""
        make = partial(Shifted, 0.0, bounded("rate", rate), self._tick)
        return self._measure(FaultKind.DRIFT, sensor, make, when)

    def noise(self, sensor: str, rms: float, **when: Unpack[When]) -> Fault:
        """Add noise of an RMS [Pa or m] to the value of a sensor."""
        draw = normal_numbers(self._stream(sensor))
        make = partial(Noisy, bounded("rms", rms, low=0.0), draw)
        return self._measure(FaultKind.NOISE, sensor, make, when)

    def break_wire(
        self, sensor: str, reads: BrokenReading | str = BrokenReading.NOTHING, **when: Unpack[When]
    ) -> Fault:
        """Break a sensor's wire: it reads "nothing", or beyond its range, "low" or "high"."""
        make = partial(Broken, choose("reads", BrokenReading, reads))
        return self._measure(FaultKind.BREAK_WIRE, sensor, make, when)

    def slow(self, target: str, time_constant: float, **when: Unpack[When]) -> Fault:
        """Add a lag of a time constant [s] to a sensor, or to the spool of a valve."""
        lag = bounded("time_constant", time_constant, low=_SHORTEST_LAG, high=_LONGEST_LAG)
        if target not in self._points.valves:
            known = {**self._points.sensors, **self._points.valves}
            find("sensor or valve", target, known)
            return self._measure(FaultKind.SLOW, target, partial(Slowed, lag, self._tick), when)
        point = self._points.valves[target]
        effect = SpoolEffect(point, lambda position: Lag(lag, self._tick, position).follow)
        return self.add(FaultKind.SLOW, target, effect, when)

    def stick(self, valve: str, **when: Unpack[When]) -> Fault:
        """Hold the spool of a valve where it is."""
        point = find("valve", valve, self._points.valves)
        effect = SpoolEffect(point, lambda position: lambda _setpoint: position)
        return self.add(FaultKind.STICK, valve, effect, when)

    def invert(self, valve: str, **when: Unpack[When]) -> Fault:
        """Invert the spool of a valve, as crossed wires do."""
        point = find("valve", valve, self._points.valves)
        effect = SpoolEffect(point, lambda _position: lambda setpoint: -setpoint)
        return self.add(FaultKind.INVERT, valve, effect, when)

    def disable(self, valve: str, **when: Unpack[When]) -> Fault:
        """Switch the enable input of a valve off.

        Raises:
            ConfigError: it has none.
        """
        device = find("valve", valve, self._points.valves).device
        if device is None:
            raise ConfigError(f"faults: {valve} has no enable input; give a valve that has one")
        return self.add(FaultKind.DISABLE, valve, EnableEffect(device), when)

    def drop_supply(self, axis: str, pressure: float, **when: Unpack[When]) -> Fault:
        """Hold the supply pressure of an axis at `pressure` [Pa], not below that of the tank."""
        point = find("axis", axis, self._points.supplies)
        bounded("pressure", pressure, low=point.lowest, high=_HIGHEST_SUPPLY)
        effect = SupplyEffect(point.plant, pressure, self._holds)
        return self.add(FaultKind.DROP_SUPPLY, axis, effect, when)

    def silence(self, node: str, **when: Unpack[When]) -> Fault:
        """Cut a node off the bus, as in bus-off: it neither sends nor receives."""
        effect = LineEffect(self._line(node), Meeting(silence))
        return self.add(FaultKind.SILENCE, node, effect, when)

    def reset(self, node: str, **when: Unpack[When]) -> Fault:
        """Switch a node off, and let it boot at the end; without a duration, at once."""
        line, ecu = self._line(node), self._points.ecus.get(node)
        effect = RestartEffect(ecu) if ecu else ResetEffect(self._points.nodes[node], line)
        when.setdefault("duration", 0.0)
        return self.add(FaultKind.RESET, node, effect, when)

    def lose(self, node: str, share: float = 1.0, **which: Unpack[Which]) -> Fault:
        """Lose a share of a node's frames, 0 to 1, at random."""
        bounded("share", share, low=0.0, high=1.0)
        rule = loss(share, self._stream(node))
        return self._disturb(FaultKind.LOSE, node, rule, which)

    def delay(self, node: str, time: float, **which: Unpack[Which]) -> Fault:
        """Delay a node's frames by `time` [s], rounded up to ticks."""
        return self._disturb(FaultKind.DELAY, node, delay(to_ns("time", time)), which)

    def truncate(self, node: str, length: int, **which: Unpack[Which]) -> Fault:
        """Cut or fill a node's data frames to `length` bytes, 0 to 8.

        Without a direction, those that it sends.
        """
        rule = truncation(count("length", length, 0, 8))
        which.setdefault("direction", FaultDirection.SENT)
        return self._disturb(FaultKind.TRUNCATE, node, rule, which)

    def corrupt(self, node: str, share: float = 1.0, **which: Unpack[Which]) -> Fault:
        """Flip one bit in a share of a node's data frames, 0 to 1, at random.

        Without a direction, in those that it sends.
        """
        bounded("share", share, low=0.0, high=1.0)
        which.setdefault("direction", FaultDirection.SENT)
        rule = corruption(share, self._stream(node))
        return self._disturb(FaultKind.CORRUPT, node, rule, which)

    def repeat(self, node: str, **which: Unpack[Which]) -> Fault:
        """Let a node's data frames repeat the first of each identifier, as when it hangs.

        Without a direction, those that it sends.
        """
        which.setdefault("direction", FaultDirection.SENT)
        return self._disturb(FaultKind.REPEAT, node, repetition(), which)

    def babble(
        self,
        node: str,
        frames_per_tick: int = 4,
        *,
        can_id: int = 0x001,
        **when: Unpack[When],
    ) -> Fault:
        """Let a node flood the bus with frames of an identifier."""
        self._check_node(node)
        frames = count("frames_per_tick", frames_per_tick, 1, _MOST_FRAMES)
        send = babble(identifier(can_id) or 0, frames, self._points.buses.get(node, 0))
        places = self._places

        def act(_now: int) -> None:
            if places is not None:
                send(places.switchboard.emit)

        finishes = places.finishes if places is not None else []
        return self.add(FaultKind.BABBLE, node, BabbleEffect(act, finishes), when)

    def bit_error(self, node: str, share: float = 1.0, **which: Unpack[Which]) -> Fault:
        """Disturb a bit in a share of a node's frames, 0 to 1, at random, on a bus of copper.

        Without a direction, in those that it sends; "received": it misreads those of others.
        """
        bounded("share", share, low=0.0, high=1.0)
        point = self._wire(node)
        direction = choose("direction", FaultDirection, which.pop("direction", FaultDirection.SENT))
        rule = disturbance(share, identifier(which.pop("can_id", None)), self._stream(node))
        sides = [
            side
            for side, each in ((True, FaultDirection.SENT), (False, FaultDirection.RECEIVED))
            if direction in {each, FaultDirection.BOTH}
        ]

        def begin(_now: int) -> None:
            for is_sent in sides:
                point.disturb(rule, is_sent=is_sent)

        def end(_now: int) -> None:
            for is_sent in sides:
                point.spare(rule, is_sent=is_sent)

        return self.add(FaultKind.BIT_ERROR, node, WireEffect(begin, end), which)

    def bus_off(self, node: str, **when: Unpack[When]) -> Fault:
        """Make a node bus-off; afterwards it recovers and sends EMCY 0x8140."""
        point = self._wire(node)
        effect = WireEffect(point.force_off, point.let_recover)
        return self.add(FaultKind.BUS_OFF, node, effect, when)

    def stuck_dominant(self, node: str, **when: Unpack[When]) -> Fault:
        """Let a node's transceiver hold its bus dominant: nobody can send."""
        point = self._wire(node)
        effect = WireEffect(point.stick, point.unstick)
        return self.add(FaultKind.STUCK_DOMINANT, node, effect, when)

    def no_acknowledge(self, node: str, **when: Unpack[When]) -> Fault:
        """Pull a node's plug: nobody acknowledges what it sends, and it repeats it."""
        point = self._wire(node)
        effect = WireEffect(point.pull, point.plug)
        return self.add(FaultKind.NO_ACKNOWLEDGE, node, effect, when)

    def indicate(
        self, signal: str, shows: Indication | str = Indication.ERROR, **when: Unpack[When]
    ) -> Fault:
        """Let a J1939 signal, as "joystick.x", show the "error" indicator or "not_available"."""
        found = find("signal", signal, self._signals)
        effect = IndicationEffect(found, choose("shows", Indication, shows))
        return self.add(FaultKind.INDICATE, signal, effect, when)

    def report(
        self, device: str, spn: int, fmi: int, lamp: str = "warning", **when: Unpack[When]
    ) -> Fault:
        """Let a J1939 device report a trouble code by DM1, and light a lamp.

        Raises:
            ConfigError: there is no such lamp.
        """
        ecu = find("J1939 device", device, self._points.ecus).ecu
        if lamp.upper() not in Lamp.__members__:
            known = ", ".join(f'"{each.lower()}"' for each in Lamp.__members__)
            raise ConfigError(f'faults: lamp = "{lamp}" is unknown; give one of {known}')
        code = count("spn", spn, 0, HIGHEST_SPN), count("fmi", fmi, 0, HIGHEST_FMI)
        effect = TroubleEffect(ecu, *code, Lamp[lamp.upper()])
        return self.add(FaultKind.REPORT, device, effect, when)

    def readdress(self, device: str, address: int, **when: Unpack[When]) -> Fault:
        """Let a J1939 device send from an address that it has not claimed, 0 to 253."""
        ecu = find("J1939 device", device, self._points.ecus).ecu
        effect = AddressEffect(ecu, count("address", address, 0, NULL - 1))
        return self.add(FaultKind.READDRESS, device, effect, when)

    @property
    def _signals(self) -> dict[str, SentSignal]:
        ecus = self._points.ecus
        return {f"{n}.{s}": each for n, ecu in ecus.items() for s, each in ecu.signals.items()}

    def _check_node(self, name: str) -> None:
        find("node", name, {**self._points.nodes, **self._points.ecus})

    def _wire(self, name: str) -> WirePoint:
        self._check_node(name)
        if name not in self._points.wires:
            raise ConfigError(f"faults: the bus of {name} takes no time; give it [bus.wire]")
        return self._points.wires[name]

    def _measure(
        self, kind: FaultKind, sensor: str, make: Callable[[], SensorStage], when: When
    ) -> Fault:
        point = find("sensor", sensor, self._points.sensors)
        return self.add(kind, sensor, SensorEffect(point, make), when)

    def _disturb(self, kind: FaultKind, node: str, rule: Rule, which: Which) -> Fault:
        direction = choose("direction", FaultDirection, which.pop("direction", FaultDirection.BOTH))
        meeting = Meeting(rule, direction, identifier(which.pop("can_id", None)))
        return self.add(kind, node, LineEffect(self._line(node), meeting), which)

    def _line(self, name: str) -> Line:
        self._check_node(name)
        if name in self._points.ecus:
            return self._points.ecus[name].line
        node = self._points.nodes[name]
        if node not in self.lines:
            self.lines = {**self.lines, node: Line(node)}
        return self.lines[node]

    def _stream(self, target: str) -> "Generator":
        """Return the random stream of the target's next fault that needs one."""
        self._streams[target] += 1
        return random_stream(self._seed, target, f"fault {self._streams[target]}")
