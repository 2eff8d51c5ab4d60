"""The SocketCAN interfaces of this machine, as the kernel tells of them."""

import json
import shutil
import socket
import struct
import subprocess
from typing import Any, NamedTuple

# linux/sockios.h, linux/if_arp.h, linux/if.h
_SIOCGIFFLAGS = 0x8913
_SIOCGIFHWADDR = 0x8927
_SIOCGIFMTU = 0x8921
_ARPHRD_CAN = 280
_IFF_UP = 1
_IFREQ = struct.Struct("16sH22x")  # name, then flags or the type of the address
_IFREQ_MTU = struct.Struct("16si20x")
_CANFD_MTU = 72
_ANSWER_TIMEOUT = 5.0


class CanInterface(NamedTuple):
    """One interface.

    Attributes:
        name: as in ``can0``.
        is_up: whether it is switched on.
        kind: ``can`` for hardware, ``vcan``, ``slcan``, ...; empty where `ip` is not there to ask.
        bitrate: [bit/s], None where it has none or `ip` is not there to ask.
    """

    name: str
    is_up: bool
    kind: str = ""
    bitrate: int | None = None


def has_socketcan() -> bool:
    """Return True if this Python and this kernel have SocketCAN."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except (AttributeError, OSError):
        return False
    return True


def can_interfaces() -> list[CanInterface]:
    """Return the CAN interfaces, by name; none where there is no SocketCAN."""
    names = sorted(name for _, name in socket.if_nameindex())
    return [_describe(name) for name in names if _ask(name, _SIOCGIFHWADDR) == _ARPHRD_CAN]


def is_up(name: str) -> bool:
    """Return True if an interface is there and switched on."""
    return bool(_ask(name, _SIOCGIFFLAGS) & _IFF_UP)


def has_fd(name: str) -> bool | None:
    """Return True if an interface carries CAN FD, None where there is no such interface."""
    mtu = _ask(name, _SIOCGIFMTU, _IFREQ_MTU)
    return mtu >= _CANFD_MTU if mtu else None


def bitrate_of(name: str) -> int | None:
    """Return the bit rate of an interface [bit/s], None where it has none."""
    return _bitrate(_link_details(name))


def _bitrate(details: dict[str, Any]) -> int | None:
    bitrate: int | None = details.get("info_data", {}).get("bittiming", {}).get("bitrate")
    return bitrate


def _describe(name: str) -> CanInterface:
    details = _link_details(name)
    kind, bitrate = details.get("info_kind", ""), _bitrate(details)
    return CanInterface(name, is_up=is_up(name), kind=kind, bitrate=bitrate)


def _ask(name: str, request: int, form: struct.Struct = _IFREQ) -> int:
    """Return a number that the kernel has of a network interface, 0 where it has none."""
    try:
        import fcntl  # noqa: PLC0415 - Windows has none

        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as any_socket:
            answer = fcntl.ioctl(any_socket, request, form.pack(name.encode()[:15], 0))
    except (ImportError, AttributeError, OSError):
        return 0
    number: int = form.unpack(answer)[1]
    return number


def _link_details(name: str) -> dict[str, Any]:
    """Return the details of a link from iproute2; empty where it gives no details."""
    program = shutil.which("ip")
    if program is None:
        return {}
    command = [program, "-json", "-details", "link", "show", "dev", name]
    try:
        answer = subprocess.run(  # noqa: S603 - a fixed command, a name that the kernel gave
            command, capture_output=True, check=True, timeout=_ANSWER_TIMEOUT
        )
        (link,) = json.loads(answer.stdout)
        details: dict[str, Any] = link["linkinfo"]
    except (OSError, subprocess.SubprocessError, ValueError, KeyError, TypeError):
        return {}
    return details
