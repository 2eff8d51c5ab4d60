"""Signs that a bus is in operation, so that nobody sends to it unasked."""

from hil_bench.abilities.commissioning.discovery import guarded_state
from hil_bench.abilities.commissioning.listening import BusTraffic, Traffic
from hil_drivers import NmtState

_MOST_SIGNS = 6


def signs_of_operation(traffic: BusTraffic) -> tuple[str, ...]:
    """Return the frames heard that show a bus in operation, in a few words; empty for a quiet one.

    These are a node in OPERATIONAL, PDOs, SYNC, NMT commands, and SDO requests of another client,
    whose transfers a second client of the same channel would break.
    """
    rows = sorted(traffic.identifiers.items())
    signs = [sign for _, row in rows if not row.is_extended and (sign := _sign(row))]
    if len(signs) > _MOST_SIGNS:
        return (*signs[:_MOST_SIGNS], f"{len(signs) - _MOST_SIGNS} more")
    return tuple(signs)


def _sign(row: Traffic) -> str:
    name, node = row.function, row.node_id
    if row.is_remote:
        return ""
    if name == "heartbeat":
        is_operational = guarded_state(row.data) is NmtState.OPERATIONAL
        return f"node {node} is OPERATIONAL" if is_operational else ""
    if name in {"NMT", "SYNC"}:
        return name
    if name.startswith(("TPDO", "RPDO")):
        return f"{name} of node {node}"
    return f"another client reads or writes node {node}" if name == "SDO request" else ""
