"""The functions and events of an expectation: ``abs(x)``, ``rises(x)``, ``emcy(valve)``."""

from collections.abc import Callable, Sequence
from types import MappingProxyType
from typing import Final

from hil_bench.abilities.scenario.dimensions import TIME, multiply
from hil_bench.abilities.scenario.nodes import (
    UNBOUNDED,
    Always,
    Comparison,
    ConditionEdge,
    Edge,
    Event,
    Magnitude,
    Node,
    Number,
    Position,
    PreviousCondition,
    PreviousValue,
    Rate,
    Reading,
    Relation,
    Turn,
    Window,
)
from hil_bench.abilities.scenario.operands import MeasuredValue, Operand, State, Text, quantity_of
from hil_bench.abilities.scenario.operators import compare
from hil_bench.abilities.scenario.syntax import ExpectationError
from hil_bench.abilities.scenario.vocabulary import DM1, EMCY, FRAME, Vocabulary
from hil_bench.config.values import find_nearest, quote
from hil_bench.devices.j1939.diagnostics import HIGHEST_FMI, HIGHEST_SPN

Call = Callable[[Sequence[Operand], Position, Vocabulary], Operand]

_NANOSECOND = 1e-9
_HIGHEST_ID = 0x1FFFFFFF
_NO_SIGNAL = "holds no signal, so nothing can change it; give a signal"


def _abs(given: Sequence[Operand], position: Position, _known: Vocabulary) -> Operand:
    (operand,) = _take(given, "abs(x)", position)
    found = quantity_of(operand, "abs")
    if isinstance(found.node, Number):
        return found._replace(node=Number(abs(found.node.value), position=position), slack=0.0)
    return found._replace(node=Magnitude(found.node, position=position), slack=0.0)


def _rate(given: Sequence[Operand], position: Position, _known: Vocabulary) -> Operand:
    (operand,) = _take(given, "rate(x)", position)
    found = quantity_of(operand, "rate")
    if found.is_constant:
        raise ExpectationError(position, f"rate {_NO_SIGNAL}")
    return MeasuredValue(Rate(found.node, position=position), multiply(found.dimension, TIME, -1))


def _previous(given: Sequence[Operand], position: Position, _known: Vocabulary) -> Operand:
    (operand,) = _take(given, "previous(x)", position)
    if isinstance(operand, Node):
        return PreviousCondition(operand, position=position)
    found = quantity_of(operand, "previous")
    if found.is_constant:
        raise ExpectationError(position, f"previous {_NO_SIGNAL}")
    return found._replace(node=PreviousValue(found.node, position=position), slack=0.0)


def _edge(turn: Turn) -> Call:
    def build(given: Sequence[Operand], position: Position, _known: Vocabulary) -> Operand:
        (operand,) = _take(given, f"{turn}(x)", position)
        if isinstance(operand, State):
            return _state_edge(turn, operand, position)
        if isinstance(operand, Node):
            return ConditionEdge(turn, operand, position=position)
        found = quantity_of(operand, turn)
        if found.is_constant:
            raise ExpectationError(position, f"{turn} {_NO_SIGNAL}")
        return Edge(turn, found.node, position=position)

    return build


def _state_edge(turn: Turn, state: State, position: Position) -> Operand:
    if turn is not Turn.CHANGES:
        right = f'give changes({state.name}), or {turn}({state.name} == "...")'
        raise ExpectationError(position, f"a state neither rises nor falls; {right}")
    return Edge(turn, Reading(state.name, position=state.position), position=position)


def _settled(given: Sequence[Operand], position: Position, known: Vocabulary) -> Operand:
    form = "settled(deviation, band) or settled(deviation, band, time)"
    if len(given) not in {2, 3}:
        raise ExpectationError(position, f"settled takes 2 or 3 values; write {form}")
    inside = compare([_abs(given[:1], position, known), given[1]], [Relation.LESS_EQUAL], known)
    if not isinstance(inside, Comparison):  # a state, which `quantity_of` has refused
        raise ExpectationError(position, f"settled needs a deviation; write {form}")
    window = UNBOUNDED
    if len(given) == 3:
        time = quantity_of(given[2], "settled")
        if time.node_value is None or time.dimension != TIME or time.node_value < 0:
            raise ExpectationError(time.node.position, "is no time; give for example 200 ms")
        window = Window(0, round(time.node_value / _NANOSECOND))
    return Always(window, inside, position=position)


def _emcy(given: Sequence[Operand], position: Position, known: Vocabulary) -> Operand:
    form = "emcy(NODE) or emcy(NODE, 0x8110)"
    if not 1 <= len(given) <= 2 or not isinstance(given[0], Text):
        raise ExpectationError(position, f"emcy takes the name of a node; write {form}")
    node = given[0]
    if node.text not in known.nodes:
        near = f"the nearest is {find_nearest(node.text, known.nodes)}" if known.nodes else ""
        right = near or "there are no nodes here"
        raise ExpectationError(node.position, f"{quote(node.text)} is no node; {right}")
    code = f", 0x{_whole(given[1], 0xFFFF, form):04X}" if len(given) == 2 else ""
    return Event(f"{EMCY}({node.text}{code})", position=position)


def _dm1(given: Sequence[Operand], position: Position, known: Vocabulary) -> Operand:
    form = "dm1(DEVICE), dm1(DEVICE, 1907) or dm1(DEVICE, 1907, 9)"
    if not 1 <= len(given) <= 3 or not isinstance(given[0], Text):
        raise ExpectationError(position, f"dm1 takes the name of a J1939 device; write {form}")
    device = given[0]
    if device.text not in known.ecus:
        near = f"the nearest is {find_nearest(device.text, known.ecus)}" if known.ecus else ""
        right = near or "there are none here"
        raise ExpectationError(device.position, f"{quote(device.text)} is no J1939 device; {right}")
    limits = (HIGHEST_SPN, HIGHEST_FMI)
    numbers = [_whole(each, high, form) for each, high in zip(given[1:], limits, strict=False)]
    name = ", ".join([device.text, *map(str, numbers)])
    return Event(f"{DM1}({name})", position=position)


def _frame(given: Sequence[Operand], position: Position, known: Vocabulary) -> Operand:
    (operand,) = _take(given, "frame(0x181)", position)
    if not known.has_frames:
        raise ExpectationError(position, "there are no frames here; give a signal")
    return Event(f"{FRAME}(0x{_whole(operand, _HIGHEST_ID, 'frame(0x181)'):X})", position=position)


def _whole(operand: Operand, highest: int, form: str) -> int:
    value = quantity_of(operand, "this").node_value
    if value is None or value != int(value) or not 0 <= value <= highest:
        where = quantity_of(operand, "this").node.position
        raise ExpectationError(
            where, f"is no number from 0 to 0x{highest:X}; write it as in {form}"
        )
    return int(value)


def _take(given: Sequence[Operand], form: str, position: Position) -> Sequence[Operand]:
    if len(given) != 1:
        raise ExpectationError(position, f"takes 1 value, not {len(given)}; write {form}")
    return given


CALLS: Final = MappingProxyType(
    {
        "abs": _abs,
        "rate": _rate,
        "previous": _previous,
        "settled": _settled,
        **{turn.value: _edge(turn) for turn in Turn},
        EMCY: _emcy,
        DM1: _dm1,
        FRAME: _frame,
    }
)
"""Each function by its name."""
