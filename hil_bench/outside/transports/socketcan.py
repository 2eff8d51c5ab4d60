"""Linux SocketCAN, read and written without a `can.Message` in between.

python-can opens and configures the socket; from then on this transport alone reads and writes it.
The kernel filters by identifier, so that traffic for others never wakes Python, and its drop
counter is read with every frame, so that a loss is seen. Source: Documentation/networking/can.rst
of the Linux kernel, and `linux/can.h`, `linux/can/raw.h`.
"""

import errno
import json
import logging
import os
import shutil
import socket
import struct
import subprocess
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, Protocol

from hil_bench.canopen_device.frame import BRS, ESI, FDF, Frame, make_frame
from hil_bench.errors import BusError
from hil_bench.frame import CLASSICAL_DATA, FD_LENGTHS, FRAME_BITS, bits_of
from hil_bench.outside.transports.transport import TransportCounters, has_exact_wait, is_readable

# The SocketCAN interfaces of this machine, as the kernel tells of them.


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


logger = logging.getLogger(__name__)

RECEIVE_BUFFER = 8 * 1024 * 1024
"""Receive buffer that is asked of the kernel [byte]; its default loses frames of a burst."""

RETRY_LIMIT = 256
"""Frames that wait for room in the transmit queue, before the oldest are given up."""

# struct can_frame: identifier with flags, length, three bytes of padding, payload.
_CAN_FRAME = struct.Struct("=IB3x8s")
# struct canfd_frame: likewise, with flags in the first byte of padding.
_CANFD_FRAME = struct.Struct("=IBB2x64s")

_EFF_FLAG = 0x8000_0000
_RTR_FLAG = 0x4000_0000
_ERR_FLAG = 0x2000_0000
_SFF_MASK = 0x7FF
_EFF_MASK = 0x1FFF_FFFF

_SOL_CAN_RAW = 101
_CAN_RAW_FILTER = 1
_CAN_RAW_FILTER_MAX = 512
_CAN_FILTER = struct.Struct("=II")
_ALL_FRAMES = _CAN_FILTER.pack(0, 0)

# asm-generic/socket.h; Python's socket module has no names for them.
_SO_RCVBUFFORCE = 33
_SO_TIMESTAMPNS = 35
_SO_RXQ_OVFL = 40
_DROP_COUNTER = struct.Struct("=I")
_ANCILLARY_SIZE = 64

# While the interface is down, who asks often is not to ask the kernel each time.
_CALLS_PER_LOOK = 20
_LONG_WAIT = 0.02  # [s]

_TRY_LATER = frozenset({errno.EAGAIN, errno.EWOULDBLOCK, errno.ENOBUFS})


class RawCanBus(Protocol):
    """The part of python-can's `SocketcanBus` that the bench uses."""

    socket: socket.socket

    def shutdown(self) -> None:
        """Close the socket."""


def pack_frame(frame: Frame) -> bytes:
    """Return the frame as `struct can_frame`, one of CAN FD as `struct canfd_frame`."""
    can_id = frame.can_id
    if frame.is_extended:
        can_id |= _EFF_FLAG
    if frame.is_remote:
        can_id |= _RTR_FLAG
    if frame.fd:
        return _CANFD_FRAME.pack(can_id, len(frame.data), frame.fd, frame.data)
    return _CAN_FRAME.pack(can_id, len(frame.data), frame.data)


def unpack_frame(raw: bytes) -> Frame | None:
    """Return the frame in a `struct can_frame` or `canfd_frame`, or None for error frames."""
    fd = 0
    if len(raw) == _CAN_FRAME.size:
        can_id, length, data = _CAN_FRAME.unpack(raw)
        if length > CLASSICAL_DATA:
            return None
    elif len(raw) == _CANFD_FRAME.size:
        can_id, length, flags, data = _CANFD_FRAME.unpack(raw)
        fd = FDF | flags & (BRS | ESI)
        if length not in FD_LENGTHS or can_id & _RTR_FLAG:
            return None
    else:
        return None
    if can_id & _ERR_FLAG:
        return None
    is_extended = can_id & _EFF_FLAG != 0
    is_remote = can_id & _RTR_FLAG != 0
    masked = can_id & (_EFF_MASK if is_extended else _SFF_MASK)
    return make_frame(
        Frame, (masked, b"" if is_remote else data[:length], is_remote, is_extended, 0, fd)
    )


def pack_filters(can_ids: Iterable[int]) -> bytes:
    """Return the filters that let exactly these 11-bit identifiers through.

    More of them than the kernel takes (512) become one filter that lets everything through.
    """
    wanted = sorted(set(can_ids))
    if len(wanted) > _CAN_RAW_FILTER_MAX:
        return _ALL_FRAMES
    return b"".join(_CAN_FILTER.pack(can_id, _SFF_MASK | _EFF_FLAG) for can_id in wanted)


