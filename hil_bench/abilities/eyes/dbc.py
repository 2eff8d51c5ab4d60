"""PDOs of known nodes and J1939 messages of known devices as a DBC file, for other tools."""

from collections.abc import Iterable, Iterator
from pathlib import Path

from hil_bench.abilities.common.files import whole_file
from hil_bench.abilities.eyes.channels import symbol_of, word_of
from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.known_ecu import KnownEcu, KnownSignal
from hil_bench.abilities.eyes.known_node import PdoOwner
from hil_bench.abilities.eyes.pdos import PdoField
from hil_bench.abilities.j1939.protocol.ecu import USUAL_PRIORITY
from hil_bench.abilities.j1939.protocol.signals import join
from hil_bench.canopen_device.datatypes import IntegerType, RealType
from hil_bench.canopen_device.pdo_parameters import Direction
from hil_bench.errors import (
    ConfigError,
    about_file,
)

try:
    from cantools.database.can import Database, Message, Node, Signal
    from cantools.database.conversion import BaseConversion
except ImportError:
    raise ConfigError("--write-dbc needs the extra dbc: pip install 'hil-bench[dbc]'") from None

_LONGEST = 8


def write_dbc(path: Path, decoder: Decoder, ecus: Iterable[KnownEcu] = ()) -> int:
    """Write the PDOs that a decoder knows now, and what J1939 devices send.

    Args:
        path: the file.
        decoder: of one bus.
        ecus: the J1939 devices; messages of more than eight bytes are left out.

    Returns:
        How many messages they are.

    Raises:
        ConfigError: there is nothing to write, or the file cannot be written.
    """
    messages = [
        _message(owners)
        for _, owners in sorted(decoder.pdos.items())
        if any(_fits(field) for owner in owners for field in owner.pdo.fields)
    ]
    ecus = tuple(ecus)
    messages += [message for ecu in ecus for message in _ecu_messages(ecu)]
    if not messages:
        right = "give bench.toml or --eds N=FILE"
        raise ConfigError(f"--write-dbc {path}: no PDO and no J1939 signal is known; {right}")
    names = [symbol_of(node.name) for node in decoder.nodes.values()]
    names += [word_of(ecu.name) for ecu in ecus]
    database = Database(messages, nodes=[Node(name, None) for name in names], version="hil-bench")
    content = database.as_dbc_string().encode("cp1252", errors="replace")
    right = "give a file in a directory of yours"
    with about_file(f"--write-dbc {path}", right=right), whole_file(path) as file:
        file.write_bytes(content)
    return len(messages)


def _message(owners: list[PdoOwner]) -> Message:
    """Return a PDO as a message: who sends it names it, or else its first receiver."""
    senders = [owner for owner in owners if owner.pdo.direction is Direction.TPDO]
    owner = (senders or owners)[0]
    receivers = [symbol_of(each.node.name) for each in owners if each not in senders]
    return Message(
        owner.pdo.can_id,
        f"{symbol_of(owner.node.name)}_{owner.pdo.name}",
        min(owner.pdo.length or 0, _LONGEST),
        list(_signals(owner, receivers)),
        senders=[symbol_of(each.node.name) for each in senders],
    )


def _signals(owner: PdoOwner, receivers: list[str]) -> Iterator[Signal]:
    names: set[str] = set()
    for field in filter(_fits, owner.pdo.fields):
        reader = field.reader
        place = f"x{reader.index:04X}_{reader.subindex:02X}"
        name = symbol_of(reader.name) or place
        name = f"{name}_{place}" if name in names else name
        names.add(name)
        yield _signal(name, field, receivers)


def _fits(field: PdoField) -> bool:
    """Return True if a field lies in a CAN frame: mappings from a bus may be nonsense."""
    return field.bits > 0 and field.shift + field.bits <= 8 * _LONGEST


def _signal(name: str, field: PdoField, receivers: list[str]) -> Signal:
    data_type, scale = field.reader.data_type, field.reader.scale
    factor, offset, unit = 1.0, 0.0, None
    if scale is not None:
        factor, offset = scale.factor, -scale.offset * scale.factor or 0.0
        unit = None if scale.unit.symbol == "-" else scale.unit.symbol
    is_float = isinstance(data_type, RealType)
    return Signal(
        name,
        field.shift,
        field.bits,
        byte_order="little_endian",
        is_signed=isinstance(data_type, IntegerType) and data_type.signed,
        conversion=BaseConversion.factory(factor, offset, None, is_float),
        unit=unit,
        receivers=receivers,
    )


def _ecu_messages(ecu: KnownEcu) -> Iterator[Message]:
    for group, known in sorted(ecu.signals.items()):
        signals = [_ecu_signal(each) for each in known if _lies_in_frame(each)]
        if signals:
            can_id = join(ecu.priorities.get(group, USUAL_PRIORITY), group, ecu.address)
            sender = word_of(ecu.name)
            name = f"{sender}_PGN_{group}"
            yield Message(can_id, name, _LONGEST, signals, senders=[sender], is_extended_frame=True)


def _lies_in_frame(known: KnownSignal) -> bool:
    return known.signal.start + known.signal.length <= 8 * _LONGEST


def _ecu_signal(known: KnownSignal) -> Signal:
    place = known.signal
    highest = float(f"{place.offset + place.highest * place.resolution:.12g}")
    ends = place.offset, highest
    return Signal(
        word_of(known.name),
        place.start,
        place.length,
        byte_order="little_endian",
        conversion=BaseConversion.factory(place.resolution, place.offset),
        minimum=min(ends),
        maximum=max(ends),
        unit=None if known.unit == "-" else known.unit,
    )
