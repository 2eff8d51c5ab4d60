"""Controller-side drivers for the same devices on Modbus TCP and RTU.

    >>> with ModbusClient(TcpLink("127.0.0.1", 5020)) as client:
    ...     sensor = PressureSensor(client, unit_id=2)
    ...     sensor.setup()
    ...     sensor.poll()
    ...     sensor.pressure

The classes are used as those of `hil_drivers`, which are on CANopen: see `hil_drivers.interfaces`.
They know the devices by their register maps only, use SI units, and run in the caller's thread.
"""

from hil_drivers.modbus.client import ModbusClient
from hil_drivers.modbus.links import SerialLink, TcpLink, TlsLink
from hil_drivers.modbus.position import PositionSensor
from hil_drivers.modbus.pressure import PressureSensor
from hil_drivers.modbus.register_map import RegisterMap
from hil_drivers.modbus.rotary import RotarySensor
from hil_drivers.modbus.valve import ProportionalValve

__all__ = [
    "ModbusClient",
    "PositionSensor",
    "PressureSensor",
    "ProportionalValve",
    "RegisterMap",
    "RotarySensor",
    "SerialLink",
    "TcpLink",
    "TlsLink",
]
