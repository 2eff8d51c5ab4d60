"""A run's readings for the expectations: signals, states, objects, registers, events by tick."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from operator import itemgetter
from types import MappingProxyType

import numpy as np

from hil_bench.abilities.j1939.ecus import EcuHandle
from hil_bench.abilities.j1939.protocol.address_claim import ClaimState
from hil_bench.abilities.modbus.binding import ModbusBinding
from hil_bench.abilities.scenario.nodes import DM1, EMCY, FRAME, Vocabulary
from hil_bench.abilities.scenario.targets import (
    RegisterTarget,
    is_number,
    name_registers,
    name_shared,
)
from hil_bench.abilities.scenario.values import Floats
from hil_bench.bench.assembly import number_buses
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.peers import peers_of
from hil_bench.bench.session import Session
from hil_bench.canopen_device.datatypes import BooleanType, DataType, IntegerType
from hil_bench.canopen_device.frame import DISABLED, Frame, can_id
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import Variable
from hil_bench.config.objects import name_object
from hil_bench.devices.valve_state_machine import ValveState
from hil_bench.units import si_unit

# Readings of a J1939 device: its signals, its address claim, its trouble codes.

Read = Callable[[Sequence[float]], float]
"""Returns a value [SI]; it is given the row of the tick."""

_STATE, _ADDRESS = "state", "address"
_STATES: Mapping[str, int] = MappingProxyType(
    {state.value: number for number, state in enumerate(ClaimState)}
)


def ecu_names(ecus: Mapping[str, EcuHandle]) -> tuple[dict[str, str], dict[str, Mapping[str, int]]]:
    """Return the SI unit of each signal, and the numbers of the texts of each state."""
    signals: dict[str, str] = {}
    states: dict[str, Mapping[str, int]] = {}
    for name, ecu in ecus.items():
        signals[f"{name}.{_ADDRESS}"] = "-"
        if _STATE not in ecu:
            states[f"{name}.{_STATE}"] = _STATES
        signals |= {f"{name}.{each}": si_unit(v.unit)[0] for each, v in ecu.values.items()}
    return signals, states


def ecu_reader(ecus: Mapping[str, EcuHandle], name: str) -> Read | None:
    """Return the reader of a name or of a trouble code's activity; None for another name."""
    if name.startswith(f"{DM1}("):
        device, *numbers = name[len(DM1) + 1 : -1].split(", ")
        return _code_reader(ecus[device], tuple(map(int, numbers)))
    owner, _, rest = name.partition(".")
    ecu = ecus.get(owner)
    if ecu is None:
        return None
    if rest in ecu:
        value = ecu.values[rest]
        factor = si_unit(value.unit)[1]
        return lambda _row: value.read() * factor if _is_on(ecu) else math.nan
    if rest == _STATE:
        return lambda _row: float(_STATES[ecu.ecu.state])
    return (lambda _row: float(ecu.address)) if rest == _ADDRESS else None


def _is_on(ecu: EcuHandle) -> bool:
    return ecu.ecu.state is not ClaimState.OFF


def _code_reader(ecu: EcuHandle, code: tuple[int, ...]) -> Read:
    """Return the reader of an active code with this SPN and FMI; those left out match any."""
    return lambda _row: (
        float(any(each[: len(code)] == code for each in ecu.trouble_codes))
        if _is_on(ecu)
        else math.nan
    )


_EMCY_OBJECT = 0x1014
_NMT_STATES: Mapping[str, int] = MappingProxyType({state.name: int(state) for state in NmtState})
_VALVE_STATES: Mapping[str, int] = MappingProxyType(
    {state.value: number for number, state in enumerate(ValveState)}
)


def bench_vocabulary(
    config: BenchConfig, session: Session, parameters: Mapping[str, float]
) -> Vocabulary:
    """Return all that expectations may name on a virtual bench.

    Args:
        config: the bench.
        session: that bench.
        parameters: the SI value of each parameter.
    """
    bench = session.bench
    names = tuple(node.name for node in config.nodes)
    signals = {channel.name: channel.unit for channel in session.channels}
    registers = name_registers(session.bench.find(ModbusBinding))
    signals |= {name: each.entry.register.unit.symbol for name, each in registers.items()}
    ranges = {name: each.entry.register.span for name, each in registers.items()}
    states: dict[str, Mapping[str, int]] = {f"{name}.nmt": _NMT_STATES for name in names}
    for name, node, fitting in zip(names, bench.nodes, bench.fittings, strict=True):
        objects = {f"{name}.{name_object(v.index, v.subindex)}": v for v in _numbers(node)}
        signals |= dict.fromkeys(objects, "-")
        ranges |= {each: _range_of(variable.data_type) for each, variable in objects.items()}
        if fitting.state is not None:
            states[f"{name}.state"] = _VALVE_STATES
    own_signals, own_states = ecu_names(peers_of(session.bench))
    shared = name_shared(registers)
    return Vocabulary(
        signals | own_signals,
        states | own_states,
        names,
        True,
        parameters,
        shared,
        tuple(peers_of(session.bench)),
        ranges,
    )


