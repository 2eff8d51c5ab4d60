"""Modbus/TCP Security: who may connect, and who may write."""

import asyncio
import contextlib
import shutil
import socket
import ssl
import subprocess
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import serialization
from support.certificates import Authority, Files
from support.modbus_loop import make_binding, ticking
from support.patience import GUARD

from hil_bench.abilities.modbus.protocol.register_map import TlsConfig
from hil_bench.abilities.modbus.server.connections import ConnectionPool, role_of, server_context
from hil_bench.abilities.modbus.server.process import ModbusProcess
from hil_bench.errors import BusError
from hil_drivers import BusLostError, DriverTimeoutError
from hil_drivers.errors import ModbusExceptionError
from hil_drivers.modbus import ModbusClient, PressureSensor, TcpLink, TlsLink

ROOT = Path(__file__).parents[4]
OPERATOR = b"\x0c\x08operator"  # UTF8String, length, text


@pytest.fixture(scope="module")
def authority(tmp_path_factory):
    return Authority(tmp_path_factory.mktemp("ca"))


@pytest.fixture(scope="module")
def server_files(authority):
    return authority.sign("server")


@pytest.fixture
def binding(tmp_path, authority, server_files):
    """A bench, and its binding to a server that asks for certificates."""
    return make_binding(
        tmp_path,
        extra=f'tls_certificate = "{server_files.certificate}"\ntls_key = "{server_files.key}"\n'
        f'tls_client_ca = "{authority.ca}"',
    )


@contextlib.contextmanager
def running(side, binding):
    with ModbusProcess(binding.plan) as server, ticking(side, binding):
        yield server.endpoints.port


@pytest.fixture
def port(binding):
    """The port of such a server."""
    with running(*binding) as port:
        yield port


def open_client(port, files, ca):
    link = TlsLink("127.0.0.1", port, certificate=files.certificate, key=files.key, ca=ca)
    return ModbusClient(link, timeout=GUARD)


def test_a_client_with_the_role_reads_and_writes(port, authority):
    with open_client(port, authority.sign("operator", role=OPERATOR), authority.ca) as client:
        sensor = PressureSensor(client, 2)
        sensor.setup()
        sensor.poll()
        assert 1e5 < sensor.pressure < 100e5
        client.write_registers(2, 1, [7])


def test_a_client_without_the_role_only_reads(port, authority):
    with open_client(port, authority.sign("viewer"), authority.ca) as client:
        sensor = PressureSensor(client, 2)
        sensor.poll()
        assert 1e5 < sensor.pressure < 100e5
        with pytest.raises(ModbusExceptionError) as refusal:
            client.write_registers(2, 1, [7])
        assert refusal.value.code == 1  # illegal function, as the specification has it


def test_a_handshake_that_fails_is_named(capfd, binding, authority):
    with running(*binding) as port:
        with socket.create_connection(("127.0.0.1", port), timeout=GUARD) as connection:
            name = "{}:{}".format(*connection.getsockname())
            connection.sendall(b"GET / HTTP/1.1\r\n\r\n")
            with contextlib.suppress(ConnectionResetError):
                while connection.recv(64):
                    pass
        with open_client(port, authority.sign("viewer"), authority.ca) as client:
            PressureSensor(client, 2).poll()
    assert capfd.readouterr().err.splitlines() == [
        f"hil-bench: modbus client {name}: closed: TLS handshake failed: HTTP_REQUEST"
    ]


def test_a_client_that_leaves_in_the_middle_is_named(capfd, binding, authority):
    with running(*binding) as port:
        with socket.create_connection(("127.0.0.1", port), timeout=GUARD) as connection:
            name = "{}:{}".format(*connection.getsockname())
            connection.sendall(b"\x16\x03\x01\x02\0")  # the head of a handshake record
        with open_client(port, authority.sign("viewer"), authority.ca) as client:
            PressureSensor(client, 2).poll()
    (line,) = capfd.readouterr().err.splitlines()
    begin = f"hil-bench: modbus client {name}: closed: TLS handshake failed: "
    assert line == f"{begin}the connection was closed meanwhile"


def test_connections_that_never_shake_hands_count(rig, authority, server_files):
    certificate, key = server_files
    config = TlsConfig(certificate, key, authority.ca, "operator")

    async def run():
        pool = ConnectionPool(rig.server, 4, config)
        loop = asyncio.get_running_loop()
        listener = await loop.create_server(pool.make_connection, "127.0.0.1", 0)
        address = listener.sockets[0].getsockname()
        with contextlib.ExitStack() as stack:
            silent = [
                stack.enter_context(socket.create_connection(address, timeout=GUARD))
                for _ in range(6)
            ]
            # The first two make room for the last two, and are closed.
            for connection in silent[:2]:
                assert await asyncio.to_thread(connection.recv, 1) == b""
            assert len(pool) == 4
            pool.close()
            for connection in silent[2:]:
                assert await asyncio.to_thread(connection.recv, 1) == b""
        listener.close()
        await listener.wait_closed()

    asyncio.run(run())


