"""The meaning of a frame with a 29-bit identifier in SAE J1939 or ISO 11783.

Nothing in a frame says that it is J1939; this is how such a frame would be read. Names of the
parameter groups as public tools have them (SAE J1939 DA and ISO 11783-7 were not at hand).
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

from hil_bench.abilities.j1939.protocol import signals
from hil_bench.abilities.j1939.protocol.auxiliary_valve import (
    COMMAND,
    ESTIMATED_FLOW,
    FLOW,
    FLOW_COMMAND,
    ExitReason,
)

_VALVE_STATES: Final = {0: "block", 1: "extend", 2: "retract", 3: "float", 14: "error"}
_EXIT_REASONS: Final = {
    int(reason): reason.name.lower().replace("timeout", "time-out") for reason in ExitReason
}
_DIAGNOSES: Final = (signals.DM1, signals.DM2)
_LAMPS: Final = ((6, "malfunction"), (4, "stop"), (2, "warning"), (0, "protect"))

_GROUPS: Final[Mapping[int, str]] = MappingProxyType(
    {
        0x0000: "TSC1, torque/speed control",
        signals.ACKNOWLEDGEMENT: "acknowledgement",
        signals.REQUEST: "request",
        0xEB00: "TP.DT, transport data",
        signals.TRANSPORT_CONNECTION: "TP.CM, transport connection",
        signals.ADDRESS_CLAIMED: "address claimed",
        0xEF00: "proprietary A",
        0x1EF00: "proprietary A2",
        0xF001: "EBC1, brakes",
        0xF002: "ETC1, transmission",
        0xF003: "EEC2, accelerator pedal",
        0xF004: "EEC1, engine speed",
        0xF005: "ETC2, transmission gear",
        0xFDD6: "BJM1, basic joystick",
        0xFDD7: "EJM1, extended joystick",
        0xFDD8: "BJM2, basic joystick",
        0xFDD9: "EJM2, extended joystick",
        signals.DM1: "DM1, active trouble codes",
        signals.DM2: "DM2, previous trouble codes",
        0xFECC: "DM3, clear previous trouble codes",
        0xFED8: "commanded address",
        signals.SOFTWARE: "software identification",
        0xFEE5: "engine hours",
        signals.COMPONENT: "component identification",
        signals.VEHICLE: "vehicle identification",
        0xFEEE: "ET1, engine temperature",
        0xFEEF: "EFL/P1, fluid level and pressure",
        0xFEF1: "CCVS, cruise control and vehicle speed",
        0xFEF2: "LFE, fuel economy",
        0xFEF5: "AMB, ambient conditions",
        0xFEF6: "IC1, intake and exhaust",
        0xFEF7: "VEP1, electrical power",
        0xFEFC: "DD, dash display",
    }
)
_RANGES: Final = (
    (range(0xFE10, 0xFE20), "auxiliary valve {} estimated flow"),
    (range(0xFE20, 0xFE30), "auxiliary valve {} measured flow"),
    (range(0xFE30, 0xFE40), "auxiliary valve {} command"),
    (range(0xFF00, 0x10000), "proprietary B"),
    (range(0x1F000, 0x20000), "NMEA 2000"),
)
_TRANSPORTS: Final[Mapping[int, str]] = MappingProxyType(
    {
        16: "RTS, {size} bytes in {packets} packets, {group}",
        17: "CTS, {first} packets from {second}, {group}",
        19: "end of message, {size} bytes, {group}",
        32: "BAM, {size} bytes in {packets} packets, {group}",
        255: "abort, reason {first}, {group}",
    }
)
"""What a TP.CM says, by its control byte."""


def group_name(group: int) -> str:
    """Return a parameter group in words; empty for one that is not known here."""
    for numbers, text in _RANGES:
        if group in numbers:
            return text.format(group - numbers.start)
    return _GROUPS.get(group, "")


def describe(can_id: int, data: bytes) -> str:
    """Describe a frame as J1939 reads it."""
    _, group, source, destination = signals.split(can_id)
    name = group_name(group)
    words = f"PGN {group}" + (f" {name}" if name else "")
    way = f"from {_address(source)}" + (
        "" if destination == signals.GLOBAL else f" to {_address(destination)}"
    )
    content = content_of(group, data)
    return f"{words}, {way}" + (f": {content}" if content else "")


def content_of(group: int, data: bytes) -> str:
    """Return the content of a message in words; empty where the group is not supported."""
    return _CONTENTS[group](data) if group in _CONTENTS else ""


def trouble_codes(data: bytes) -> list[tuple[int, int]]:
    """Return SPN and FMI of each code of a DM1 or DM2, by the conversion method of version 4."""
    records = [data[at : at + 4] for at in range(2, len(data) - 3, 4)]
    return [
        (each[0] | each[1] << 8 | each[2] >> 5 << 16, each[2] & 0x1F)
        for each in records
        if any(each[:3])
    ]


def lamps_of(data: bytes) -> list[str]:
    """Return the lamps that a DM1 or DM2 has on."""
    return [lamp for shift, lamp in _LAMPS if data and data[0] >> shift & 3 == 1]


def _address(address: int) -> str:
    return "none" if address == signals.NULL else str(address)


def _group_of(data: bytes) -> str:
    group = int.from_bytes(data[:3], "little")
    name = group_name(group)
    return f"PGN {group}" + (f" {name}" if name else "")


def _request(data: bytes) -> str:
    return _group_of(data) if len(data) >= 3 else ""


def _acknowledge(data: bytes) -> str:
    if len(data) < 8 or data[0] > 3:
        return ""
    what = ("done", "refused", "access denied", "cannot respond")[data[0]]
    return f"{what}, {_group_of(data[5:])}"


def _claim(data: bytes) -> str:
    """Return the NAME: what the device is, of whom, which one."""
    if len(data) != 8:
        return ""
    name = int.from_bytes(data, "little")
    return (
        f"manufacturer {name >> 21 & 0x7FF}, function {name >> 40 & 0xFF}, "
        f"identity {name & 0x1FFFFF}"
    )


def _transport(data: bytes) -> str:
    if len(data) != 8:
        return ""
    template = _TRANSPORTS.get(data[0], "")
    return template.format(
        size=data[1] | data[2] << 8,
        packets=data[3],
        first=data[1],
        second=data[2],
        group=_group_of(data[5:]),
    )


def _diagnosis(data: bytes) -> str:
    """Return the lamps and the trouble codes."""
    if len(data) < 6:
        return ""
    lamps = lamps_of(data)
    lit = f"lamp {' and '.join(lamps)}" if lamps else "no lamp"
    codes = [f"SPN {spn} FMI {fmi}" for spn, fmi in trouble_codes(data)]
    return ", ".join([lit, *codes]) if codes else f"{lit}, no trouble code"


def _text(data: bytes) -> str:
    return ascii(data.decode("latin-1"))


def _software(data: bytes) -> str:
    """Return the fields of a software identification, behind their number."""
    return _text(data[1:])


def _valve_command(data: bytes) -> str:
    if len(data) < 3:
        return ""
    state = _VALVE_STATES.get(data[2] & 0xF, "reserved")
    return f"{state} {FLOW_COMMAND.value(data):.4g} %"


def _valve_flow(data: bytes) -> str:
    if len(data) < 5:
        return ""
    reason = data[4] & 0x3F
    why = f", obeys no command: {_EXIT_REASONS.get(reason, f'reason {reason}')}" if reason else ""
    state = _VALVE_STATES.get(data[2] & 0xF, "reserved")
    return f"{state}, flow {FLOW.value(data):.4g} %{why}"


_CONTENTS: Final[Mapping[int, Callable[[bytes], str]]] = MappingProxyType(
    {
        signals.REQUEST: _request,
        signals.ACKNOWLEDGEMENT: _acknowledge,
        signals.ADDRESS_CLAIMED: _claim,
        signals.TRANSPORT_CONNECTION: _transport,
        signals.COMPONENT: _text,
        signals.VEHICLE: _text,
        signals.SOFTWARE: _software,
        **dict.fromkeys(_DIAGNOSES, _diagnosis),
        **dict.fromkeys(range(COMMAND, COMMAND + 16), _valve_command),
        **dict.fromkeys(range(ESTIMATED_FLOW, ESTIMATED_FLOW + 16), _valve_flow),
    }
)
