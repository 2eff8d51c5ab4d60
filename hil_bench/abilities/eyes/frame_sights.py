"""Sights of single frames and whole transfers: words, values and problems.

Nothing here remembers what came before; `Decoder` does, and knows whose frame each is.
"""

import struct
from collections.abc import Sequence
from typing import Final

from hil_bench.abilities.common.identifiers import function_of
from hil_bench.abilities.eyes.frame_words import (
    abort_text,
    emcy_words,
    error_text,
    meaning_of,
    nmt_text,
)
from hil_bench.abilities.eyes.j1939 import describe
from hil_bench.abilities.eyes.known_node import KnownNode, PdoOwner
from hil_bench.abilities.eyes.sight import LENGTH_OF_EMCY, Service, Sight
from hil_bench.abilities.eyes.transfers import Transfer, Way
from hil_bench.canopen_device.frame import BRS, ESI, Frame
from hil_bench.outside.recording.channels import LoggedFrame

LENGTH_OF_SDO: Final = 8
_TO_DESTINATION, _NODE_ID = 0x80, 0x7F
"""First byte of an MPDO: whether the node-ID in it is that of the receiver; the node-ID."""


def extended_sight(logged: LoggedFrame) -> Sight:
    """Describe a frame with a 29-bit identifier."""
    frame = logged.frame
    words = f"not CANopen, 29-bit identifier 0x{frame.can_id:08X}"
    if not frame.is_remote:
        words = f"{words}; J1939: {describe(frame.can_id, frame.data)}"
    return Sight(logged.now, logged.frame, Service.OTHER, "29-bit", said=words)


def fd_sight(logged: LoggedFrame) -> Sight:
    """Describe a frame of CAN FD, which is none of CiA 301 or SAE J1939-21."""
    frame = logged.frame
    flags = [name for flag, name in ((BRS, "BRS"), (ESI, "ESI")) if frame.fd & flag]
    words = " ".join((*flags, f"{len(frame.data)} bytes", _digits(frame)))
    return Sight(logged.now, frame, Service.OTHER, "CAN FD", said=words)


def error_sight(logged: LoggedFrame) -> Sight:
    """Describe an error frame, which the recording adapter reports."""
    return Sight(logged.now, logged.frame, Service.OTHER, "error", problem=error_text(logged.frame))


def plain_sight(service: Service, logged: LoggedFrame) -> Sight:
    """Describe a frame that belongs to no node."""
    frame = logged.frame
    name = function_of(frame.can_id).name
    words = _remote_or(frame, meaning_of(frame.can_id, frame.data) or _digits(frame))
    return Sight(logged.now, frame, service, name, said=words)


def nmt_sight(node: KnownNode | None, logged: LoggedFrame) -> Sight:
    """Describe an NMT message.

    Args:
        node: whom it commands; None for all.
        logged: the message.
    """
    frame = logged.frame
    words = nmt_text(frame.data)
    problem = "" if words and not frame.is_remote else "is no NMT message of 2 bytes"
    name, node_id = ("", None) if node is None else (node.name, node.node_id)
    return Sight(logged.now, frame, Service.NMT, "NMT", name, node_id, words, problem=problem)


def sync_sight(producers: Sequence[KnownNode], logged: LoggedFrame) -> Sight:
    """Describe a SYNC.

    Args:
        producers: the nodes that may have sent it.
        logged: the message.
    """
    frame = logged.frame
    length = len(frame.data)
    return Sight(
        logged.now,
        frame,
        Service.SYNC,
        "SYNC",
        " or ".join(node.name for node in producers) or "a master",
        producers[0].node_id if len(producers) == 1 else None,
        _remote_or(frame, f"counter {frame.data[0]}" if length == 1 else ""),
        problem=f"{length} bytes, 0 or 1 are right" if length > 1 else "",
    )


def emcy_sight(node: KnownNode, logged: LoggedFrame) -> Sight:
    """Describe an EMCY message of a node."""
    frame = logged.frame
    is_right = len(frame.data) == LENGTH_OF_EMCY
    return Sight(
        logged.now,
        frame,
        Service.EMCY,
        "EMCY",
        node.name,
        node.node_id,
        _remote_or(frame, emcy_words(frame.data) if is_right else _digits(frame)),
        problem="" if is_right or frame.is_remote else f"{len(frame.data)} bytes, 8 are right",
    )


def heartbeat_sight(node: KnownNode, logged: LoggedFrame) -> Sight:
    """Describe a heartbeat, a boot-up message or a node guarding request."""
    frame = logged.frame
    words, problem = meaning_of(frame.can_id, frame.data), ""
    if frame.is_remote:
        words = "node guarding request"
    elif len(frame.data) != 1:
        words, problem = _digits(frame), f"{len(frame.data)} bytes, 1 is right"
    is_boot = words == "boot-up"
    name, words = ("boot-up", "") if is_boot else ("heartbeat", words)
    head = logged.now, frame, Service.HEARTBEAT, name, node.name, node.node_id
    return Sight(*head, words, problem=problem)