class Witness:
    """Takes down what expectations need of a run.

    Args:
        config: the bench.
        session: that bench.
        names: of signals, states and events.
        last_tick: number of the last tick that counts.

    Attributes:
        ticks: how many it has seen.
    """

    def __init__(
        self, config: BenchConfig, session: Session, names: Iterable[str], last_tick: int
    ) -> None:
        self._last_tick, self._tick = last_tick, config.tick_ns * 1e-9
        self._rows: list[Sequence[float]] = []
        self._heard: set[str] = set()
        self._nodes = dict(zip((n.name for n in config.nodes), session.bench.nodes, strict=True))
        self._registers = name_registers(session.bench.find(ModbusBinding))
        self._buses = number_buses(config)
        self._names = sorted(names)
        places = {channel.name: number for number, channel in enumerate(session.channels, 1)}
        states = {
            node.name: fitting.state
            for node, fitting in zip(config.nodes, session.bench.fittings, strict=True)
        }
        readers = [
            ecu_reader(peers_of(session.bench), name) or self._reader(name, places, states)
            for name in self._names
        ]
        self._read: Callable[[Sequence[float]], Sequence[float]]
        if len(readers) > 1 and all(name in places for name in self._names):
            self._read = itemgetter(*(places[name] for name in self._names))
        else:
            self._read = lambda row: [read(row) for read in readers]
        self._hears = any(name.startswith((f"{EMCY}(", f"{FRAME}(")) for name in self._names)
        session.watch(frames=self._hear if self._hears else None, rows=self._note)

    @property
    def ticks(self) -> int:
        """The number of ticks seen."""
        return len(self._rows)

    def columns(self, start: int = 0) -> dict[str, Floats]:
        """Return the values of each name from a tick on."""
        rows = self._rows[start:]
        table = np.array(rows, dtype=np.float64).reshape(len(rows), len(self._names))
        return {name: table[:, number].copy() for number, name in enumerate(self._names)}

    def _note(self, row: Sequence[float]) -> None:
        number, rows = round(row[0] / self._tick), self._rows
        while len(rows) < number and len(rows) <= self._last_tick:
            rows.append([math.nan] * len(self._names))  # a tick that the loop left out
        if number <= self._last_tick:
            rows.append(self._read(row))
        if self._heard:
            self._heard.clear()

    def _hear(self, received: Sequence[Frame], sent: Sequence[Frame], _now: int) -> None:
        heard = self._heard
        heard.update(f"{FRAME}(0x{frame.can_id:X})" for frame in (*received, *sent))
        for frame in sent:
            for name in self._senders_of_emcy(frame):
                heard.add(f"{EMCY}({name})")
                code = int.from_bytes(frame.data[:2], "little")
                heard.add(f"{EMCY}({name}, 0x{code:04X})")

    def _senders_of_emcy(self, frame: Frame) -> Iterator[str]:
        if 0x80 < frame.can_id < 0x780 and len(frame.data) == 8:
            for name, node in self._nodes.items():
                identifier = node.object_dictionary.number(_EMCY_OBJECT, absent=DISABLED)
                if can_id(identifier) == frame.can_id and self._buses[name] == frame.bus:
                    yield name

    def _reader(
        self, name: str, places: Mapping[str, int], states: Mapping[str, Callable[[], str] | None]
    ) -> Callable[[Sequence[float]], float]:
        if name in places:
            place = places[name]
            return lambda row: row[place]
        if name in self._registers:
            return partial(_shown, self._registers[name])
        owner, _, rest = name.partition(".")
        if owner not in self._nodes:
            return lambda _row: float(name in self._heard)
        node, state = self._nodes[owner], states.get(owner)
        if rest == "nmt":
            read: Callable[[], float] = lambda: float(node.state)  # noqa: E731
        elif rest == "state" and state is not None:
            read = partial(_state, state)
        else:
            wanted = [v for v in _numbers(node) if _is_named(v, rest)]
            read = partial(_held, wanted[0])
        return lambda _row: read() if node.has_power else math.nan


def _numbers(node: Node) -> Iterator[Variable]:
    return (variable for variable in node.object_dictionary if is_number(variable.data_type))


def _range_of(data_type: DataType) -> tuple[float, float]:
    """Return the least and the largest value of a number."""
    if isinstance(data_type, BooleanType):
        return 0.0, 1.0
    if isinstance(data_type, IntegerType):
        return float(data_type.low or 0), float(data_type.high or 0)
    return -math.inf, math.inf


def _is_named(variable: Variable, name: str) -> bool:
    return name_object(variable.index, variable.subindex) == name


def _held(variable: Variable) -> float:
    return math.nan if variable.value is None else float(variable.value)


def _shown(target: RegisterTarget, _row: Sequence[float]) -> float:
    return target.read()


def _state(read: Callable[[], str]) -> float:
    return float(_VALVE_STATES.get(read(), math.nan))
