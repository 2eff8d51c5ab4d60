"""A bench that runs in another process, from Python: `hil_bench.attach()`.

>>> with hil_bench.attach() as bench:
...     with bench.faults.freeze("pressure_a"):
...         bench.latest()["axis1.P_A"]
"""

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Self

from hil_bench.abilities.live.client import TIMEOUT, BenchEndError, FeedClient, connect
from hil_bench.abilities.live.messages import pack_value, unpack_value
from hil_bench.ability import given_to
from hil_bench.canopen_device.datatypes import Value
from hil_bench.outside.recording.channels import Channel

_WAIT = 0.5


def attach(name: str | None = None, *, timeout: float = TIMEOUT) -> "AttachedBench":
    """Connect to a bench that `hil-bench run` runs on this machine, as the same user.

    Args:
        name: as `hil-bench ctl list` shows it; not needed where only one bench runs.
        timeout: longest wait for an answer [s].

    Returns:
        The bench, to be used as a context manager. `BusError`: no such bench runs. `ConfigError`:
        several run, and none is named.
    """
    return AttachedBench(connect(name, timeout), timeout)


class AttachedObjects:
    """The objects of a node of an attached bench: ``bench.nodes["io"]["0x6401.01"] = 1234``.

    Or the signals of a J1939 device.

    Args:
        client: the connection.
        node: the name of the node, or of the device.
    """

    def __init__(self, client: FeedClient, node: str) -> None:
        self._client = client
        self._node = node

    def __getitem__(self, name: str) -> Value | None:
        """Return the value of an object."""
        answer = self._client.request("get_object", node=self._node, name=name)
        value: Value | None = unpack_value(answer)
        return value

    def __setitem__(self, name: str, value: Value) -> None:
        """Set an object, as the bus does or, where that may only read it, as the device does."""
        fields = {"node": self._node, "name": name, "value": pack_value(value)}
        self._client.request("set_object", **fields)


class AttachedRecording:
    """A recording that was begun from here; as a context manager it ends with the block.

    Args:
        client: the connection to its bench.
        path: of the file.

    Attributes:
        path: as passed in.
        content: once it has ended: rows, frames, end [s], problem, and lost messages.
    """

    def __init__(self, client: FeedClient, path: Path) -> None:
        self.path = path
        self.content: dict[str, Any] | None = None
        self._client = client

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> dict[str, Any]:
        """End it, and return what its file holds."""
        if self.content is None:
            self.content = self._client.request("stop_recording")
        return self.content


class AttachedBench:
    """A bench that runs in another process.

    Every command acts at the start of the bench's next tick, and its method returns after that.
    `ConfigError`: the bench refuses it. `BusError`: the bench has ended. `WaitTimeoutError`: its
    time stands still, as where a controller lets it pass and waits.

    Args:
        client: the connection.
        timeout: longest wait for an answer [s].

    Attributes:
        name: of the bench.
        channels: what `latest` and `rows` have beside the time.
        nodes: the objects of each node by the node's name.
        ecus: the signals of each J1939 device by its name: ``bench.ecus["joystick"]["x"] = 50``.
    """

    def __init__(self, client: FeedClient, timeout: float = TIMEOUT) -> None:
        self.name = client.name
        self.channels = tuple(Channel(*channel) for channel in client.hello["channels"])
        names = client.hello["nodes"]
        self.nodes: Mapping[str, AttachedObjects] = {
            name: AttachedObjects(client, name) for name in names
        }
        self.ecus: Mapping[str, AttachedObjects] = {
            name: AttachedObjects(client, name) for name in client.hello.get("ecus", {})
        }
        self._client = client
        self._timeout = timeout

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - of any ability
        """Return an attribute that an ability brings, as `faults`.

        Raises:
            AttributeError: no ability brings it.
        """
        for module in given_to("attached") if not name.startswith("_") else ():
            if name in module.ATTRIBUTES:
                return module.ATTRIBUTES[name](self._client)
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Disconnect from the bench, which keeps running; active faults stay."""
        self._client.close()

    def status(self) -> dict[str, Any]:
        """Return the states of nodes, the faults, the newest values and how the loop is.

        See docs/watching.md.
        """
        status: dict[str, Any] = self._client.request("status")
        return status

    def latest(self) -> dict[str, float]:
        """Return the newest value of each channel in its SI unit, and the `time` [s].

        They are up to 0.1 s old.
        """
        return _floats(self.status()["values"] or {})

    def set_plant(self, axis: str, quantity: str, value: float) -> None:
        """Set what acts on a plant, as in ``set_plant("axis1", "load", 5000.0)``.

        Args:
            axis: the name of the axis.
            quantity: "load" [N] or "supply_pressure" [Pa] of a cylinder.
            value: in SI; it holds until it is set again.
        """
        self._client.request("set_plant", axis=axis, quantity=quantity, value=value)

    def mark(self, text: str) -> None:
        """Mark this moment in the journal, for everyone who watches."""
        self._client.request("mark", text=text)

    def record(self, path: Path | str) -> AttachedRecording:
        """Begin a recording, until its `stop` or the end of the bench.

        Args:
            path: its suffix is its format, as of ``hil-bench run --record``.
        """
        absolute = Path(path).absolute()
        self._client.request("start_recording", path=str(absolute))
        return AttachedRecording(self._client, absolute)

    def journal(self) -> list[dict[str, Any]]:
        """Return the commands that have acted, the oldest first; see docs/watching.md."""
        entries: list[dict[str, Any]] = self._client.request("journal")["entries"]
        return entries

    def stop(self) -> None:
        """End the run in order."""
        self._client.request("stop")

    def rows(self, every: float = 0.0) -> Iterator[dict[str, float]]:
        """Yield rows as the bench makes them, from now until it ends.

        Each iterator has a connection of its own. One that falls too far behind misses rows: the
        bench waits for nobody.

        Args:
            every: least bench time between two rows [s]; 0 for every tick.

        Yields:
            The value of each channel in its SI unit, and the `time` [s].
        """
        names = ["time", *(channel.name for channel in self.channels)]
        for message in self.messages(rows_every_s=every):
            for row in message.get("rows", ()):
                yield _floats(dict(zip(names, row, strict=True)))

    def messages(
        self, *, rows_every_s: float | None = None, frames: bool = False
    ) -> Iterator[dict[str, Any]]:
        """Yield the messages of the feed, from now until the bench ends; see docs/watching.md.

        Args:
            rows_every_s: least bench time between two rows [s]; 0 for every tick, None for no rows.
            frames: whether to hear the frames of the bus.

        Yields:
            Each message as it is in JSON.
        """
        with connect(self.name, self._timeout) as client:
            client.request("watch", rows_every_s=rows_every_s, frames=frames)
            with contextlib.suppress(BenchEndError):
                while True:
                    message = client.receive(_WAIT)
                    if message is not None:
                        yield message


def _floats(values: Mapping[str, float | None]) -> dict[str, float]:
    """Return values with NaN where JSON has none."""
    return {name: float("nan") if value is None else value for name, value in values.items()}
