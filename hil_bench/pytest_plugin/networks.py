"""The drivers' networks of a bench with several buses, pumped together."""

from collections.abc import Callable

from hil_drivers.network import Network


class Networks:
    """A network for each bus: that of the first is there, the others are made when asked for.

    Args:
        name: of the first bus.
        first: its network.
        make: makes the network of the bus of a name.
        period: longest time in which one network waits while the others do not look [s].
    """

    def __init__(
        self, name: str, first: Network, make: Callable[[str], Network], period: float
    ) -> None:
        self._networks = {name: first}
        self._make = make
        self._period = period

    def on(self, bus: str) -> Network:
        """Return the network of a bus."""
        if bus not in self._networks:
            self._networks[bus] = self._make(bus)
        return self._networks[bus]

    def pump(self, duration: float) -> None:
        """Let time pass, and take what arrives on any bus [s]."""
        first, *others = self._networks.values()
        end = first.now() + duration
        while others and end - first.now() > self._period:
            first.pump(self._period)
            for network in others:
                network.pump(0.0)
        first.pump_until(end)
        for network in others:
            network.pump(0.0)
