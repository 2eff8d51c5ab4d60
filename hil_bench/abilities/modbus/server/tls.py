"""Modbus/TCP Security: TLS with certificates on both sides, and roles that may write.

Source: MODBUS/TCP Security Protocol Specification (2018): TLS 1.2 or later with mutual
authentication; the role stands in the client's certificate, in an extension of its own, and who is
not allowed a function gets exception 1.
"""

import asyncio
import ssl
from pathlib import Path
from typing import Final

from hil_bench.abilities.modbus.protocol.server_config import TlsConfig
from hil_bench.errors import BusError

ROLE_OID: Final = "1.3.6.1.4.1.50316.802.1"
"""The extension of a certificate that holds the role, a UTF8String."""

HANDSHAKE_TIME: Final = 10.0
"""How long a client may take for the TLS handshake [s]."""

_UTF8_STRING: Final = 0x0C
_SHORT_LENGTH: Final = 0x80


def server_context(config: TlsConfig) -> ssl.SSLContext:
    """Return the TLS context of the server's connections.

    Raises:
        BusError: a file cannot be read, or holds something else.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.verify_mode = ssl.CERT_REQUIRED
    _check_readable(config)
    try:
        context.load_cert_chain(config.certificate, config.key, password=_no_password)
    except (ssl.SSLError, ValueError) as error:
        raise BusError(
            f"modbus TLS: {config.certificate} and {config.key} are no certificate and its key "
            f"without a password, both PEM: {_reason(error)}"
        ) from None
    try:
        context.load_verify_locations(config.client_ca)
    except ssl.SSLError as error:
        raise BusError(
            f"modbus TLS: {config.client_ca} holds no certificate in PEM: {_reason(error)}"
        ) from None
    return context


async def secure(
    transport: asyncio.Transport, protocol: asyncio.BaseProtocol, context: ssl.SSLContext
) -> asyncio.Transport:
    """Do the server's part of the TLS handshake and return the transport behind it.

    Args:
        transport: a connection that nothing was read from yet.
        protocol: takes what comes through the new transport.
        context: as of `server_context`.

    Raises:
        ConnectionError: the handshake failed; the message says why.
    """
    loop = asyncio.get_running_loop()
    try:
        secured = await loop.start_tls(
            transport,
            protocol,
            context,
            server_side=True,
            ssl_handshake_timeout=HANDSHAKE_TIME,
        )
    except OSError as error:
        raise ConnectionError(f"TLS handshake failed: {_reason(error)}") from None
    if secured is None:  # closed by the client, by TCP's own means
        raise ConnectionError("TLS handshake failed: the client closed the connection")
    return secured


def may_write(connection: ssl.SSLObject, writer_role: str) -> bool:
    """Return True if the client's certificate gives it the role that may write."""
    certificate = connection.getpeercert(binary_form=True)
    return certificate is not None and role_of(certificate) == writer_role


def role_of(certificate: bytes) -> str | None:
    """Return the role in a certificate [DER]; None where there is none that can be read."""
    from cryptography import x509  # noqa: PLC0415 - slow to import, and for TLS alone

    oid = x509.ObjectIdentifier(ROLE_OID)
    try:
        extension = x509.load_der_x509_certificate(certificate).extensions.get_extension_for_oid(
            oid
        )
    except (ValueError, x509.ExtensionNotFound, x509.DuplicateExtension):
        return None
    value = extension.value.public_bytes()
    if len(value) < 2 or value[0] != _UTF8_STRING or value[1] != len(value) - 2:
        return None
    if value[1] >= _SHORT_LENGTH:
        return None
    try:
        return value[2:].decode()
    except UnicodeDecodeError:
        return None


def _check_readable(config: TlsConfig) -> None:
    for path in (config.certificate, config.key, config.client_ca):
        try:
            Path(path).open("rb").close()
        except OSError as error:
            raise BusError(f"modbus TLS: {path}: cannot be read: {error.strerror}") from None


def _no_password() -> str:
    """Refuse to ask on a terminal.

    Raises:
        ValueError: always.
    """
    raise ValueError("the key has a password")


def _reason(error: Exception) -> str:
    return getattr(error, "reason", None) or str(error) or "the connection was closed meanwhile"
