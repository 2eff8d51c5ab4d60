"""Loop, mailbox, Modbus server and hub in one thread and in virtual time, from a seed.

What runs is the product's own code from the sockets inwards: `process.serve` with its connections,
sessions and register server, the mailbox, the loop's `Exchange`, and the hub. The network, the
clients and the device are the simulation's. A run checks itself; see `Report`.
"""

import asyncio
import copy
import hashlib
import re
from dataclasses import dataclass, field
from types import SimpleNamespace
from unittest import mock

from support.modbus_traffic import BLOCK, INPUTS, OTHER_UNIT, UNIT, Conversation, Ledger, attack
from support.registers import register
from support.virtual_loop import VirtualLoop

from hil_bench.abilities.common.socketcand_protocol import JOIN_DELAY
from hil_bench.abilities.hub import server as socketcand_hub
from hil_bench.abilities.hub.server import Hub
from hil_bench.abilities.modbus.protocol.mailbox import BoundRegister, Exchange, Mailbox
from hil_bench.abilities.modbus.protocol.register_map import (
    DATA_TYPES,
    DeviceIdentification,
    RegisterAccess,
    RegisterMap,
    ServerConfig,
    Table,
)
from hil_bench.abilities.modbus.protocol.unit_image import UnitImage
from hil_bench.abilities.modbus.server import process
from hil_bench.abilities.modbus.server.connections import Complaints
from hil_bench.abilities.modbus.server.register_server import RegisterServer
from hil_bench.abilities.modbus.server.session import BACKLOG

MODBUS, HUB = 502, 29536
TICK = 0.002
HONEST, CROWD, HOSTILE, CAN_CLIENTS = 5, 24, 8, 3
LONGEST = 30.0
"""Time in which every client must be done [s]."""

CHUNK = 1024
MOST_UNREAD = 16 * 1024 + (BACKLOG + CHUNK) // 12 * 260
"""What a server holds for a client that does not read: where it stops to read, and the responses to
what it had read by then, of 12 bytes a request and 260 a response."""

_FRAME = re.compile(rb"< frame ([0-9A-F]{3}) \d+\.\d{6} ([0-9A-F]*) >")


@dataclass
class Report:
    """What a run found.

    Attributes:
        faults: what should not have been, in words; empty where all is well.
        answered: requests of honest Modbus clients that were answered.
        writes: values that the device took.
        frames: CAN frames that honest clients got back.
        duration: virtual time that it took [s].
        trace: a hash of all that the device and the clients saw.
    """

    faults: list = field(default_factory=list)
    answered: int = 0
    writes: int = 0
    frames: int = 0
    duration: float = 0.0
    trace: str = ""


class Device:
    """Registers that keep what is written, and the journal of it."""

    def __init__(self, blocks):
        self.journal = []
        self.units, self.entries = {}, []
        for unit_id, count in ((UNIT, BLOCK * blocks), (OTHER_UNIT, BLOCK)):
            register_map = _register_map(count)
            self.units[unit_id] = UnitImage(register_map, len(self.entries), commands=True)
            self.entries += [self._entry(register, unit_id) for register in register_map.registers]

    def _entry(self, register, unit_id):
        if register.access is RegisterAccess.READ:
            return BoundRegister(register, lambda: 0.0, None)
        cell = [0.0]

        def put(value, _now):
            cell[0] = value
            if unit_id == UNIT:
                self.journal.append(int(value))

        return BoundRegister(register, lambda: cell[0], put)


def _register_map(count):
    uint16 = DATA_TYPES["uint16"]
    inputs = (
        register(f"i{n}", Table.INPUT_REGISTERS, n, f"i{n}", data_type=uint16)
        for n in range(INPUTS)
    )
    holding = (
        register(
            f"h{n}", Table.HOLDING_REGISTERS, n, f"h{n}", RegisterAccess.WRITE, data_type=uint16
        )
        for n in range(count)
    )
    return RegisterMap(
        "map", "pressure_404", DeviceIdentification("v", "c", "1"), (*inputs, *holding)
    )


