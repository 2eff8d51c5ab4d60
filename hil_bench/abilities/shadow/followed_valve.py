"""A valve of a machine and the states of its nodes, followed on the bus."""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Final

import can

from hil_bench.canopen_device import nmt
from hil_bench.canopen_device.frame import DISABLED, Frame, can_id
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.pdo_parameters import COMMUNICATION_INDICES, SYNCHRONOUS, Direction
from hil_bench.devices.position_control import POSITION
from hil_bench.devices.pressure_control import PRESSURE, PRESSURE_AND_FLOW
from hil_bench.devices.valve_408 import LOCAL_BIT, SPOOL, ValveDevice
from hil_bench.devices.valve_state_machine import FAULT_STATES, STATUS_BITS, ValveState

# NMT states of a machine's nodes, as its frames show them, for the twin's nodes to take over.

GRACE = 0.02
"""How long a machine may take to do what it is commanded, and to say so [s]."""

_ERROR_CONTROL = range(0x701, 0x780)
_CHANGING = (range(0x580, 0x680), range(0x7E4, 0x7E6))
"""Frames that may change which TPDOs there are: SDO and LSS."""
_NMT_STATE_BITS = 0x7F
_COMMANDS = {state: command for command, state in nmt.ENTERED.items()}


class NodeStates:
    """Tells by which NMT commands the twin's nodes get to the states of the machine's.

    A machine that is OPERATIONAL already hears no command any more. A TPDO shows OPERATIONAL, a
    heartbeat or a node guarding answer shows the state, a boot-up message shows a device that has
    restarted by itself. After an NMT command the machine has `GRACE` to follow it.

    Args:
        nodes: those of the twin.

    Attributes:
        reported: states by node-ID, of nodes that have said theirs.
    """

    def __init__(self, nodes: Sequence[Node]) -> None:
        self.reported: dict[int, nmt.NmtState] = {}
        self._nodes = nodes
        self._commanded: dict[int, float] = {}
        self._resetting: set[int] = set()
        self._tpdos: dict[int, tuple[Node, bool]] | None = None

    def hear(self, message: can.Message, time: float) -> list[Frame]:
        """Take a frame and return the NMT commands that the twin needs before it.

        Args:
            message: the frame.
            time: when it was on the bus [s].
        """
        if message.is_extended_id or message.is_remote_frame:
            return []
        identifier = message.arbitration_id
        if identifier == nmt.NMT_COB_ID:
            self._hear_command(bytes(message.data), time)
        elif identifier in _ERROR_CONTROL and message.dlc == 1:
            return self._hear_state(identifier - _ERROR_CONTROL.start + 1, message.data[0], time)
        elif any(identifier in some for some in _CHANGING):
            self._tpdos = None
        elif identifier in self._known_tpdos():
            sender, _ = self._known_tpdos()[identifier]
            self.reported[sender.node_id] = nmt.NmtState.OPERATIONAL
            return self._follow(sender, nmt.NmtState.OPERATIONAL, time)
        return []

    def is_synchronous(self, identifier: int) -> bool:
        """Return True if a TPDO follows SYNC, by the configuration and the SDO transfers heard."""
        _, is_synchronous = self._known_tpdos().get(identifier, (None, False))
        return is_synchronous

    def _hear_command(self, data: bytes, time: float) -> None:
        request = nmt.NmtRequest.parse(data)
        if request is None:
            return
        self._tpdos = None
        for node in self._nodes:
            if request.addresses(node.node_id):
                self._commanded[node.node_id] = time
                if request.command in nmt.RESTORED:
                    self._resetting.add(node.node_id)

    def _hear_state(self, node_id: int, told: int, time: float) -> list[Frame]:
        node = next((node for node in self._nodes if node.node_id == node_id), None)
        try:
            state = nmt.NmtState(told & _NMT_STATE_BITS)
        except ValueError:
            return []
        if node is None:
            return []
        if state is not nmt.NmtState.INITIALISING:
            self.reported[node_id] = state
            return self._follow(node, state, time)
        self.reported[node_id] = nmt.NmtState.PRE_OPERATIONAL  # after its boot-up message
        self._tpdos = None
        if node_id in self._resetting:  # the twin has heard the same command
            self._resetting.discard(node_id)
            return []
        return self._command(node, nmt.NmtCommand.RESET_NODE, time)

    def _follow(self, node: Node, state: nmt.NmtState, time: float) -> list[Frame]:
        if node.state is state or time - self._commanded.get(node.node_id, -GRACE) < GRACE:
            return []
        return self._command(node, _COMMANDS[state], time)

    def _command(self, node: Node, command: nmt.NmtCommand, time: float) -> list[Frame]:
        self._commanded[node.node_id] = time
        return [Frame(nmt.NMT_COB_ID, bytes([command, node.node_id]))]

    def _known_tpdos(self) -> dict[int, tuple[Node, bool]]:
        """Return the twin's TPDOs by identifier: whose they are, and whether they follow SYNC."""
        if self._tpdos is None:
            self._tpdos = {
                identifier: (node, is_synchronous)
                for node in self._nodes
                for identifier, is_synchronous in _tpdos(node)
            }
        return self._tpdos


