"""The keys of a network that a master boots: name, unit, default; docs/commissioning.md."""

from datetime import datetime
from typing import Final

from hil_bench.config.objects import objects
from hil_bench.config.settings import Key
from hil_bench.config.values import boolean, choice, describe, integer, number, text, zero_or
from hil_bench.errors import ConfigError
from hil_bench.units import MILLISECOND, SECOND
from hil_drivers.boot_records import Loss, Start
from hil_drivers.network import CONTROLLER_ID

_U32: Final = 0xFFFF_FFFF
_EPOCH: Final = datetime(1984, 1, 1)  # noqa: DTZ001 - CiA 301 has no time zone
_LAST: Final = datetime(2100, 1, 1)  # noqa: DTZ001


def moment(value: object) -> datetime:
    """Return a local date and time.

    Raises:
        ConfigError: the value is something else.
    """
    right = "give a date and time without zone, as in 2026-11-22T13:45:00"
    if not isinstance(value, datetime) or value.tzinfo is not None:
        raise ConfigError(f"{describe(value)} is no such time; {right}")
    if not _EPOCH < value < _LAST:
        raise ConfigError(f"{value.isoformat()} is out of range; {right}, from 1984 to 2099")
    return value


def days_and_milliseconds(time: datetime) -> tuple[int, int]:
    """Return a time as 0x1F26 and 0x1F27 hold it: days since 1984-01-01, ms after midnight."""
    passed = time - _EPOCH
    return passed.days, passed.seconds * 1000 + passed.microseconds // 1000


def _milliseconds(name: str, field: str) -> Key:
    read = zero_or(number(MILLISECOND, low=1.0, high=65535.0))
    return Key(name, read, 0.0, MILLISECOND, field)


def _unsigned32(name: str) -> Key:
    return Key(name, integer(0, _U32))


MASTER_KEYS: Final = (
    Key("node_id", integer(1, 127), CONTROLLER_ID),
    _milliseconds("heartbeat_ms", "heartbeat"),
    Key("start", choice([start.value for start in Start]), Start.EACH.value),
    Key("on_loss", choice([loss.value for loss in Loss]), Loss.SLAVE.value),
    Key(
        "boot_time_s",
        zero_or(number(SECOND, low=0.1, high=86400.0)),
        10.0,
        SECOND,
        "boot_time",
    ),
)

IDENTITY_KEYS: Final = ("vendor_id", "product_code", "revision_number", "serial_number")

SLAVE_KEYS: Final = (
    Key("node_id", integer(1, 127), example="1"),
    Key("eds", text),
    Key("mandatory", boolean, default=True),
    Key("boot", boolean, default=True, field="boots"),
    Key("keep_alive", boolean, default=False),
    _unsigned32("device_type"),
    *(_unsigned32(name) for name in IDENTITY_KEYS),
    _milliseconds("heartbeat_time_ms", "heartbeat_time"),
    Key("dcf", text),
    Key("concise_dcf", text),
    Key("objects", objects, {}),
    Key("configured", moment),
    Key("store", boolean, default=False),
    Key("restore", integer(0, 127), 0),
)