class SocketCanTransport:
    """A transport over the raw CAN socket of one interface.

    Args:
        bus: the bus as python-can opened it; the transport shuts it down when it is closed.
        channel: name of the interface, for messages.
        speedup: how many times faster the data phase of CAN FD is than the rest.

    Attributes:
        description: the bus in words.
        channel: as passed in.
        receive_buffer: what the kernel granted [byte]; it counts its own overhead in.

    Raises:
        BusError: the interface is down.
    """

    def __init__(self, bus: RawCanBus, channel: str, speedup: float = 1.0) -> None:
        self.description = f"socketcan {channel}"
        self.channel = channel
        self._speedup = speedup
        self._bus = bus
        self._socket = bus.socket
        self._pending: deque[tuple[bytes, float]] = deque()
        self._counters = TransportCounters()
        self._drop_counter = 0
        self._looks = 0
        self._socket.setblocking(False)
        self.receive_buffer = _enlarge_receive_buffer(self._socket)
        if self.receive_buffer < RECEIVE_BUFFER:
            logger.warning(
                "%s: receive buffer of %d KiB, a flood may lose frames; "
                "'sysctl -w net.core.rmem_max=%d' allows %d KiB",
                self.description,
                self.receive_buffer // 1024,
                RECEIVE_BUFFER,
                RECEIVE_BUFFER // 1024,
            )
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 0)
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
        # Binding to an interface that is down succeeds and leaves the error behind.
        pending_error = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if pending_error:
            raise BusError(f"{self.description}: {_reason(pending_error, channel)}")

    @property
    def has_exact_wait(self) -> bool:
        """Return True if the socket is one that `select` takes."""
        return has_exact_wait(self._socket)

    def fileno(self) -> int:
        """Return the socket's descriptor, for `select`."""
        return self._socket.fileno()

    def receive(self, limit: int) -> list[Frame]:
        """Return the frames that have arrived, reading at most `limit`, without waiting.

        While the interface is down, nothing arrives.
        """
        frames: list[Frame] = []
        if self._counters.is_down:
            self._looks += 1
            if self._looks % _CALLS_PER_LOOK == 0:
                self._look()
        try:
            for _ in range(limit):
                raw, ancillary, _, _ = self._socket.recvmsg(_CANFD_FRAME.size, _ANCILLARY_SIZE)
                if ancillary:
                    self._count_drops(ancillary)
                frame = unpack_frame(raw)
                if frame is None:
                    self._counters.ignored += 1
                else:
                    frames.append(frame)
                    self._counters.bits += self._bits(frame)
        except BlockingIOError:
            pass
        except OSError as error:
            self._give_up(error)
        self._counters.received += len(frames)
        return frames

    def _bits(self, frame: Frame) -> float:
        """Return the bits of a frame on the bus, of most from the table."""
        if frame.fd or frame.is_extended:
            return bits_of(frame, self._speedup)
        return FRAME_BITS[len(frame.data)]

    def wait(self, timeout: float) -> bool:
        """Wait until a frame has arrived, at most `timeout` [s]; return whether one has.

        An error of the interface ends the wait too; `receive` raises it.
        """
        has_come = is_readable(self._socket, timeout)
        if self._counters.is_down and not has_come and timeout >= _LONG_WAIT:
            self._look()
        return has_come

    def send(self, frames: Sequence[Frame]) -> None:
        """Send frames in order, those that are still waiting first.

        Where the transmit queue is full, frames wait for the next call; beyond `RETRY_LIMIT` the
        oldest are given up and counted, since what they say is out of date. While the interface is
        down, all are.
        """
        pending = self._pending
        pending.extend((pack_frame(frame), self._bits(frame)) for frame in frames)
        try:
            while pending:
                self._socket.send(pending[0][0])
                self._counters.bits += pending.popleft()[1]
                self._counters.sent += 1
        except OSError as error:
            if error.errno not in _TRY_LATER:
                self._give_up(error)
        limit = 0 if self._counters.is_down else RETRY_LIMIT
        while len(pending) > limit:
            pending.popleft()
            self._counters.send_failures += 1

    def listen_to(self, can_ids: Iterable[int]) -> None:
        """Let the kernel pass only these 11-bit identifiers, and error frames.

        Raises:
            BusError: the bus is lost.
        """
        try:
            self._socket.setsockopt(_SOL_CAN_RAW, _CAN_RAW_FILTER, pack_filters(can_ids))
        except OSError as error:
            raise BusError(self._lost(error)) from error

    def counters(self) -> TransportCounters:
        """Return the counters so far."""
        return replace(self._counters)

    def close(self) -> None:
        """Close the socket; a second call does nothing."""
        self._bus.shutdown()

    def _count_drops(self, ancillary: list[tuple[int, int, bytes]]) -> None:
        """Add what has been lost since the last frame, by the socket's 32-bit drop counter."""
        for level, kind, data in ancillary:
            if level == socket.SOL_SOCKET and kind == _SO_RXQ_OVFL:
                (counter,) = _DROP_COUNTER.unpack(data)
                self._counters.dropped += (counter - self._drop_counter) % 2**32
                self._drop_counter = counter

    def _give_up(self, error: OSError) -> None:
        """Go on without an interface that is down, for it may come back.

        Raises:
            BusError: the bus is lost for another reason.
        """
        if error.errno != errno.ENETDOWN:
            raise BusError(self._lost(error)) from error
        if not self._counters.is_down:
            self._counters.is_down = True
            self._counters.outages += 1
            reason = _reason(error.errno, self.channel)
            logger.warning("%s: %s; the bench goes on without it", self.description, reason)

    def _look(self) -> None:
        """Find out whether the interface is up again; its socket then works on."""
        if is_up(self.channel):
            self._counters.is_down = False
            logger.warning("%s: the interface is up again", self.description)

    def _lost(self, error: OSError) -> str:
        return f"{self.description}: bus lost: {_reason(error.errno, self.channel)}"


def _reason(code: int | None, channel: str) -> str:
    """Return the meaning of an errno for the interface, with a remedy where one is known."""
    if code == errno.ENETDOWN:
        return f"the interface is down; 'ip link set {channel} up' starts it"
    if code in {errno.ENODEV, errno.ENXIO}:
        return "the interface is gone"
    return os.strerror(code or 0)


def _enlarge_receive_buffer(raw_socket: socket.socket) -> int:
    """Ask for `RECEIVE_BUFFER` and return what was granted [byte].

    Only CAP_NET_ADMIN gets past net.core.rmem_max.
    """
    try:
        raw_socket.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, RECEIVE_BUFFER)
    except OSError:
        raw_socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
    return raw_socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
