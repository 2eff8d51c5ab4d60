"""The controller's side and the hub: whatever a peer sends, only our errors come of it."""

import asyncio
import struct
from collections import deque
from contextlib import suppress
from typing import Any, cast

import can
from fuzz.script import Script

from hil_bench.abilities.commissioning.discovery import Method, discover, listen
from hil_bench.abilities.common.socketcand_protocol import MAX_COMMAND
from hil_bench.abilities.hub.server import Hub, _Client
from hil_bench.abilities.shadow.sample_clock import OverheardDrivers
from hil_bench.bench.configuration import load_config
from hil_drivers import Network, ProportionalValve
from hil_drivers.errors import DriverError
from hil_drivers.modbus import ModbusClient
from hil_drivers.modbus.framing import RtuFraming, TcpFraming

_COB_IDS = (0x581, 0x581, 0x581, 0x181, 0x281, 0x081, 0x701, 0x582, 0x080, 0x7E4, 0x182, 0x184)
_TIMEOUT = 0.5  # of an SDO answer [s]
_LONGEST = 20_000  # waits of a verb [-]: more is a hang


class _ScriptedBus(can.BusABC):
    """Each wait on it is answered by the next frame of a script, or by silence."""

    def __init__(self, script: Script) -> None:
        self.channel_info = "script"
        self.time = 100.0
        self._script = script
        self._waits = 0
        super().__init__(channel="script")

    def now(self) -> float:
        return self.time

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Nobody reads it."""

    def recv(self, timeout: float | None = None) -> can.Message | None:
        self._waits += 1
        assert self._waits < _LONGEST, "waits without end"
        kind = self._script.number() if self._script else 0xFF
        if kind == 0xFF:
            self.time += timeout or 0.0
            return None
        self.time += 1e-4
        data = self._script.take(8 if kind & 0x40 else self._script.number() % 9)
        return can.Message(
            arbitration_id=_COB_IDS[kind % 0x20 % len(_COB_IDS)],
            data=data,
            is_extended_id=False,
            is_remote_frame=kind & 0xA0 == 0xA0,
        )


def sdo_client(data: bytes) -> None:
    """Uploads and downloads against a server that answers anything."""
    with _ScriptedBus(Script(data)) as bus:
        node = Network(bus, clock=bus.now).add_node(1, sdo_timeout=_TIMEOUT)
        for action in (
            lambda: node.upload(0x1008),
            lambda: node.download(0x1010, 1, b"save"),
            lambda: node.download(0x2000, 0, bytes(40)),
            lambda: node.upload(0x6301, 1),
        ):
            with suppress(DriverError):
                action()


def valve_driver(data: bytes) -> None:
    """A valve that answers anything while its driver sets it up and enables it."""
    with _ScriptedBus(Script(data)) as bus:
        valve = ProportionalValve(Network(bus, clock=bus.now), node_id=1)
        for action in (valve.setup, valve.enable, valve.hold):
            with suppress(DriverError):
                action()


def scan(data: bytes) -> None:
    """What `hil-bench scan` hears and asks."""
    with _ScriptedBus(Script(data)) as bus:
        network = Network(bus, clock=bus.now)
        listen(network, 0.05)
        discover(network, Method.SDO, node_ids=range(1, 6))


_DECODER = OverheardDrivers(load_config())


def twin_decoder(data: bytes) -> None:
    """The frames of a machine that `hil-bench shadow` decodes."""
    script = Script(data)
    for kind in script.steps(100):
        message = can.Message(
            arbitration_id=_COB_IDS[kind % len(_COB_IDS)],
            data=script.take(script.number() % 9),
            is_extended_id=False,
        )
        _DECODER.take(message, 0.001)


class _ScriptedLink:
    """A Modbus link on which a script answers."""

    description = "script"

    def __init__(self, script: Script, framing: TcpFraming | RtuFraming) -> None:
        self.framing = framing
        self.time = 100.0
        self._script = script
        self._waits = 0
        self._sent = b""

    def now(self) -> float:
        return self.time

    def open(self, _timeout: float) -> None:
        """It is always there."""

    def close(self) -> None:
        """It needs none."""

    def send(self, data: bytes) -> None:
        self._sent = bytes(data)

    def receive(self, timeout: float) -> bytes:
        self._waits += 1
        assert self._waits < _LONGEST, "waits without end"
        kind = self._script.number() if self._script else 0
        if kind == 0:
            self.time += timeout
            return b""
        # Half of the answers echo the request's head, so that its body is looked at, too.
        head = self._sent[:7] if kind & 1 else b""
        body = self._script.take(kind >> 1)
        if head:
            head = head[:4] + struct.pack(">H", len(body) + 1) + head[6:7]
        return head + body

    def wait(self, duration: float) -> None:
        self.time += duration


def modbus_client(data: bytes) -> None:
    """A Modbus client whose server answers anything."""
    script = Script(data)
    link: Any = _ScriptedLink(script, RtuFraming() if script.number() & 1 else TcpFraming())
    client = ModbusClient(link, clock=link.now)
    for action in (
        lambda: client.read_registers(1, "input_registers", 0, 4),
        lambda: client.read_bit(1, "coils", 0),
        lambda: client.read_identification(1),
    ):
        with suppress(DriverError):
            action()


class _HubTransport:
    """The hub's side of a connection that keeps what is written."""

    def __init__(self) -> None:
        self.written = deque[bytes](maxlen=200)
        self.is_aborted = False

    def get_extra_info(self, _name: str) -> "_HubTransport":
        return self

    def setsockopt(self, *_: object) -> None:
        """As a socket."""

    def is_closing(self) -> bool:
        return self.is_aborted

    def write(self, data: bytes) -> None:
        self.written.append(data)

    def get_write_buffer_size(self) -> int:
        return 0

    def close(self) -> None:
        self.is_aborted = True

    abort = close


async def _hub(data: bytes) -> None:
    script, hub = Script(data), Hub(("can0", "can1"))
    clients = []
    for _ in range(3):
        client, transport = _Client(hub), _HubTransport()
        client.connection_made(cast("asyncio.Transport", transport))
        clients.append((client, transport))
    for kind in script.steps(60):
        client, transport = clients[kind % 3]
        if transport.is_aborted:
            continue
        beginning = (b"", b"< open can0 >< rawmode >", b"< send 123 2 de ad >", b"< send ")[
            kind >> 2 & 3
        ]
        client.data_received(beginning + script.take(script.number() % 200))
        assert len(client._rest) <= MAX_COMMAND + 200
        if kind & 0x80:
            client.connection_lost(None)
            transport.abort()
    for _, transport in clients:
        assert all(piece.startswith(b"< ") for piece in transport.written)


def hub(data: bytes) -> None:
    """Clients of the hub that say anything."""
    asyncio.run(_hub(data))