def test_a_strangers_certificate_and_plain_tcp_get_nothing(port, tmp_path, authority):
    stranger = Authority(tmp_path, "stranger").sign("operator", role=OPERATOR)
    for client in (
        open_client(port, stranger, authority.ca),
        ModbusClient(TcpLink("127.0.0.1", port), timeout=GUARD),
    ):
        with client, pytest.raises((BusLostError, DriverTimeoutError)):
            PressureSensor(client, 2).poll()
    # And who may is served all the same.
    with open_client(port, authority.sign("viewer"), authority.ca) as client:
        PressureSensor(client, 2).poll()


def test_a_server_that_the_client_does_not_know_is_refused(port, tmp_path, authority):
    other = Authority(tmp_path, "other")
    with (
        open_client(port, authority.sign("viewer"), other.ca) as client,
        pytest.raises(BusLostError, match="certificate verify failed"),
    ):
        PressureSensor(client, 2).poll()


@pytest.mark.parametrize(
    ("der", "role"),
    [
        (OPERATOR, "operator"),
        (None, None),
        (b"", None),
        (b"\x0c", None),
        (b"\x0c\x09operator", None),  # one byte is missing
        (b"\x0c\x03operator", None),  # some are left over
        (b"\x13\x08operator", None),  # a PrintableString
        (b"\x0c\x02\xff\xfe", None),  # not UTF-8
        (b"\x0c\x80" + b"a" * 128, None),  # an indefinite length
        (b"\x0c\x03\xc3\xb6r", "ör"),
    ],
)
def test_the_role_is_a_utf8_string_and_nothing_else(authority, der, role):
    pem = authority.sign("somebody", role=der).certificate.read_bytes()
    certificate = x509.load_pem_x509_certificate(pem)
    assert role_of(certificate.public_bytes(serialization.Encoding.DER)) == role


def test_what_is_no_certificate_has_no_role():
    assert role_of(b"garbage") is None


def test_files_that_do_not_fit_are_told(tmp_path, make_file, authority, server_files):
    garbage = make_file("garbage.pem", "garbage")
    certificate, key = server_files
    other_key = authority.sign("other").key

    def config(**change):
        files = {"certificate": certificate, "key": key, "client_ca": authority.ca}
        return TlsConfig(**{**files, **change}, writer_role="operator")

    assert server_context(config()).verify_mode is ssl.CERT_REQUIRED
    for change, message in (
        ({"key": tmp_path / "absent"}, "absent: cannot be read: No such file"),
        ({"key": other_key}, r"are no certificate and its key .*: KEY_VALUES_MISMATCH"),
        ({"certificate": garbage}, "are no certificate and its key"),
        ({"client_ca": garbage}, "garbage.pem holds no certificate in PEM"),
    ):
        with pytest.raises(BusError, match=message):
            server_context(config(**change))


def test_the_documented_certificates_pass_strict_verification(tmp_path, monkeypatch):
    """As Python 3.13 verifies by itself: RFC 5280, also where an earlier one runs this test."""
    if shutil.which("openssl") is None:
        pytest.skip("needs the program openssl")
    text = (ROOT / "docs" / "modbus.md").read_text(encoding="utf-8")
    script = text.partition("<!-- certificates -->\n```sh\n")[2].partition("```")[0]
    assert script.count("openssl x509 -req") == 2
    command = ["bash", "-euc", script]  # ours
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)  # noqa: S603
    with_files = """tls_certificate = "server.pem"
        tls_key = "server.key"
        tls_client_ca = "authority.pem"
        tls_writer_role = "operator"
    """
    default = ssl.create_default_context

    def strict(**options):
        context = default(**options)
        context.verify_flags |= ssl.VERIFY_X509_STRICT
        return context

    monkeypatch.setattr(ssl, "create_default_context", strict)
    files = Files(tmp_path / "plc.pem", tmp_path / "plc.key")
    with (
        running(*make_binding(tmp_path, extra=with_files)) as port,
        open_client(port, files, tmp_path / "authority.pem") as client,
    ):
        client.write_registers(2, 1, [7])
        assert client.read_registers(2, "holding_registers", 1, 1) == [7]
