"""Parameters and steps of a scenario that do nothing."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any

from hil_bench.abilities.controllers.python.examples import ControllerSettings
from hil_bench.abilities.faults.fault import FaultConfig
from hil_bench.abilities.faults.points import SENSORS, VALVES, Group
from hil_bench.abilities.faults.registry import find_fault_kind
from hil_bench.abilities.faults.section import FaultsPart
from hil_bench.abilities.j1939.kinds.auxiliary_valve import SET_POINT
from hil_bench.abilities.modbus.map_files import ModbusConfig, ModbusUnitConfig
from hil_bench.abilities.scenario.records import FaultStep, Reference, Scenario, SetStep, SyncStep
from hil_bench.abilities.scenario.resolve import SetAction, TimedAction
from hil_bench.abilities.scenario.targets import MODBUS
from hil_bench.bench.configuration import BenchConfig
from hil_bench.canopen_device.node import Node
from hil_bench.config.values import find_nearest
from hil_bench.devices.kinds.registry import VALVE

_WORD = re.compile(r"\w+")
_ENABLES = re.compile(r"\.0x(?:6040|604f)", re.IGNORECASE)
"""The control word of a valve, and its switch to the local set-point."""
MANUAL = "manual"
"""The example that reads no sensor."""


def unused_parameters(scenario: Scenario) -> Iterator[str]:
    """Yield the names of the parameters that no step, no expectation and no controller takes."""
    if scenario.controller is not None and scenario.controller.table:
        return  # it is given them all
    used = {*_names_in_steps(scenario), *_settings(scenario)}
    for each in scenario.expectations:
        used.update(_WORD.findall(each.that))
    if scenario.controller is not None:
        for word in scenario.controller.firmware:
            used.update(_WORD.findall(word))
    yield from (each.name for each in scenario.parameters if each.name not in used)


def usage_problems(scenario: Scenario) -> Iterator[str]:
    """Yield a line for each parameter that nothing takes."""
    own = _settings(scenario)
    for name in unused_parameters(scenario):
        right = "name it in a step, an expectation or the firmware's words"
        if own:
            right = f"the nearest of the controller's is {find_nearest(name, own)}"
        yield f"{scenario.path}: parameters.{name}: does nothing; {right}"


def idle_steps(
    scenario: Scenario,
    actions: Sequence[TimedAction],
    config: BenchConfig,
    nodes: Mapping[str, Node],
) -> Iterator[str]:
    """Yield a line for each step that cannot change anything, whatever the run does.

    Args:
        scenario: with its controller, which alone drives.
        actions: its steps, in the order of time.
        config: of the bench.
        nodes: of the bench, by name.
    """
    yield from _idle_switches(scenario, actions)
    is_bare = scenario.controller is None or bool(scenario.controller.example)
    others = [part for part in config.parts if not isinstance(part, FaultsPart)]
    if is_bare and not others:  # a controller of the bench may enable and read anything
        yield from _idle_valves(scenario, actions, config)
        yield from _unread_sensors(scenario, actions, config, nodes)


def _idle_switches(scenario: Scenario, actions: Sequence[TimedAction]) -> Iterator[str]:
    """Yield the steps that switch SYNC to what it is already."""
    is_on = scenario.controller is not None
    for _, action, place in actions:
        if not isinstance(action, SyncStep):
            continue
        if action.is_on == is_on:
            now = "on" if is_on else "off"
            yield f"{place}: SYNC is {now} already; leave the step out"
        is_on = action.is_on


def _idle_valves(
    scenario: Scenario, actions: Sequence[TimedAction], config: BenchConfig
) -> Iterator[str]:
    """Yield the set-points and spool faults of valves that nobody enables."""
    names = {target for target, _ in _targets(actions)}
    enabled = {name.partition(".")[0] for name in names if _ENABLES.search(name)}
    enabled |= {unit.node for unit in _units(config) if _names(names, f"{MODBUS}.{unit.name}.")}
    has_example = scenario.controller is not None and bool(scenario.controller.example)
    first = config.first_axis.name if has_example else ""
    for valve in (node for node in config.nodes if node.kind is VALVE):
        if valve.name in enabled or getattr(valve, "axis", None) == first:
            continue
        moves = {f"{valve.name}.{SET_POINT}", f"{valve.name}.0x6300.01"}
        idle = [place for target, place in _targets(actions) if target in moves]
        idle += [place for fault, place in _faults(actions, VALVES) if fault.target == valve.name]
        for place in idle:
            who = f"the example sets up {first} only" if has_example else "no step enables it"
            right = f'nmt = "start" and set = {{ "{valve.name}.0x6040" = 1 }}, then 3, then 7'
            yield f"{place}: {valve.name} is not enabled: {who}; give steps with {right}"


def _unread_sensors(
    scenario: Scenario,
    actions: Sequence[TimedAction],
    config: BenchConfig,
    nodes: Mapping[str, Node],
) -> Iterator[str]:
    """Yield the faults of sensors that no controller, no other node and no expectation reads."""
    listed = {each.name: each for each in config.nodes}
    texts = " ".join(each.that for each in scenario.expectations)
    is_closed = scenario.controller is not None and scenario.controller.example != MANUAL
    for fault, place in _faults(actions, SENSORS):
        name = fault.target.partition(".")[0]
        node = listed.get(name)
        if node is None or node.kind.is_drive or _is_heard(name, nodes):
            continue
        if is_closed and node.axis == config.first_axis.name:
            continue
        units = [f"{MODBUS}.{unit.name}." for unit in _units(config) if unit.node == name]
        if not any(word in texts for word in (name, "frame(", *units)):
            right = f"name {fault.target}.measured or emcy({name}) in an expectation"
            yield f"{place}: nothing reads {name}, so the fault changes nothing; {right}"


def _is_heard(name: str, nodes: Mapping[str, Node]) -> bool:
    """Return True if another node receives what a node sends."""
    sent = nodes[name].sent_ids
    return any(sent & node.routes.keys() for other, node in nodes.items() if other != name)


def _faults(actions: Sequence[TimedAction], group: Group[Any]) -> Iterator[tuple[FaultConfig, str]]:
    """Yield fault and place of each step that is a fault of a kind for a group of targets."""
    for _, action, place in actions:
        if isinstance(action, FaultConfig) and group in find_fault_kind(action.kind).groups:
            yield action, place


def _units(config: BenchConfig) -> Iterable[ModbusUnitConfig]:
    modbus = config.of(ModbusConfig)
    return modbus.units if modbus is not None else ()


def _names(names: Iterable[str], start: str) -> bool:
    return any(name.startswith(start) for name in names)


def _targets(actions: Sequence[TimedAction]) -> Iterator[tuple[str, str]]:
    """Yield target and place of each step that sets a value."""
    for _, action, place in actions:
        if isinstance(action, SetAction):
            yield action.target, place


def _settings(scenario: Scenario) -> list[str]:
    """List the settings of the example controller; empty for another controller."""
    if scenario.controller is None or not scenario.controller.example:
        return []
    return [field.name for field in fields(ControllerSettings)]


def _names_in_steps(scenario: Scenario) -> Iterator[str]:
    for step in scenario.steps:
        values = [getattr(step, field.name) for field in fields(step)]
        if isinstance(step, FaultStep):
            values += [value for _, value in step.values]
        if isinstance(step, SetStep):
            values += [value for _, value in step.points]
        yield from (value.name for value in values if isinstance(value, Reference))
