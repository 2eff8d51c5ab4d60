"""Controller-side drivers for devices on SAE J1939 and ISO 11783, beside CANopen ones on one bus.

    >>> with can.Bus(interface="socketcan", channel="can0") as bus, Network(bus) as network:
    ...     port = J1939Port(network, Name(identity=1), address=39)
    ...     port.claim()
    ...     with AuxiliaryValve(port, address=128) as valve:
    ...         valve.setup()
    ...         valve.spool_setpoint = 0.3
    ...         network.pump(1.0)
    ...         print(valve.flow, valve.trouble_codes)

They receive and repeat while the caller waits in the network, in one thread.
"""

from hil_drivers.j1939.address_claim import ClaimState
from hil_drivers.j1939.device import J1939Device, TroubleCode
from hil_drivers.j1939.identifier import GLOBAL
from hil_drivers.j1939.name import Name
from hil_drivers.j1939.port import J1939Port
from hil_drivers.j1939.valve import AuxiliaryValve, ExitReason, FlowState

__all__ = [
    "GLOBAL",
    "AuxiliaryValve",
    "ClaimState",
    "ExitReason",
    "FlowState",
    "J1939Device",
    "J1939Port",
    "Name",
    "TroubleCode",
]
