"""The process of a panel: its port, its secret, and the server."""

import asyncio
import contextlib
import secrets
import socket
import stat
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import uvicorn

from hil_bench.abilities.common.reception import say_errors_in_a_line
from hil_bench.abilities.live.messages import MOST_REQUEST
from hil_bench.abilities.panel import DEFAULT_PORT
from hil_bench.abilities.panel.app import AT_ONCE, Connections, Panel, Server
from hil_bench.abilities.panel.desk import Desk
from hil_bench.abilities.panel.guard import Secret
from hil_bench.abilities.panel.hub import MOST_VIEWERS, Hub
from hil_bench.errors import BusError, ConfigError

LOOPBACK = "127.0.0.1"

SHORTEST_PASSWORD = 12
"""Characters."""

_FAREWELL = 1  # for open connections at the end [s]


class PanelPlan(NamedTuple):
    """The settings of a panel.

    Attributes:
        bench: the name of the bench; None for the one that runs.
        address: that it listens on.
        port: likewise; None for the usual one or, where that is in use, any.
        password: of those who come from elsewhere; empty for a token in the address.
        folder: where tests and recordings are written.
        is_once: whether it ends with the bench.
        layout: the file of the layout that pages open first; None for that of the machine.
    """

    bench: str | None = None
    address: str = LOOPBACK
    port: int | None = None
    password: str = ""
    folder: Path = Path()
    is_once: bool = False
    layout: Path | None = None


def run_panel(
    plan: PanelPlan, announce: Callable[[str], None], stopped: Callable[[], bool]
) -> None:
    """Serve until somebody stops it, or until the bench ends.

    Args:
        plan: what is to be served.
        announce: called with the address, the secret in it, once the port is open.
        stopped: asked ten times a second.
    """
    with contextlib.closing(open_port(plan.address, plan.port)) as listener:
        token = "" if plan.password else secrets.token_urlsafe(16)
        port = listener.getsockname()[1]
        host = f"[{plan.address}]" if ":" in plan.address else plan.address
        announce(f"http://{host}:{port}/" + (f"#{token}" if token else ""))
        asyncio.run(_serve(plan, listener, Secret(plan.password or token), stopped))


def open_port(address: str, port: int | None) -> socket.socket:
    """Return a listening socket.

    Args:
        address: to listen on.
        port: likewise; None for the usual one or, where that is in use, any.

    Raises:
        BusError: it cannot be had.
    """
    problem = OSError("no port")
    for each in (DEFAULT_PORT, 0) if port is None else (port,):
        family = socket.AF_INET6 if ":" in address else socket.AF_INET
        listener = socket.socket(family, socket.SOCK_STREAM)
        try:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind((address, each))
            listener.listen(128)
        except OSError as error:
            listener.close()
            problem = error
        else:
            return listener
    raise BusError(
        f"panel: {address} port {port or DEFAULT_PORT}: {problem.strerror or problem}; give "
        "another --port, or 0 for a free one"
    )


def read_password(path: Path) -> str:
    """Return the password of a file.

    Raises:
        ConfigError: it cannot be read, others may read it, or it is too short.
    """
    try:
        with path.open(encoding="utf-8") as file:
            mode = stat.S_IMODE(path.stat().st_mode)
            text = file.readline().strip()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {getattr(error, 'strerror', error)}") from None
    if mode & 0o077:
        raise ConfigError(f"{path}: others may read it; chmod 600 {path}")
    if len(text) < SHORTEST_PASSWORD:
        raise ConfigError(
            f"{path}: its first line has {len(text)} characters; give {SHORTEST_PASSWORD} or more"
        )
    return text


async def _serve(
    plan: PanelPlan,
    listener: socket.socket,
    secret: Secret,
    stopped: Callable[[], bool] = lambda: False,
) -> None:
    connections = Connections(MOST_VIEWERS)
    hub = Hub(plan.bench, connections.seats)
    panel = Panel(hub, Desk(hub, plan.folder, plan.layout), secret)
    is_local = plan.address in {LOOPBACK, "::1"}
    say_errors_in_a_line("panel")
    server = Server(
        uvicorn.Config(
            panel.app(listener.getsockname()[1], is_local=is_local),
            log_level="error",
            access_log=False,
            lifespan="off",
            server_header=False,
            proxy_headers=False,
            http=connections.http(),
            ws=connections.websocket(),
            backlog=AT_ONCE,
            ws_max_size=MOST_REQUEST,
            ws_per_message_deflate=False,
            timeout_graceful_shutdown=_FAREWELL,
        ),
        connections,
        stopped,
    )
    visits = asyncio.create_task(hub.run(is_once=plan.is_once), name="visits")
    visits.add_done_callback(lambda _: setattr(server, "should_exit", True))
    try:
        await server.serve(sockets=[listener])
    finally:
        visits.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await visits
