"""Honest clients of the servers under siege: ``python benchmarks/siege.py [--brief]``.

A bench with hub and Modbus server runs in real time, a panel in front of it; beside it run a bench
in lock-step, whose SYNC the honest client sends, and one with Modbus/TCP Security. In turns
each server is attacked by a process of its own, over the loopback only, with a bounded number of
connections for some seconds: connections that say nothing, write a byte a second, stop in the
middle of the handshake, never read, send noise or bytes that are no UTF-8, come and go. What the
server closes is opened again. Meanwhile an honest client asks for the same object of the valve,
again and again: on a connection that it had before, and on a new one each time. The table has the
longest and the median wait. The exit code is 1 where a request was not answered within a second.
"""

import argparse
import asyncio
import contextlib
import itertools
import json
import logging
import multiprocessing
import os
import random
import re
import select
import socket
import ssl
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple, Self

from websockets.sync.client import connect as open_websocket

import occasion

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.certificates import Authority

ROOT = Path(__file__).parents[1]
BENCH = """\
[plant.axis1]
[nodes.valve]
profile = "valve_408"
node_id = 1
[modbus]
port = {port}
{tls}
[modbus.units.valve]
"""
TLS = """\
tls_certificate = "{server.certificate}"
tls_key = "{server.key}"
tls_client_ca = "{ca}"
"""
PROMISED = 1.0
"""Longest wait that an honest client should have [s]."""
GIVEN_UP = 5.0
"""Longest wait for an answer [s]; then the request has failed."""
STEPPED = "hub in lock-step"
_OPENING = b"< open can0 >< rawmode >"
_READ_TYPE = b"< send 601 8 40 00 10 00 00 00 00 00 >"
_SYNC = b"< send 80 0 >"
_TABLE = """\
| server | attack | connections | old: median [ms] | longest | failed | new: median [ms] | longest | failed |
|---|---|---|---|---|---|---|---|---|"""  # noqa: E501 - a line of a table
_CONTEXT = multiprocessing.get_context("spawn")


class Target(NamedTuple):
    """A server, as attackers and honest clients find it.

    Attributes:
        name: of the server.
        place: host and port, or the path of a Unix socket.
        opening: what an honest client says first.
        work: what it says then, again and again; an attacker says it and reads no answer.
        token: the secret of the panel.
        tls: how an honest client speaks TLS; None for a server without it.
    """

    name: str
    place: tuple[str, int] | str
    opening: bytes
    work: bytes
    token: str = ""
    tls: ssl.SSLContext | None = None


class Attack(NamedTuple):
    """The attack of a process on a server, and its number of connections at a time."""

    kind: str
    connections: int


def attacks(number: int, *, brief: bool) -> list[Attack]:
    """Return the attacks on a server; those that take the seats of honest clients leave some.

    Args:
        number: of the server. In brief it meets each fourth attack, and the servers meet all.
        brief: few connections, too.
    """
    many = 20 if brief else 500
    all_of_them = [
        Attack("none", 0),
        Attack("silent", many),
        Attack("a byte a second", many),
        Attack("half a handshake", many),
        Attack("noise", many),
        Attack("no UTF-8", many),
        Attack("come and go", 50),
        Attack("never reads", 16),
    ]
    return all_of_them[number % 4 :: 4] if brief else all_of_them