def _tpdos(node: Node) -> Iterator[tuple[int, bool]]:
    objects = node.object_dictionary
    for index in objects.indices(COMMUNICATION_INDICES[Direction.TPDO]):
        identifier = can_id(objects.number(index, 1, absent=DISABLED))
        if identifier is not None:
            yield identifier, objects.number(index, 2, absent=255) in SYNCHRONOUS


# The twin's valve: it obeys what it hears, and is corrected by what the machine's valve says.

_STATE_BITS = 0b1111
_STATES = {bits: state for state, bits in STATUS_BITS.items()}
"""By the status word's bits; 0 is NOT_READY too, which the valve leaves by itself."""
_NS = 1e-9

_SPOOL_SETPOINT, _PRESSURE_SETPOINT, _AXIS_SETPOINT = (0x6300, 1), (0x6380, 1), (0x6600, 1)
_SETPOINTS: Final[Mapping[int, tuple[tuple[int, int], ...]]] = MappingProxyType(
    {
        SPOOL: (_SPOOL_SETPOINT,),
        PRESSURE: (_PRESSURE_SETPOINT,),
        PRESSURE_AND_FLOW: (_SPOOL_SETPOINT, _PRESSURE_SETPOINT),
        POSITION: (_AXIS_SETPOINT,),
    }
)
"""What commands the valve, by its control mode."""
_AT_ITS_END: Final = 0.95


class FollowedValve:
    """The valve of a twin in place of its `ValveDevice`.

    The device takes control words and set-points from the bus and so acts when the machine's does.
    What the bus does not show is why the machine's may be in another state: a command from before
    we listened, an enable input, a fault. Then its status word counts, and the control word that
    stands is known not to lead out of that state.

    Args:
        device: the twin's valve.

    Attributes:
        full_opening: as of the device [m].
        reported: the state that the machine's valve says it is in; None before it has.
        is_local: whether the machine's valve says that its local command rules.
    """

    def __init__(self, device: ValveDevice) -> None:
        self.full_opening = device.full_opening
        self.reported: ValveState | None = None
        self.is_local = False
        self._heard: set[tuple[int, int]] = set()
        self._device = device
        self._state = device.state
        self._changed_at = -math.inf
        self._held: ValveState | None = None
        self._held_word = 0
        objects = device.node.object_dictionary
        self._word = objects.variable(0x6040)
        self._mode = objects.find(0x6043)
        for place in {place for places in _SETPOINTS.values() for place in places}:
            if (setpoint := objects.find(*place)) is not None:
                setpoint.add_hook(partial(self._hear_setpoint, place))

    @property
    def obstacle(self) -> str:
        """Why the bus does not show the set-point of an ACTIVE valve; empty where it does."""
        if self.is_local:
            return "not on the bus: the valve is under local control"
        mode = SPOOL if self._mode is None else self._mode.value
        lacking = [place for place in _SETPOINTS.get(mode, ()) if place not in self._heard]
        if not lacking:
            return ""
        which = "" if mode == SPOOL else f" in control mode {mode}"
        return f"not heard, and the valve is ACTIVE{which}"

    @property
    def state(self) -> ValveState:
        """State of the twin's valve."""
        return self._device.state

    def command(self, now: int) -> float:
        """Return the spool set-point [m] at `now` [ns]."""
        if self._held is not None:
            self._hold(self._held)
        setpoint = self._device.command(now)
        if self._device.state is not self._state:
            self._state = self._device.state
            self._changed_at = now * _NS
        return setpoint

    def publish(self, spool_position: float, now: int) -> None:
        """Take the spool position [m] at `now` [ns]."""
        self._device.publish(spool_position, now)

    def can_shift(self, spool: float) -> bool:
        """Return True if the machine's spool says where its axis' controller has come to.

        At its end it says nothing of an integral behind it.

        Args:
            spool: where it is, as fraction of full opening.
        """
        return abs(spool) < _AT_ITS_END or not self._device.position_control.has_integral

    def shift(self, spool: float, position: float) -> None:
        """Have a ramp and the axis' controller of the valve go on from elsewhere.

        Args:
            spool: by how much the spool is elsewhere, as fraction of full opening.
            position: by how much the axis is [m].
        """
        self._device.shift(spool, position)

    def hear(self, status_word: int, time: float) -> bool:
        """Take the machine's status word, and return whether the twin had to be corrected.

        Args:
            status_word: of the machine's valve.
            time: when the word was taken, at the earliest [s].
        """
        bits = status_word & _STATE_BITS
        self.is_local = bool(status_word & LOCAL_BIT)
        self.reported = _STATES.get(bits)
        if self.reported is None or bits == STATUS_BITS[self.state]:
            return False
        if time - self._changed_at < GRACE:
            return False
        self._held, self._held_word = self.reported, self._word.value
        self._adopt(self.reported)
        return True

    def _hold(self, held: ValveState) -> None:
        """Stay in a state until something new is heard that may lead out of it."""
        is_new = self._word.value != self._held_word
        has_failed = self.state in FAULT_STATES and held not in FAULT_STATES
        if is_new or has_failed or self._device.node.state is not nmt.NmtState.OPERATIONAL:
            self._held = None
        elif self.state is not held:
            self._adopt(held)

    def _adopt(self, state: ValveState) -> None:
        self._device.adopt(state)
        self._state = self._device.state

    def _hear_setpoint(self, place: tuple[int, int], _increments: int) -> None:
        self._heard.add(place)
