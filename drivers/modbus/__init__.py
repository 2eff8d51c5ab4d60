"""Controller-side drivers for the same devices on Modbus TCP and RTU.

    >>> with ModbusClient(TcpLink("127.0.0.1", 5020)) as client:
    ...     sensor = PressureSensor(client, unit_id=2)
    ...     sensor.setup()
    ...     sensor.poll()
    ...     sensor.pressure

The classes are used as those of `drivers`, which are on CANopen: see `drivers.interfaces`. They
know the devices by their register maps only, use SI units, and run in the caller's thread.
"""

from drivers.modbus.client import ModbusClient
from drivers.modbus.links import SerialLink, TcpLink, TlsLink
from drivers.modbus.position import PositionSensor
from drivers.modbus.pressure import PressureSensor
from drivers.modbus.register_map import RegisterMap
from drivers.modbus.valve import ProportionalValve

__all__ = [
    "ModbusClient",
    "PositionSensor",
    "PressureSensor",
    "ProportionalValve",
    "RegisterMap",
    "SerialLink",
    "TcpLink",
    "TlsLink",
]