def pdo_sight(owners: Sequence[PdoOwner], logged: LoggedFrame) -> Sight:
    """Describe a PDO.

    Args:
        owners: whose it is, one or more; all read it as the first one does.
        logged: the message.
    """
    frame = logged.frame
    node, pdo = owners[0]
    name = node.name if len(owners) == 1 else ", ".join(owner.node.name for owner in owners)
    head = logged.now, frame, Service.PDO, pdo.name, name, node.node_id
    if frame.is_remote:
        return Sight(*head, "remote request")
    problem = pdo.problem(frame.data)
    if pdo.is_multiplexed and not problem:
        return Sight(*head, _mpdo_words(frame.data))
    readings = pdo.read(frame.data)
    return Sight(*head, "" if readings else _digits(frame), readings, problem)


def _mpdo_words(data: bytes) -> str:
    """Return the eight bytes of an MPDO in words: address, index, sub-index, value."""
    address, index, subindex = struct.unpack_from("<BHB", data)
    node, place = address & _NODE_ID, f"0x{index:04X}.{subindex:02X}"
    value = data[4:].hex(" ").upper()
    if address & _TO_DESTINATION:
        return f"MPDO to {f'node {node}' if node else 'all'}: {place} := [{value}]"
    return f"MPDO from node {node}: {place} = [{value}]"


def unknown_pdo_sight(node: KnownNode, name: str, logged: LoggedFrame) -> Sight:
    """Describe a PDO that its node does not have.

    Args:
        node: whose it is by the predefined connection set.
        name: as in ``TPDO1``.
        logged: the message.
    """
    frame = logged.frame
    problem = "its EDS has no such PDO" if node.has_eds and not frame.is_remote else ""
    head = logged.now, frame, Service.PDO, name, node.name, node.node_id
    return Sight(*head, _remote_or(frame, _digits(frame)), problem=problem)


def stray_sdo_sight(node: KnownNode, logged: LoggedFrame) -> Sight:
    """Describe an SDO frame that belongs to no transfer."""
    frame = logged.frame
    name = function_of(frame.can_id).name
    head = logged.now, frame, Service.SDO, name, node.name, node.node_id
    if len(frame.data) != LENGTH_OF_SDO:
        problem = "" if frame.is_remote else f"{len(frame.data)} bytes, 8 are right"
        return Sight(*head, _remote_or(frame, _digits(frame)), problem=problem)
    meaning = meaning_of(frame.can_id, frame.data)
    return Sight(*head, f"{meaning}, of no transfer that was seen to begin")


def transfer_title(node: KnownNode, transfer: Transfer) -> str:
    """Return the title of a transfer: way, object and name."""
    name = node.reader(transfer.index, transfer.subindex).name
    return f"{transfer.way.value} {transfer.place} {name}".rstrip()


def transfer_sight(node: KnownNode, transfer: Transfer, now: int, frame: Frame) -> Sight:
    """Describe an SDO transfer that has ended, completed or aborted.

    Args:
        node: the server.
        transfer: which.
        now: when its end was noticed [ns].
        frame: its last one.
    """
    raw = bytes(transfer.data)
    reader = node.reader(transfer.index, transfer.subindex)
    what = transfer_title(node, transfer)
    duration = f"{(transfer.end - transfer.begin) * 1e-6:.3g} ms"
    if transfer.is_done:
        problem = reader.why_not(raw)
        if transfer.is_short:
            problem = f"{len(raw)} bytes came, {transfer.announced} were announced"
        sign = "=" if transfer.way is Way.UPLOAD else ":="
        words = f"{what} {sign} {reader.read(raw).text}, {duration}"
    elif transfer.abort is not None:
        by = " by the client" if transfer.is_aborted_by_client else ""
        problem = f"aborted{by}, 0x{transfer.abort:08X}, {abort_text(transfer.abort)}"
        words = f"{what}, {'begun before' if transfer.way is Way.UNSEEN else duration}"
    else:
        problem = "not continued" if transfer.is_answered else "not answered"
        words = what
    head = now, frame, Service.SDO, "SDO", node.name, node.node_id
    return Sight(*head, words, problem=problem, transfer=transfer)


def _digits(frame: Frame) -> str:
    return f"[{frame.data.hex(' ').upper()}]"


def _remote_or(frame: Frame, words: str) -> str:
    return "remote request" if frame.is_remote else words
