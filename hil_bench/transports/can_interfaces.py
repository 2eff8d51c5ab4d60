"""The SocketCAN interfaces of this machine, as the kernel tells of them."""

import json
import shutil
import socket
import subprocess
from pathlib import Path
from typing import Any, NamedTuple

_SYSFS = Path("/sys/class/net")
_ARPHRD_CAN = "280"  # linux/if_arp.h
_IFF_UP = 1
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
    """Return whether this Python and this kernel have SocketCAN."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except (AttributeError, OSError):
        return False
    return True


def can_interfaces(sysfs: Path = _SYSFS) -> list[CanInterface]:
    """Return the CAN interfaces, by name; none where there is no SocketCAN.

    Args:
        sysfs: where the kernel lists its network interfaces.
    """
    return [
        _describe(path) for path in sorted(sysfs.glob("*")) if _read(path / "type") == _ARPHRD_CAN
    ]


def bitrate_of(name: str) -> int | None:
    """Return the bit rate of an interface [bit/s], None where it has none."""
    return _bitrate(_link_details(name))


def _bitrate(details: dict[str, Any]) -> int | None:
    bitrate: int | None = details.get("info_data", {}).get("bittiming", {}).get("bitrate")
    return bitrate


def _describe(path: Path) -> CanInterface:
    details = _link_details(path.name)
    return CanInterface(
        path.name,
        is_up=bool(int(_read(path / "flags") or "0", 16) & _IFF_UP),
        kind=details.get("info_kind", ""),
        bitrate=_bitrate(details),
    )


def _read(path: Path) -> str:
    try:
        return path.read_text("ascii").strip()
    except (OSError, UnicodeDecodeError):
        return ""


def _link_details(name: str) -> dict[str, Any]:
    """Return what iproute2 says of the kind of a link; empty where it says nothing."""
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
