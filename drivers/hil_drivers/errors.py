"""Errors of the controller side, one tree.

Each error is also the builtin that it is, where there is one, so that a caller may catch either::

    DriverError
     ├── DriverTimeoutError (TimeoutError)   no answer, or a state not reached, in time
     ├── BusLostError (OSError)              the bus can no longer send or receive
     ├── EdsError (ValueError)               an EDS file cannot be read
     ├── ConciseDcfError (ValueError)        a concise DCF cannot be read or made
     ├── DeviceMismatchError (ValueError)    EDS and device differ, or the EDS lacks an object
     ├── RegisterMapError (ValueError)       a register map cannot be read
     ├── SdoAbortError                       the device refused an access, and said why
     ├── ModbusExceptionError                the same on Modbus
     ├── RequestRefusedError                 the same on J1939
     ├── TransferAbortedError                a long J1939 message was ended before its end
     ├── AddressClaimError                   we have no address on J1939, or lost it
     ├── ProgramError                        a device says that a program is wrong
     ├── RemoteProtocolError                 the device broke the protocol
     ├── DeviceFaultError                    the valve is in a fault state, or left ACTIVE
     └── StaleValueError                     no value was received recently enough

Whatever sends or receives may raise `BusLostError`. What reads or writes an object of a device,
so every `setup` and every change of state, may raise `DriverTimeoutError`, `SdoAbortError`,
`RemoteProtocolError` and `DeviceMismatchError` too. Values of a device raise `StaleValueError`
when they are too old.

An argument that makes no sense is a plain `ValueError`.
"""


class DriverError(Exception):
    """Base of every error that a driver raises on purpose.

    Args:
        what: is wrong.
        device: whose message it is, which then begins with its name.

    Attributes:
        what: as passed in.
    """

    def __init__(self, what: str, *, device: object = "") -> None:
        super().__init__(f"{device}: {what}" if device else what)
        self.what = what

    def __str__(self) -> str:
        return "".join(
            char if char.isprintable() or char == "\n" else ascii(char)[1:-1]
            for char in super().__str__()
        )


class DriverTimeoutError(DriverError, TimeoutError):
    """A device did not answer, or did not reach a state, within the given time."""


class BusLostError(DriverError, OSError):
    """The CAN bus, or the link to a Modbus device, refused to send or to receive."""


class EdsError(DriverError, ValueError):
    """An EDS file is missing or malformed."""


class ConciseDcfError(DriverError, ValueError):
    """A concise DCF, or the DCF that it is to be made from, is missing or malformed."""


class DeviceMismatchError(DriverError, ValueError):
    """Device and EDS differ, or the EDS lacks an object that the driver needs."""


class SdoAbortError(DriverError):
    """The device refused an access to an object.

    Attributes:
        code: abort code, 32 bit (CiA 301, SDO abort codes).
        reason: the code and what it means, in words.
    """

    def __init__(self, what: str, code: int, meaning: str, *, device: object = "") -> None:
        self.code = code
        self.reason = f"SDO abort 0x{code:08X}, {meaning}"
        super().__init__(f"{what}: {self.reason}", device=device)


class ProgramError(DriverError):
    """A device refused a program, and said why in its flash status (0x1F57)."""


class RegisterMapError(DriverError, ValueError):
    """A register map is missing or malformed."""


class ModbusExceptionError(DriverError):
    """The device refused a request.

    Attributes:
        code: exception code (MODBUS Application Protocol V1.1b3, chapter 7).
    """

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


class RequestRefusedError(DriverError):
    """A J1939 device refused a request for a parameter group."""


class TransferAbortedError(DriverError):
    """A J1939 message of more than eight bytes was ended by the device, or for what it answered.

    Attributes:
        reason: of the abort (SAE J1939-21, connection abort reasons).
    """

    def __init__(self, what: str, reason: int) -> None:
        super().__init__(what)
        self.reason = int(reason)


class AddressClaimError(DriverError):
    """We have no source address on J1939: none was claimed, or another device has it."""


class RemoteProtocolError(DriverError):
    """The device sent what its protocol does not allow."""


class DeviceFaultError(DriverError):
    """The valve is in a fault state, or has left ACTIVE by itself.

    Attributes:
        code: code of the last emergency message, 0 where none was received.
    """

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


class StaleValueError(DriverError):
    """The last value is older than the driver's limit, or none was received at all."""
