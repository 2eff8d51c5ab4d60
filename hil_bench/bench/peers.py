"""The devices on the buses of a bench beside its CANopen nodes, as those on SAE J1939."""

from collections.abc import Mapping
from typing import Any, NoReturn, Protocol

from hil_bench.bench.bench import Bench
from hil_bench.devices.axis import Fitting
from hil_bench.errors import ConfigError


class Peer(Protocol):
    """A device beside the CANopen nodes, whose values are set and read by name."""

    @property
    def ecu(self) -> Any:  # noqa: ANN401 - of an ability
        """The device itself, as the buses know it."""

    @property
    def values(self) -> Mapping[str, Any]:
        """The values that it shows, by name, with unit, range and how they are set."""

    def standing(self) -> dict[str, object]:
        """Return its status."""

    def __getitem__(self, name: str, /) -> float:
        """Return a value."""

    def __setitem__(self, name: str, value: float, /) -> None:
        """Set a value."""


class Peers(dict[str, Any]):
    """The devices beside the nodes by their names, each a `Peer`; another name is a `ConfigError`.

    An ability that has such devices extends it. This one has none.

    Attributes:
        fittings: what each device does, by its name.
    """

    fittings: Mapping[str, Fitting] = {}

    def join(self, bench: Bench) -> None:
        """Plug the devices in."""

    def __missing__(self, name: str) -> NoReturn:
        known = f"give one of {', '.join(self)}" if self else "this bench has none"
        raise ConfigError(f'j1939: there is no device "{name}"; {known}')


def peers_of(bench: Bench) -> Peers:
    """Return the devices of a bench beside its nodes."""
    return bench.find(Peers) or Peers()
