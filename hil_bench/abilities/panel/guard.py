"""Access to a panel: the right host, the right origin, the secret; and the pages' sources.

A page of somebody else in the same browser can send requests to 127.0.0.1, and a name that it owns
can come to mean 127.0.0.1. So the host that a request names must be ours, and the origin of a
connection too; and nothing is shown or done without the secret, which only our address carries.
"""

import hmac
import ipaddress
import socket
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any
from urllib.parse import urlsplit

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = [
    (b"content-security-policy", _POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
]
EXPORT = "/mf4"
"""The one path that takes a POST, from our own page only."""

_LOCAL = frozenset({"127.0.0.1", "localhost", "::1"})


class Secret:
    """The secret of a panel: the token of the address, or a password.

    Args:
        text: the secret.
    """

    def __init__(self, text: str) -> None:
        self._digest = text.encode()

    def fits(self, text: object) -> bool:
        """Return True if a text is the secret, in a time that does not tell how much of it fits."""
        return isinstance(text, str) and hmac.compare_digest(
            text.encode(errors="replace"), self._digest
        )


class Guard:
    """Lets requests to our host through, from our pages, and adds headers to answers.

    Args:
        app: what is guarded.
        port: that the panel listens on.
        is_local: whether it listens on the loopback only.
    """

    def __init__(self, app: App, port: int, *, is_local: bool = True) -> None:
        self._app = app
        self._port = port
        self._is_local = is_local

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Take a connection or a request."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = _headers(scope)
        if not self._is_host(headers.get(b"host", [])):
            await _refuse(scope, send, 421, "this panel has another address")
        elif not self._is_origin(scope, headers):
            await _refuse(scope, send, 403, "a page of another address may not come here")
        elif not _is_allowed(scope):
            await _refuse(scope, send, 405, "this path takes another method")
        else:
            await self._app(scope, receive, _with_headers(send))

    def _is_host(self, given: list[bytes]) -> bool:
        """Return True if the one name of the host is ours."""
        return len(given) == 1 and self._is_ours(f"//{given[0].decode('latin-1')}")

    def _is_origin(self, scope: Scope, headers: dict[bytes, list[bytes]]) -> bool:
        """Return True if it comes from our page; what is no mere look must say so."""
        given = headers.get(b"origin", [])
        if not given:
            return bool(scope["type"] == "http" and scope["method"] != "POST")
        origin = given[0].decode("latin-1")
        host = headers[b"host"][0].decode("latin-1")
        return len(given) == 1 and origin == f"http://{host}" and self._is_ours(origin)

    def _is_ours(self, address: str) -> bool:
        try:
            parts = urlsplit(address)
            host, port = str(parts.hostname), parts.port
        except ValueError:
            return False
        if (80 if port is None else port) != self._port or parts.username is not None:
            return False
        return host in _LOCAL or (not self._is_local and _is_of_machine(host))


def _is_allowed(scope: Scope) -> bool:
    """Return True if its method is one that its path takes."""
    if scope["type"] != "http":
        return True
    return scope["method"] in ({"POST"} if scope["path"] == EXPORT else {"GET", "HEAD"})


def _is_of_machine(host: str) -> bool:
    """Return True if a host is a number, which nobody can make to mean us, or our own name."""
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return host in {socket.gethostname().lower(), socket.getfqdn().lower()}
    return True


def _headers(scope: Scope) -> dict[bytes, list[bytes]]:
    found: dict[bytes, list[bytes]] = {}
    for name, value in scope["headers"]:
        found.setdefault(name.lower(), []).append(value)
    return found


def _with_headers(send: Send) -> Send:
    async def sends(message: Message) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", []), *_HEADERS]}
        await send(message)

    return sends


async def _refuse(scope: Scope, send: Send, status: int, why: str) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008, "reason": why})
        return
    body = f"{status}: {why}\n".encode()
    headers = [(b"content-type", b"text/plain; charset=utf-8"), *_HEADERS]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
