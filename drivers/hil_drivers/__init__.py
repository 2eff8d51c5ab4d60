"""Controller-side drivers for the valve, the pressure sensors and the position sensor.

    >>> with can.Bus(interface="socketcan", channel="vcan0") as bus, Network(bus) as network:
    ...     with ProportionalValve(network, node_id=1) as valve:
    ...         valve.setup()
    ...         network.start_node(1)
    ...         valve.enable()
    ...         valve.spool_setpoint = 0.3

They know the devices by their EDS files only, talk to them through the `canopen` library over any
python-can bus, use SI units, and run in the caller's thread. `hil_drivers.modbus` has the same
devices on Modbus, `hil_drivers.j1939` those of SAE J1939.
"""

from hil_drivers.errors import (
    AddressClaimError,
    BusLostError,
    ConciseDcfError,
    DeviceFaultError,
    DeviceMismatchError,
    DriverError,
    DriverTimeoutError,
    EdsError,
    ModbusExceptionError,
    ProgramError,
    RegisterMapError,
    RemoteProtocolError,
    RequestRefusedError,
    SdoAbortError,
    StaleValueError,
    TransferAbortedError,
)
from hil_drivers.interfaces import Reading
from hil_drivers.motion_profile import MotionProfile
from hil_drivers.network import Network
from hil_drivers.node import NmtState, Node
from hil_drivers.position import PositionSensor
from hil_drivers.position_control import (
    ControllerParameters,
    CycleRecord,
    PositionController,
    PositionLoop,
)
from hil_drivers.pressure import PressureSensor, TemperatureSensor
from hil_drivers.rotary import RotarySensor
from hil_drivers.valve import ControlMode, ProportionalValve
from hil_drivers.valve_state import ValveState

__all__ = [
    "AddressClaimError",
    "BusLostError",
    "ConciseDcfError",
    "ControlMode",
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
    "ProgramError",
    "ProportionalValve",
    "Reading",
    "RegisterMapError",
    "RemoteProtocolError",
    "RequestRefusedError",
    "RotarySensor",
    "SdoAbortError",
    "StaleValueError",
    "TemperatureSensor",
    "TransferAbortedError",
    "ValveState",
]
