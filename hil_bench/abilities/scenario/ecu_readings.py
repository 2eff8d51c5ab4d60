"""Readings of a J1939 device: its signals, its address claim, its trouble codes."""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

from hil_bench.abilities.scenario.vocabulary import DM1
from hil_bench.bench.ecus import EcuHandle
from hil_bench.devices.j1939.address_claim import ClaimState
from hil_bench.units import si_unit

Read = Callable[[Sequence[float]], float]
"""Returns a value [SI]; it is given the row of the tick."""

_STATE, _ADDRESS = "state", "address"
_STATES: Mapping[str, int] = MappingProxyType(
    {state.value: number for number, state in enumerate(ClaimState)}
)


def ecu_names(
    ecus: Mapping[str, EcuHandle],
) -> tuple[dict[str, str], dict[str, Mapping[str, int]]]:
    """Return the SI unit of each signal, and the numbers of the texts of each state."""
    signals: dict[str, str] = {}
    states: dict[str, Mapping[str, int]] = {}
    for name, ecu in ecus.items():
        signals[f"{name}.{_ADDRESS}"] = "-"
        if _STATE not in ecu:
            states[f"{name}.{_STATE}"] = _STATES
        signals |= {f"{name}.{each}": si_unit(v.unit)[0] for each, v in ecu.values.items()}
    return signals, states


def ecu_reader(ecus: Mapping[str, EcuHandle], name: str) -> Read | None:
    """Return the reader of a name or of a trouble code's activity; None for another name."""
    if name.startswith(f"{DM1}("):
        device, *numbers = name[len(DM1) + 1 : -1].split(", ")
        return _code_reader(ecus[device], tuple(map(int, numbers)))
    owner, _, rest = name.partition(".")
    ecu = ecus.get(owner)
    if ecu is None:
        return None
    if rest in ecu:
        value = ecu.values[rest]
        factor = si_unit(value.unit)[1]
        return lambda _row: value.read() * factor
    if rest == _STATE:
        return lambda _row: float(_STATES[ecu.ecu.state])
    return (lambda _row: float(ecu.address)) if rest == _ADDRESS else None


def _code_reader(ecu: EcuHandle, code: tuple[int, ...]) -> Read:
    """Return the reader of an active code with this SPN and FMI; those left out match any."""
    return lambda _row: float(any(each[: len(code)] == code for each in ecu.trouble_codes))