class Rows:
    """The newest row, as a `Snapshot` gives it."""

    def __init__(self):
        self.row = None
        self.is_new = asyncio.Event()
        self._sequence = 0

    def write(self, values):
        self._sequence += 1
        self.row = SimpleNamespace(sequence=self._sequence, values=tuple(values))
        self.is_new.set()

    def read(self):
        return self.row


class World:
    """One run.

    Args:
        seed: of all that is random.
        may_stall: whether the loop stands still now and then, for up to more than a second.
        may_die: whether the Modbus server's process is killed and started again.
        is_crowded: whether there are more clients than the mailbox has slots, and a server that
            looks for the loop's answers only now and then.
    """

    def __init__(self, seed, *, may_stall=False, may_die=False, is_crowded=False):
        self.loop = VirtualLoop(seed)
        self.dice = self.loop.dice
        self.ledger = Ledger()
        self.report = Report()
        self._may_stall, self._may_die = may_stall, may_die
        self._is_crowded = is_crowded
        self._honest = CROWD if is_crowded else HONEST
        self._device, self._rows = Device(self._honest + HOSTILE), Rows()
        self._mailbox = Mailbox()
        self._exchange = Exchange(self._device.entries, self._rows, self._mailbox)
        self._complaints = []
        self._echoed = []
        self._heard = {}
        self._tasks = []

    def run(self):
        """Run to the end and return the report."""
        poll = 0.05 if self._is_crowded else process._POLL
        try:
            with (
                mock.patch.object(process, "_POLL", poll),
                mock.patch.object(Complaints, "add", self._hear_complaint),
            ):
                self.loop.run_until_complete(self._live())
        finally:
            tasks = asyncio.all_tasks(self.loop)
            for task in tasks:
                task.cancel()
            self.loop.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))
            self.loop.close()
        return self.report

    def _hear_complaint(self, peer, reason):
        """Take what the server says of a client: a defect of its own is a fault."""
        self._complaints.append((*peer.split(":"), reason))
        if "internal error" in reason:
            self.report.faults.append(reason)

    async def _live(self):
        server = self._start(self._serve())
        hub = self._start(self._host_hub())
        ticking = self._start(self._tick())
        await self._see(lambda: self._rows.row is not None)
        clients = [self._start(self._be_honest(number)) for number in range(self._honest)]
        hostile = [
            self._start(self._be_hostile(self._honest + number)) for number in range(HOSTILE)
        ]
        names = range(1, CAN_CLIENTS + 1)
        self._joined = asyncio.Barrier(CAN_CLIENTS)
        clients += [self._start(self._talk_can(name)) for name in names]
        clients += [self._start(self._die())] if self._may_die else []
        _, late = await asyncio.wait(clients, timeout=LONGEST)
        await asyncio.wait(hostile, timeout=LONGEST)
        self.report.faults += [f"{task.get_coro().__name__} got no answer" for task in late]
        for task in (server, hub, ticking, *clients, *hostile):
            if task.done() and not task.cancelled() and task.exception() is not None:
                self.report.faults.append(f"{task.get_coro().__name__} ended: {task.exception()!r}")
        await self._see(lambda: not (self.loop.is_delivering or self._server.is_waiting))
        self._conclude()

    async def _see(self, is_so):
        """Look at each row whether something is so; that it never is is a fault."""
        try:
            async with asyncio.timeout(LONGEST):
                while not is_so():
                    self._rows.is_new.clear()
                    await self._rows.is_new.wait()
        except TimeoutError:
            self.report.faults.append("what was under way did not end")

    def _start(self, coroutine):
        return self.loop.create_task(coroutine)

    def _conclude(self):
        report, ledger, journal = self.report, self.ledger, self._device.journal
        report.faults += [f"escaped: {error}" for error in self.loop.errors] + ledger.faults
        twice = {value for value in journal if journal.count(value) > 1}
        lost = set(ledger.acknowledged) - set(journal)
        report.faults += [f"value {value} was written twice" for value in sorted(twice)]
        report.faults += [f"value {value} was acknowledged, not written" for value in sorted(lost)]
        if ledger.refused and not self._may_stall:
            report.faults.append(f"an honest client was refused: {ledger.refused[0]}")
        report.faults += self._compare_heard()
        report.answered, report.writes = ledger.answered, len(journal)
        report.frames, report.duration = len(self._echoed), self.loop.time()
        trace = (
            *(journal, ledger.acknowledged, ledger.refused),
            *(self._heard, self._complaints, report.duration),
        )
        report.trace = hashlib.sha256(repr(trace).encode()).hexdigest()

    # The bench.

    async def _tick(self):
        """The loop: a row and a write each tick, and the answers to CAN frames."""
        reader, writer = await self._join_hub()
        arrived = bytearray()
        self._start(self._collect(reader, arrived))
        while True:
            self._exchange.exchange(round(self.loop.time() * 1e9))
            end = arrived.rfind(b">") + 1
            for can_id, data in _FRAME.findall(bytes(arrived[:end])):
                if int(can_id, 16) >= 0x600:
                    writer.write(send(int(can_id, 16) - 0x80, bytes.fromhex(data.decode())))
            del arrived[:end]
            self._check_buffers()
            pause = TICK
            if self._may_stall and self.dice.random() < 0.003:
                pause = self.dice.choice((0.02, 0.3, 1.5))
            await asyncio.sleep(pause)

    async def _collect(self, reader, arrived):
        while data := await reader.read(4096):
            arrived += data

    def _check_buffers(self):
        """The memory that a client costs is bounded, whatever it does."""
        self.loop.ends = [end for end in self.loop.ends if not end.is_gone]
        for end in self.loop.ends:
            unread = end.get_write_buffer_size()
            if end.port == MODBUS:
                waiting = len(end.get_protocol()._session._buffer)
                if waiting >= BACKLOG + CHUNK or unread > MOST_UNREAD:
                    self.report.faults.append(f"{waiting} bytes asked and {unread} unread are kept")
            elif unread > socketcand_hub.MAX_BACKLOG:
                self.report.faults.append(f"the hub keeps {unread} bytes for a client")

    async def _serve(self):
        """The Modbus server, and its successors after each death."""
        config = ServerConfig(is_on_tcp=True, host="", port=MODBUS, connections=64, serial=None)
        while True:
            mailbox = copy.copy(self._mailbox)  # its own counters, the same memory
            mailbox.resume()
            self._server = RegisterServer(self._device.units, self._rows, mailbox, self.loop.time)
            self._server_task = self._start(
                process.serve(config, self._server, SimpleNamespace(send=len))
            )
            await asyncio.wait([self._server_task])
            if not self._server_task.cancelled():
                self._server_task.result()  # its exception ends this task, which is a fault
            await asyncio.sleep(self.dice.uniform(0.02, 0.2))

    async def _die(self):
        for _ in range(2):
            await asyncio.sleep(self.dice.uniform(0.05, 0.4))
            if MODBUS in self.loop._listeners:
                self.loop.kill(MODBUS)
                self._server_task.cancel()

    async def _host_hub(self):
        await (await Hub().start(HUB)).serve_forever()

    # Clients of the Modbus server.

    async def _be_honest(self, block):
        left = self.dice.randint(5, 15) if self._is_crowded else self.dice.randint(10, 40)
        while left > 0:
            await asyncio.sleep(self.dice.uniform(0.0, 0.05))
            conversation = Conversation(self.ledger, block, self.dice, is_alone=not self._may_die)
            try:
                left -= await self._converse(conversation, self.dice.randint(1, left))
            except OSError:
                if not self._may_die:
                    self.ledger.faults.append("an honest client lost its connection")

    async def _converse(self, conversation, count):
        """Ask some requests on one connection, in one of several ways; return how many."""
        reader, writer = await self.loop.connect(MODBUS, limit=256)
        depth = self.dice.choice((1, 1, 3, 10))
        asked = 0
        is_half_closed = self.dice.random() < 0.3
        while asked < count or not conversation.is_answered:
            while asked < count and conversation.due < depth:
                writer.write(conversation.ask())
                asked += 1
                if asked == count and is_half_closed:
                    writer.write_eof()
            if self.dice.random() < 0.1:
                await asyncio.sleep(self.dice.uniform(0.0, 0.2))  # a slow reader
            data = await reader.read(self.dice.randint(1, 64))
            if not data:
                if not self._may_die:
                    self.ledger.faults.append(f"closed with {conversation.due} responses due")
                break
            conversation.take(data)
        if is_half_closed and not self._may_die and await reader.read():
            self.ledger.faults.append("more came than was asked for")
        writer.close() if self.dice.random() < 0.7 else writer.transport.reset()
        return asked

    async def _be_hostile(self, block):
        for _ in range(self.dice.randint(1, 3)):
            await asyncio.sleep(self.dice.uniform(0.0, 0.2))
            try:
                await self._attack(block)
            except OSError:
                continue

    async def _attack(self, block):
        port = self.dice.choice((MODBUS, MODBUS, MODBUS, HUB))
        reader, writer = await self.loop.connect(port, limit=64)
        for act in attack(self.ledger, block, self.dice):
            if act == "read":
                await reader.read(10)
            elif act == "wait":
                await asyncio.sleep(self.dice.uniform(0.0, 0.5))
            elif act == "eof":
                writer.write_eof()
            elif act == "reset":
                writer.transport.reset()
            else:
                writer.write(act)
                await asyncio.sleep(self.dice.uniform(0.0, 0.01))
        writer.close() if self.dice.random() < 0.5 else writer.transport.reset()

    # Clients of the hub.

    async def _join_hub(self):
        reader, writer = await self.loop.connect(HUB)
        for command in (b"< open can0 >", b"< rawmode >"):
            await reader.readuntil(b">")
            writer.write(command)
        await reader.readuntil(b">")
        return reader, writer

    async def _talk_can(self, name):
        """Send requests to the bench and wait for each answer, hearing what the others say."""
        reader, writer = await self._join_hub()
        heard = self._heard[name] = []
        await self._joined.wait()
        await asyncio.sleep(JOIN_DELAY)  # the hub's: all hear what comes from now on
        number = 0
        for _ in range(self.dice.randint(2, 6)):
            burst = [bytes([name, number + n]) for n in range(self.dice.randint(1, 5))]
            number += len(burst)
            writer.write(b"".join(send(0x600 + name, data) for data in burst))
            while (0x580 + name, burst[-1]) not in heard:
                can_id, text = _FRAME.search(await reader.readuntil(b">")).groups()
                heard.append((int(can_id, 16), bytes.fromhex(text.decode())))
            self._echoed += burst

    def _compare_heard(self):
        """All clients of the hub hear one order, and each frame once."""
        for first in self._heard:
            own = [data for can_id, data in self._heard[first] if can_id == 0x580 + first]
            if own != [bytes([first, number]) for number in range(len(own))]:
                yield f"client {first} of the hub got its answers as {own}"
            for second in self._heard:
                ours = {0x600 + first, 0x600 + second}
                lists = [
                    [entry for entry in self._heard[name] if entry[0] not in ours]
                    for name in (first, second)
                ]
                shorter = min(map(len, lists))
                if lists[0][:shorter] != lists[1][:shorter]:
                    yield f"clients {first} and {second} of the hub heard another order"


def send(can_id, data):
    return f"< send {can_id:03X} {len(data)} {data.hex(' ')} >".encode()


def run_seeds(seeds, **options):
    """Run some seeds and return the reports by seed."""
    return {seed: World(seed, **options).run() for seed in seeds}
