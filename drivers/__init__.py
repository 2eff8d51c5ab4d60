"""Controller-side drivers for the valve, the pressure sensors and the position sensor.

    >>> with can.Bus(interface="socketcan", channel="vcan0") as bus, Network(bus) as network:
    ...     with ProportionalValve(network, node_id=1) as valve:
    ...         valve.setup()
    ...         network.start_node(1)
    ...         valve.enable()
    ...         valve.spool_setpoint = 0.3

They know the devices by their EDS files only, talk to them through the `canopen` library over any
python-can bus, use SI units, and run in the caller's thread. `drivers.modbus` has the same devices
on Modbus.
"""

from drivers.errors import (
    BusLostError,
    DeviceFaultError,
    DeviceMismatchError,
    DriverError,
    DriverTimeoutError,
    EdsError,
    ModbusExceptionError,
    RegisterMapError,
    RemoteProtocolError,
    SdoAbortError,
    StaleValueError,
)
from drivers.interfaces import Reading
from drivers.motion_profile import MotionProfile
from drivers.network import Network
from drivers.node import NmtState, Node
from drivers.position import PositionSensor
from drivers.position_control import (
    ControllerParameters,
    CycleRecord,
    PositionController,
    PositionLoop,
)
from drivers.pressure import PressureSensor
from drivers.valve import ProportionalValve
from drivers.valve_state import ValveState

__all__ = [
    "BusLostError",
    "ControllerParameters",
    "CycleRecord",
    "DeviceFaultError",
    "DeviceMismatchError",
    "DriverError",
    "DriverTimeoutError",
    "EdsError",
    "ModbusExceptionError",
    "MotionProfile",
    "Network",
    "NmtState",
    "Node",
    "PositionController",
    "PositionLoop",
    "PositionSensor",
    "PressureSensor",
    "ProportionalValve",
    "Reading",
    "RegisterMapError",
    "RemoteProtocolError",
    "SdoAbortError",
    "StaleValueError",
    "ValveState",
]
