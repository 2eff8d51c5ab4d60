"""Opens a bus by python-can's names for it, and says in one line why it could not be opened."""

import errno
import logging
import select
import socket
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from operator import attrgetter
from typing import Any, cast

import can

from hil_bench.ability import given_to
from hil_bench.canopen_device.frame import Frame
from hil_bench.config.values import close_names
from hil_bench.errors import BusError, first_line
from hil_bench.frame import BUS_SHIFT, bits_of
from hil_bench.outside.bits import USUAL_BITRATE
from hil_bench.outside.messages import frame_of, message_of
from hil_bench.outside.transports.socketcan import RawCanBus, SocketCanTransport, has_fd
from hil_bench.outside.transports.transport import Transport, TransportCounters

# Several buses as one transport: each frame says by its number on which of them it is.


_CAN_ID_MASK = (1 << BUS_SHIFT) - 1
_LOOK = 1e-3
"""How long one bus is waited for while others may have something [s]."""


class JoinedTransport:
    """The buses of a bench that has more than one.

    Frames of one bus keep their order; between buses there is none.

    Args:
        transports: the buses, two or more, in the order of their numbers.

    Attributes:
        transports: as passed in.
        description: the buses in words.
        has_exact_wait: whether all of them can be waited on exactly, together.
    """

    def __init__(self, transports: Sequence[Transport]) -> None:
        self.transports = tuple(transports)
        self.description = ", ".join(transport.description for transport in transports)
        self._sockets = [t for t in transports if isinstance(t, SocketCanTransport)]
        self.has_exact_wait = len(self._sockets) == len(self.transports) and all(
            socket.has_exact_wait for socket in self._sockets
        )
        self._first = 0

    def receive(self, limit: int) -> list[Frame]:
        """Return at most `limit` frames that have arrived; each bus may take an equal share.

        What one bus leaves of its share is for those after it; another one begins each time.
        """
        frames: list[Frame] = []
        count = len(self.transports)
        for place in range(count):
            number = (self._first + place) % count
            share = -(-(limit - len(frames)) // (count - place))
            frames += [
                frame._replace(bus=number) for frame in self.transports[number].receive(share)
            ]
        self._first = (self._first + 1) % count
        return frames

    def wait(self, timeout: float) -> bool:
        """Wait until a frame has arrived on any bus, at most `timeout` [s]; return whether so."""
        if self.has_exact_wait:
            return bool(select.select(self._sockets, [], [], timeout)[0])
        end = time.monotonic() + timeout
        if any(transport.wait(0.0) for transport in self.transports):
            return True
        while (remaining := end - time.monotonic()) > 0.0:
            for transport in self.transports:
                if transport.wait(min(_LOOK, remaining)):
                    return True
        return False

    def send(self, frames: Sequence[Frame]) -> None:
        """Send each frame on its bus, in order; what a bus does not take, it keeps by itself."""
        for number, transport in enumerate(self.transports):
            transport.send([frame for frame in frames if frame.bus == number])

    def listen_to(self, can_ids: Iterable[int]) -> None:
        """Let frames with these identifiers through, each on its bus: see `frame.address_of`."""
        wanted: list[list[int]] = [[] for _ in self.transports]
        for address in can_ids:
            wanted[address >> BUS_SHIFT].append(address & _CAN_ID_MASK)
        for transport, identifiers in zip(self.transports, wanted, strict=True):
            transport.listen_to(identifiers)

    def counters(self) -> TransportCounters:
        """Return the counters of all buses together; one that is down counts as down."""
        parts = [transport.counters() for transport in self.transports]
        totals = {
            item.name: sum(map(attrgetter(item.name), parts)) for item in fields(TransportCounters)
        }
        return TransportCounters(**totals | {"is_down": any(part.is_down for part in parts)})

    def close(self) -> None:
        """Release all buses."""
        for transport in self.transports:
            transport.close()


# Any bus that python-can knows, through its `can.BusABC`.


logger = logging.getLogger(__name__)


class PythonCanTransport:
    """A transport over an open `can.BusABC`.

    Args:
        bus: the bus; the transport shuts it down when it is closed.
        description: the bus in words, for messages.
        has_exact_wait: whether this bus' `recv` keeps its time-out to some 10 us.
        speedup: how many times faster the data phase of CAN FD is; 0 for a classical bus.

    Attributes:
        description: the bus in words.
        has_exact_wait: as passed in.
    """

    def __init__(
        self,
        bus: can.BusABC,
        description: str,
        *,
        has_exact_wait: bool = False,
        speedup: float = 0.0,
    ) -> None:
        self.description = description
        self.has_exact_wait = has_exact_wait
        self._speedup = speedup
        self._has_warned = False
        self._bus = bus
        self._waiting: can.Message | None = None
        self._counters = TransportCounters()

    def receive(self, limit: int) -> list[Frame]:
        """Return the frames in at most `limit` messages that have arrived, without waiting."""
        frames: list[Frame] = []
        for _ in range(limit):
            message, self._waiting = self._waiting or self._read(0), None
            if message is None:
                break
            frame = frame_of(message)
            if frame is None or (frame.fd and not self._speedup):
                self._counters.ignored += 1
                self._warn(message)
            else:
                frames.append(frame)
                self._counters.bits += bits_of(frame, self._speedup or 1.0)
        self._counters.received += len(frames)
        return frames

    def _warn(self, message: can.Message) -> None:
        """Say once that frames of CAN FD are ignored."""
        if message.is_fd and not self._has_warned:
            self._has_warned = True
            logger.warning(
                "%s: frames of CAN FD arrive and are ignored; fd = true in bench.toml, or --fd, "
                "makes it a bus of CAN FD",
                self.description,
            )

    def wait(self, timeout: float) -> bool:
        """Wait until a message has arrived, at most `timeout` [s]; return whether one has."""
        self._waiting = self._waiting or self._read(timeout)
        return self._waiting is not None

    def _read(self, timeout: float) -> can.Message | None:
        """Return the next message, None where none comes in time [s].

        Not by `recv`, which looks at the system's clock between two messages: where that was set
        back by an hour, it would wait for an hour.

        Raises:
            BusError: the bus is lost.
        """
        try:
            message, is_filtered = self._bus._recv_internal(timeout)  # noqa: SLF001 - see above
            is_wanted = is_filtered or message is None or self._bus._matches_filters(message)  # noqa: SLF001
        except (can.CanError, OSError, ValueError) as error:
            raise BusError(f"{self.description}: bus lost: {first_line(error)}") from error
        return message if is_wanted else None

    def send(self, frames: Sequence[Frame]) -> None:
        """Send frames in order; one that python-can refuses is counted as failed.

        Raises:
            BusError: the bus is lost.
        """
        for frame in frames:
            try:
                self._bus.send(message_of(frame))
            except can.CanOperationError:
                self._counters.send_failures += 1
            except (can.CanError, OSError, ValueError) as error:
                raise BusError(f"{self.description}: bus lost: {first_line(error)}") from error
            else:
                self._counters.sent += 1
                self._counters.bits += bits_of(frame, self._speedup or 1.0)

    def listen_to(self, can_ids: Iterable[int]) -> None:
        """Leave the filters open: python-can filters most buses in Python, which saves nothing."""

    def counters(self) -> TransportCounters:
        """Return the counters so far; python-can does not report losses in the kernel."""
        return replace(self._counters)

    def close(self) -> None:
        """Shut the bus down; a second call does nothing."""
        self._bus.shutdown()


_HUB_HINT = "'hil-bench run --hub' makes a bus that needs none"
_ANSWER_TIMEOUT = 5.0
_EXACT = frozenset({"socketcand"} if sys.platform != "win32" else ())  # it waits in select()


def open_transport(
    interface: str | None,
    channel: str | int | None,
    bitrate: int | None,
    options: Mapping[str, object],
) -> Transport:
    """Open a bus; what is None comes from python-can's own configuration.

    Args:
        interface: python-can's name of the kind of bus: "socketcan", "pcan", "socketcand", ...
        channel: the bus of that kind: "vcan0", ...
        bitrate: [bit/s]; for SocketCAN the interface's own setting counts.
        options: further keyword arguments of the python-can bus; `fd` makes the bus one of CAN FD,
            whose data phase has the `data_bitrate` [bit/s].

    Returns:
        The fast path for SocketCAN, else python-can's bus in a wrapper.

    Raises:
        BusError: the bus cannot be opened; one line says what, where and what would be right.
    """
    settings, what = _settle(interface, channel, bitrate, options)
    bus = _open(settings, what)
    fast, slow = (float(settings.get(key) or 0) for key in ("data_bitrate", "bitrate"))
    speedup = fast / (slow or USUAL_BITRATE) or 1.0
    if settings["interface"] != "socketcan":
        return PythonCanTransport(
            bus,
            what,
            has_exact_wait=settings["interface"] in _EXACT,
            speedup=speedup if settings.get("fd") else 0.0,
        )
    try:
        return SocketCanTransport(cast("RawCanBus", bus), str(settings["channel"]), speedup)
    except BusError:
        bus.shutdown()
        raise


def open_can_bus(
    interface: str | None,
    channel: str | int | None,
    bitrate: int | None,
    options: Mapping[str, object],
) -> tuple[can.BusABC, str]:
    """Open a bus as python-can has it, for a controller; arguments as for `open_transport`.

    Returns:
        The bus, and its name for people: "socketcan can0".
    """
    settings, what = _settle(interface, channel, bitrate, options)
    return _open(settings, what), what


def _settle(
    interface: str | None,
    channel: str | int | None,
    bitrate: int | None,
    options: Mapping[str, object],
) -> tuple[dict[str, Any], str]:
    """Return all settings, checked as far as that can be done before opening, and the bus' name."""
    given = {"interface": interface, "channel": channel, "bitrate": bitrate, **options}
    settings = _resolve({key: value for key, value in given.items() if value is not None})
    what = f"{settings['interface']} {settings['channel']}"
    _check(settings, what)
    return settings, what


def _resolve(given: dict[str, object]) -> dict[str, Any]:
    """Return all settings, with those from the environment and can.conf filled in.

    Raises:
        BusError: the interface is unknown, or a setting is malformed.
    """
    try:
        return dict(can.util.load_config(config=given))
    except can.CanInterfaceNotImplementedError as error:
        raise BusError(_unknown_interface(_wanted_interface(given))) from error
    except (ValueError, TypeError) as error:
        where = "a setting of the bus, or python-can's configuration"
        raise BusError(f"{where}: {first_line(error)}") from error


def _wanted_interface(given: Mapping[str, object]) -> str:
    """Return the interface that is asked for, by the first that names one; empty for none."""
    sources = (given, can.rc, can.util.load_environment_config(), can.util.load_file_config())
    return next((str(each["interface"]) for each in sources if each.get("interface")), "")


def _unknown_interface(name: str) -> str:
    if not name:
        return (
            "no CAN interface chosen; '-i socketcan -c vcan0', CAN_INTERFACE and CAN_CHANNEL, or a "
            f"can.conf name one; {_HUB_HINT}"
        )
    known = sorted(can.VALID_INTERFACES)
    near = close_names(name, known, most=3) or known
    return f"unknown CAN interface {name!r}; python-can has {', '.join(near)}"


def _check(settings: dict[str, Any], what: str) -> None:
    """Refuse what python-can would open silently or try for ten seconds.

    Raises:
        BusError: there is no channel for SocketCAN, or no socketcand at the address, or nobody who
            carries CAN FD over it.
    """
    if settings["interface"] == "socketcan" and not settings["channel"]:
        raise BusError("socketcan: no channel; '-c vcan0' names one")
    if settings["interface"] == "socketcan" and settings.get("fd"):
        _check_fd(str(settings["channel"]), what)
    if settings["interface"] == "socketcand":
        # Small writes must not wait for the acknowledgement of the one before (Nagle's algorithm).
        settings.setdefault("tcp_tune", True)
        _check_socketcand(settings, what)
        if settings.get("fd") and not given_to("socketcand"):
            raise BusError(f"{what}: nothing here carries CAN FD over socketcand")


def _check_fd(channel: str, what: str) -> None:
    """Refuse CAN FD on an interface that is set to classical CAN.

    Raises:
        BusError: it is.
    """
    if has_fd(channel) is False:
        right = "mtu 72" if channel.startswith("vcan") else "type can dbitrate 2000000 fd on"
        raise BusError(
            f"{what}: the interface is set to classical CAN, and cannot carry CAN FD; "
            f"'ip link set {channel} {right}', while it is down, sets it to CAN FD"
        )


def _check_socketcand(settings: dict[str, Any], what: str) -> None:
    """Open the channel once to see the answer.

    python-can tries to connect for ten seconds, logging each refusal, and leaves its socket open
    where the channel is refused.

    Raises:
        BusError: the address is incomplete, nobody answers there, or there is no such channel.
    """
    if any(settings.get(key) is None for key in ("channel", "host", "port")):
        raise BusError(
            f"{what}: address incomplete; '-c can0 --bus-kwargs host=127.0.0.1 port=29536' is one"
        )
    address = f"{settings['host']}:{settings['port']}"
    try:
        answer = _answer_to_open(settings["host"], settings["port"], str(settings["channel"]))
    except OSError as error:
        raise BusError(
            f"{what}: nobody answers at {address} ({first_line(error)}); "
            "'hil-bench run --hub' makes a bus there"
        ) from error
    if answer != "ok":
        raise BusError(f"{what}: {answer}")


def _answer_to_open(host: str, port: int, channel: str) -> str:
    """Return a socketcand's answer to "< open CHANNEL >", without its brackets."""
    with socket.create_connection((host, port), timeout=_ANSWER_TIMEOUT) as probe:
        probe.recv(256)  # the greeting
        probe.sendall(f"< open {channel} >".encode("ascii", "replace"))
        return ascii(probe.recv(256).decode("ascii", "replace").strip("<> "))[1:-1]


def _open(settings: dict[str, Any], what: str) -> can.BusABC:
    """Return the open bus.

    Raises:
        BusError: it cannot be opened.
    """
    try:
        if settings["interface"] == "socketcand" and settings.get("fd"):
            rest = {key: value for key, value in settings.items() if key != "interface"}
            (module,) = given_to("socketcand")
            return cast("can.BusABC", module.SocketcandFdBus(**rest))
        return can.Bus(**settings, ignore_config=True)
    except Exception as error:  # backends raise what they like, NameError included
        raise BusError(f"{what}: {_why(settings, error)}") from error


def _why(settings: dict[str, Any], error: Exception) -> str:
    """Return the reason why a bus does not open, with a remedy where one is known."""
    if settings["interface"] == "socketcan" and isinstance(error, OSError):
        return _why_not_socketcan(str(settings["channel"]), error)
    if isinstance(error, TypeError):
        return f"options do not fit: {first_line(error).rpartition('__init__() ')[2]}"
    if isinstance(error, (can.CanInterfaceNotImplementedError, ImportError, NameError)):
        return (
            f"its driver or Python package is missing ({first_line(error)}); see 'CAN Interface "
            "Modules' in the documentation of python-can"
        )
    return first_line(error)


def _why_not_socketcan(channel: str, error: OSError) -> str:
    if error.errno in {errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT}:
        return f"this kernel has no CAN sockets; 'modprobe can_raw' may load them, {_HUB_HINT}"
    if error.errno == errno.ENODEV and channel.startswith("vcan"):
        return f"no such device; 'ip link add dev {channel} type vcan' makes one"
    if error.errno == errno.ENODEV:
        return "no such CAN device; 'ip -brief link show type can' lists those there are"
    return first_line(error)
