"""The hand of a scenario on its bench: what its steps do, as frames and as commands.

What an RPDO carries goes as that RPDO, by the COB-ID and the mapping that the node has at the time:
as a controller sends it. Other objects are written as an SDO server writes them, with the device's
limits and checks, but without frames, which the controller's own SDO client would take for answers.
A Modbus register is written as a request of a client writes it, without a client.
"""

import math
from collections.abc import Iterator, Mapping

from hil_bench.abilities.scenario.records import NmtStep, NmtVerb
from hil_bench.abilities.scenario.registers import RegisterTarget, WriteRegister
from hil_bench.abilities.scenario.targets import (
    ALL,
    ObjectTarget,
    PlantTarget,
    SignalTarget,
    Target,
    ValveTarget,
)
from hil_bench.bench.assembly import number_buses
from hil_bench.bench.configuration import BenchConfig
from hil_bench.canopen_device.cob_id import DISABLED, can_id
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import NMT_COB_ID, NmtCommand, NmtState
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.pdo_mapping import Direction, MappingEntry, PdoMapping
from hil_bench.canopen_device.pdo_parameters import COMMUNICATION_INDICES
from hil_bench.devices.j1939.auxiliary_valve import COMMAND, PRIORITY, pack_command
from hil_bench.devices.j1939.identifier import join
from hil_bench.kinds.auxiliary_valve import SET_POINT
from hil_bench.session.commands import SetObject, SetPlant
from hil_bench.session.session import Session

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
        """Return the value that a target has; of a plant, 0, for it does not tell."""
        if isinstance(target, PlantTarget):
            return 0.0
        if isinstance(target, RegisterTarget):
            held = target.read()
            return 0.0 if math.isnan(held) else held
        if isinstance(target, SignalTarget):
            shown = target.handle[target.name]
            return 0.0 if math.isnan(shown) else shown * target.factor
        if isinstance(target, ValveTarget):
            return target.handle[SET_POINT]
        return float(target.variable.value or 0) / target.scale

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