def words_of(target: Target, kind: str, dice: random.Random) -> bytes:
    """Return the first bytes of an attacker once it is connected."""
    if kind == "half a handshake":
        return target.opening[: len(target.opening) // 2]
    if kind == "noise":
        return dice.randbytes(500)
    if kind == "no UTF-8":
        bad = b"\x81\x82\0\0\0\0\xff\xff" if target.name == "panel" else b"\xff\xfe\xff> \n"
        return target.opening + 20 * bad
    return b""


async def attack_once(target: Target, kind: str, dice: random.Random) -> None:
    """Open a connection and do harm with it until the server closes it."""
    if isinstance(target.place, str):
        reader, writer = await asyncio.open_unix_connection(target.place)
    else:
        reader, writer = await asyncio.open_connection(*target.place)
    try:
        writer.write(words_of(target, kind, dice))
        if kind == "come and go":
            return
        if kind == "never reads":
            await stall(target, writer)
        elif kind == "a byte a second":
            for byte in target.opening:
                writer.write(bytes([byte]))
                await asyncio.sleep(1.0)
        while await reader.read(65_536):
            pass
    finally:
        writer.transport.abort()


async def stall(target: Target, writer: asyncio.StreamWriter) -> None:
    """Join as an honest client does, ask on and on, and read nothing."""
    writer.transport.pause_reading()  # type: ignore[attr-defined]
    writer.write(target.opening)
    while not writer.transport.is_closing():
        await asyncio.sleep(0.05)
        for _ in range(10):
            if writer.transport.get_write_buffer_size() < 65_536:
                writer.write(target.work)


def besiege(target: Target, attack: Attack, ready: object, opened: object) -> None:
    """Attack a server until this process is ended."""
    logging.disable()  # asyncio's words on connections that the server has closed
    asyncio.run(_besiege(target, attack, ready, opened))


async def _besiege(target: Target, attack: Attack, ready, opened) -> None:  # noqa: ANN001
    dice = random.Random(1)  # noqa: S311 - noise, the same each time

    async def go_on() -> None:
        while True:
            with contextlib.suppress(OSError):
                opened.value += 1
                await attack_once(target, attack.kind, dice)
            await asyncio.sleep(0.05)  # bounded: 20 a second each

    tasks = [asyncio.create_task(go_on()) for _ in range(attack.connections)]
    await asyncio.sleep(0.5)
    ready.set()
    await asyncio.gather(*tasks)


class Honest:
    """A connection of an honest client."""

    def __init__(self, target: Target) -> None:
        self._target = target
        self._stack = contextlib.ExitStack()
        self._rest = b""
        getattr(self, f"_open_{target.name.split()[0]}")()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def ask(self) -> None:
        """Ask for the object and wait for the answer."""
        getattr(self, f"_ask_{self._target.name.split()[0]}")()

    def _connect(self) -> socket.socket:
        place = self._target.place
        family = socket.AF_UNIX if isinstance(place, str) else socket.AF_INET
        self._socket = self._stack.enter_context(socket.socket(family))
        self._socket.settimeout(GIVEN_UP)
        self._socket.connect(place)
        if (tls := self._target.tls) is not None:
            wrapped = tls.wrap_socket(self._socket, server_hostname="127.0.0.1")
            self._socket = self._stack.enter_context(wrapped)
        return self._socket

    def _hear(self, pattern: bytes) -> bytes:
        while not (found := re.search(pattern, self._rest)):
            data = self._socket.recv(65_536)
            if not data:
                raise ConnectionResetError("closed by the server")
            self._rest = (self._rest + data)[-(1 << 20) :]
        self._rest = self._rest[found.end() :]
        return found[0]

    def _open_hub(self) -> None:
        self._connect()
        self._hear(rb"< hi >")
        for word in (b"< open can0 >", b"< rawmode >"):
            self._socket.sendall(word)
            self._hear(rb"< ok >")

    def _ask_hub(self) -> None:
        is_stepped = self._target.name == STEPPED
        self._socket.sendall(self._target.work + (_SYNC if is_stepped else b""))
        self._hear(rb"< frame 581 [^>]*>")

    def _open_feed(self) -> None:
        self._connect()
        self._hear(rb'"type":"hello"[^\n]*\n')

    def _ask_feed(self) -> None:
        self._socket.sendall(self._target.work)
        self._hear(rb'"type":"answer"[^\n]*\n')

    def _open_modbus(self) -> None:
        self._connect()

    def _ask_modbus(self) -> None:
        self._socket.sendall(self._target.work)
        header = b""
        while len(header) < 8:
            data = self._socket.recv(4096)
            if not data:
                raise ConnectionResetError("closed by the server")
            header += data

    def _open_panel(self) -> None:
        host, port = self._target.place
        with socket.create_connection((host, port), GIVEN_UP) as page:
            page.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n\r\n" % port)
            if b" 200 " not in page.recv(4096):
                raise ConnectionResetError("no page")
        self._socket = self._stack.enter_context(
            open_websocket(
                f"ws://{host}:{port}/feed", origin=f"http://{host}:{port}", open_timeout=GIVEN_UP
            )
        )
        self._socket.send(json.dumps({"token": self._target.token}))
        self._wait_for("hello")

    def _ask_panel(self) -> None:
        self._socket.send(self._target.work.decode())
        self._wait_for("answer")

    def _wait_for(self, kind: str) -> None:
        until = time.monotonic() + GIVEN_UP
        while True:
            lines = self._socket.recv(timeout=max(0.0, until - time.monotonic())).splitlines()
            if any(json.loads(line)["type"] == kind for line in lines):
                return


class Waits(NamedTuple):
    """The waiting times of an honest client [s], and its failures."""

    times: list[float]
    failures: list[str]

    def take(self, act: Callable[[], None]) -> None:
        """Do something and note how long it took."""
        begin = time.perf_counter()
        try:
            act()
        except Exception as error:  # whatever a client meets under siege
            self.failures.append(f"{type(error).__name__}: {error}")
        self.times.append(time.perf_counter() - begin)

    @property
    def is_kept(self) -> bool:
        """True if every request was answered in the promised time."""
        return bool(self.times) and not self.failures and max(self.times) <= PROMISED

    def text(self) -> str:
        """Return the cells of a table: median and longest wait [ms], failures."""
        median, longest = statistics.median(self.times), max(self.times)
        return (
            f"{1e3 * median:.1f} | {1e3 * longest:.1f} | {len(self.failures)} of {len(self.times)}"
        )


def withstand(target: Target, attack: Attack, seconds: float) -> tuple[Waits, Waits, int]:
    """Return the waits on the old connection and on new ones, and the connections of the attack."""
    old, new = Waits([], []), Waits([], [])
    opened = _CONTEXT.Value("q", 0, lock=False)
    with contextlib.ExitStack() as stack:
        there = stack.enter_context(Honest(target))
        there.ask()
        stack.enter_context(_attacker(target, attack, opened))
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            old.take(there.ask)
            new.take(lambda: _visit(target))
            time.sleep(0.02)
    return old, new, opened.value


def _visit(target: Target) -> None:
    with Honest(target) as visitor:
        visitor.ask()


@contextlib.contextmanager
def _attacker(target: Target, attack: Attack, opened: object) -> Iterator[None]:
    if not attack.connections:
        yield
        return
    ready = _CONTEXT.Event()
    words = target._replace(tls=None), attack, ready, opened
    process = _CONTEXT.Process(target=besiege, args=words, daemon=True)
    process.start()
    try:
        if not ready.wait(30.0):
            raise SystemExit(f"siege: {attack.kind}: the attacker did not begin")
        yield
        if not process.is_alive():
            raise SystemExit(f"siege: {attack.kind}: the attacker ended early")
    finally:
        process.terminate()
        process.join()


@contextlib.contextmanager
def fortress() -> Iterator[list[Target]]:
    """Run bench and panel.

    Yields:
        The servers.
    """
    hub, modbus, stepped, security = (free_port() for _ in range(4))
    with tempfile.TemporaryDirectory(dir="/tmp") as folder, contextlib.ExitStack() as stack:
        certificates = Authority(Path(folder))
        server, client = certificates.sign("server"), certificates.sign("client")
        bench, secured = Path(folder, "bench.toml"), Path(folder, "secured.toml")
        bench.write_text(BENCH.format(port=modbus, tls=""), encoding="utf-8")
        tls = TLS.format(server=server, ca=certificates.ca)
        secured.write_text(BENCH.format(port=security, tls=tls), encoding="utf-8")
        runtime = Path(folder, "run")
        runtime.mkdir(mode=0o700)
        environment = {**os.environ, "XDG_RUNTIME_DIR": str(runtime)}
        command = [sys.executable, "-m", "hil_bench"]
        run = [*command, "run", str(bench), "--hub", str(hub), "--name", "siege"]
        stack.enter_context(_running(run, environment))
        stack.enter_context(
            _running([*command, "run", str(secured), "--hub", str(free_port())], environment)
        )
        stepping = [*command, "run", "--lockstep", "--hub", str(stepped), "--name", "stepped"]
        stack.enter_context(_running(stepping, environment))
        panel = stack.enter_context(
            _running([*command, "panel", "--bench", "siege", "--port", "0"], environment)
        )
        address = _announced(panel)
        port, token = int(address[1]), address[2]
        place = str(runtime / "hil-bench" / "siege.sock")
        ask = {"id": 1, "do": "get_object", "node": "valve", "name": "0x6040.00"}
        work = json.dumps(ask).encode()
        upgrade = (
            f"GET /feed HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nOrigin: http://127.0.0.1:{port}\r\n"
            "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: MDEyMzQ1Njc4OUFCQ0RFRg==\r\n\r\n"
        )
        request = struct.pack(">HHHBBHH", 1, 0, 6, 1, 3, 0, 1)
        trust = ssl.create_default_context(cafile=str(certificates.ca))
        trust.load_cert_chain(client.certificate, client.key)
        targets = [
            Target("hub", ("127.0.0.1", hub), _OPENING, _READ_TYPE),
            Target("panel", ("127.0.0.1", port), upgrade.encode(), work, token),
            Target("feed", place, work + b"\n", work + b"\n"),
            Target("modbus", ("127.0.0.1", modbus), request, request),
            Target(STEPPED, ("127.0.0.1", stepped), _OPENING, _READ_TYPE),
            Target("modbus with TLS", ("127.0.0.1", security), _client_hello(), request, tls=trust),
        ]
        _await_all(targets)
        yield targets


def _client_hello() -> bytes:
    """Return the first message of a TLS handshake."""
    outgoing = ssl.MemoryBIO()
    talk = ssl.create_default_context().wrap_bio(
        ssl.MemoryBIO(), outgoing, server_hostname="localhost"
    )
    with contextlib.suppress(ssl.SSLWantReadError):
        talk.do_handshake()
    return outgoing.read()


def _await_all(targets: list[Target]) -> None:
    """Wait until every server answers.

    Raises:
        SystemExit: one does not.
    """
    until = time.monotonic() + 60.0
    for target in targets:
        for _ in itertools.count():
            with contextlib.suppress(OSError, TimeoutError):
                _visit(target)
                break
            if time.monotonic() > until:
                raise SystemExit(f"siege: {target.name} does not answer")
            time.sleep(0.2)


@contextlib.contextmanager
def _running(command: list[str], environment: dict[str, str]) -> Iterator["subprocess.Popen[str]"]:
    process = subprocess.Popen(  # noqa: S603 - our own
        command, stdout=subprocess.PIPE, cwd="/", env=environment, text=True, bufsize=1
    )
    try:
        yield process
        if process.poll() is not None:
            raise SystemExit(f"siege: {command[3]} ended with {process.returncode}")
    finally:
        process.terminate()
        process.wait(30.0)


def _announced(panel: "subprocess.Popen[str]") -> re.Match[str]:
    """Return port and token of a panel.

    Raises:
        SystemExit: it does not say them.
    """
    output = panel.stdout
    while output and select.select([output], [], [], 30.0)[0]:
        if found := re.search(r"http://127\.0\.0\.1:(\d+)/#(\S+)", output.readline()):
            return found
    raise SystemExit("siege: the panel does not say where it is")


def free_port() -> int:
    """Return a port that was free just now."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def main() -> int:
    """Attack each server in each way."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="of each attack (default: 10)")
    parser.add_argument("--server", help="attack this one alone, by its name in the table")
    args = occasion.arguments(parser, seconds=0.2)
    print(_TABLE)
    is_kept = True
    with fortress() as targets:
        attacked = [target for target in targets if args.server in {None, target.name}]
        plan = [
            (target, attack)
            for number, target in enumerate(attacked)
            for attack in attacks(number, brief=args.brief)
        ]
        for target, attack in plan:
            old, new, opened = withstand(target, attack, args.seconds)
            print(f"| {target.name} | {attack.kind} | {opened} | {old.text()} | {new.text()} |")
            for failure in sorted({*old.failures, *new.failures}):
                print(f"siege: {target.name}, {attack.kind}: {failure}", file=sys.stderr)
            is_kept &= args.brief or (old.is_kept and new.is_kept)
            is_kept &= not (old.failures or new.failures)
    print(f"\nload {os.getloadavg()[0]:.1f} at the end")
    return 0 if is_kept else 1


if __name__ == "__main__":
    raise SystemExit(main())
