"""The faults of a bench that runs in another process: ``bench.faults.freeze("pressure_a")``."""

import contextlib
from typing import Final, Self

from hil_bench.abilities.faults.verbs import Verbs
from hil_bench.abilities.live.client import FeedClient
from hil_bench.errors import ConfigError


class AttachedFault:
    """A fault that was begun from here; as a context manager it is cleared at the end of the block.

    Args:
        client: the connection to its bench.
        number: of the fault.

    Attributes:
        number: as passed in.
    """

    def __init__(self, client: FeedClient, number: int) -> None:
        self.number = number
        self._client = client

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.clear()

    def clear(self) -> None:
        """End the fault with the next tick; nothing happens where it has ended."""
        with contextlib.suppress(ConfigError):
            self._client.request("clear_fault", number=self.number)


class AttachedFaults(Verbs[AttachedFault]):
    """The faults of an attached bench, with the verbs of `hil_bench.Faults`.

    Args:
        client: the connection.
    """

    def __init__(self, client: FeedClient) -> None:
        self._client = client

    def begin(self, kind: str, target: str, /, **arguments: object) -> AttachedFault:
        """Begin a fault with the next tick.

        Args:
            kind: a verb of `hil_bench.Faults`.
            target: the node or axis that it concerns.
            arguments: of the verb, in SI; by name.
        """
        number = self._client.request("begin_fault", kind=kind, target=target, arguments=arguments)
        return AttachedFault(self._client, number)

    def clear(self) -> None:
        """End all faults of the bench, planned ones too."""
        self._client.request("clear_fault")


ATTRIBUTES: Final = {"faults": AttachedFaults}
