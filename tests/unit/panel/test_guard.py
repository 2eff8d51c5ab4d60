"""Who may come to a panel: hosts, origins, methods, secrets."""

import asyncio

import pytest

from hil_bench.abilities.panel.guard import Guard, Secret

PORT = 8408


async def inner(scope, _receive, send):
    if scope["type"] == "http":
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b""})
    else:
        await send({"type": "websocket.accept"})


def ask(headers, *, kind="http", method="GET", path="/", port=PORT, is_local=True):
    sent = []

    async def send(message):
        sent.append(message)

    scope = {"type": kind, "method": method, "path": path, "headers": headers}
    asyncio.run(Guard(inner, port, is_local=is_local)(scope, None, send))
    return sent


def status(headers, **options):
    return ask(headers, **options)[0]["status"]


def test_only_our_own_address_is_a_host():
    expected = {
        b"127.0.0.1:8408": 200,
        b"localhost:8408": 200,
        b"[::1]:8408": 200,
        b"127.0.0.1:8409": 421,
        b"127.0.0.1": 421,  # port 80
        b"evil.example:8408": 421,  # a name that has come to mean 127.0.0.1
        b"127.0.0.1.evil.example:8408": 421,
        b"me@127.0.0.1:8408": 421,
        b"127.0.0.1:port": 421,
        b"192.0.2.7:8408": 421,
        b"": 421,
        b"\xff:8408": 421,
        b"[::1:8408": 421,
    }
    assert {host: status([(b"host", host)]) for host in expected} == expected


def test_one_host_is_named():
    assert status([]) == 421
    assert status([(b"host", b"127.0.0.1:8408")] * 2) == 421


def test_elsewhere_a_host_is_a_number_that_nobody_can_own():
    expected = {b"192.0.2.7:8408": 200, b"evil.example:8408": 421, b"localhost:8408": 200}
    assert {host: status([(b"host", host)], is_local=False) for host in expected} == expected


def test_the_port_80_need_not_be_named():
    assert status([(b"host", b"localhost")], port=80) == 200


@pytest.mark.parametrize(
    ("origin", "answer"),
    [
        (b"http://127.0.0.1:8408", "websocket.accept"),
        (b"http://localhost:8408", "websocket.close"),  # not the page that it was loaded from
        (b"https://127.0.0.1:8408", "websocket.close"),
        (b"http://evil.example", "websocket.close"),
        (b"http://evil.example:8408", "websocket.close"),
        (b"http://127.0.0.1:9000", "websocket.close"),
        (b"null", "websocket.close"),
        (b"", "websocket.close"),
        (None, "websocket.close"),
    ],
)
def test_a_socket_comes_from_our_own_page(origin, answer):
    headers = [(b"host", b"127.0.0.1:8408")]
    if origin is not None:
        headers.append((b"origin", origin))
    assert ask(headers, kind="websocket")[0]["type"] == answer


@pytest.mark.parametrize("other", [b"http://127.0.0.1:8408", b"http://evil.example"])
def test_one_origin_is_named(other):
    headers = [(b"host", b"127.0.0.1:8408"), (b"origin", b"http://127.0.0.1:8408")]
    headers.append((b"origin", other))
    assert ask(headers, kind="websocket")[0]["type"] == "websocket.close"


def test_a_page_of_another_origin_gets_nothing():
    headers = [(b"host", b"127.0.0.1:8408"), (b"origin", b"http://evil.example")]
    assert status(headers) == 403


def test_only_one_path_takes_a_post_and_that_from_our_own_page_only():
    ours = [(b"host", b"127.0.0.1:8408"), (b"origin", b"http://127.0.0.1:8408")]
    assert status(ours, method="POST") == 405
    assert status(ours, method="POST", path="/mf4") == 200
    assert status(ours, method="PUT", path="/mf4") == 405
    assert status(ours, path="/mf4") == 405
    assert status(ours[:1], method="POST", path="/mf4") == 403  # says no origin
    theirs = [ours[0], (b"origin", b"http://evil.example")]
    assert status(theirs, method="POST", path="/mf4") == 403


def test_each_answer_says_what_the_page_may_load():
    for host in (b"127.0.0.1:8408", b"evil.example"):
        headers = dict(ask([(b"host", host)])[0]["headers"])
        policy = headers[b"content-security-policy"].decode()
        assert "default-src 'none'" in policy
        assert "script-src 'self';" in policy
        assert "unsafe" not in policy
        assert headers[b"x-content-type-options"] == b"nosniff"
        assert headers[b"referrer-policy"] == b"no-referrer"


@pytest.mark.parametrize("wrong", ["", "secre", "secret ", None, 5, ["secret"], "\ud800"])
def test_only_the_secret_fits(wrong):
    assert Secret("secret").fits("secret")
    assert not Secret("secret").fits(wrong)
