"""Commands at the door of a running bench: set an object or a plant's influence, mark, stop."""

from dataclasses import dataclass

from hil_bench.bench.commands import Controls
from hil_bench.canopen_device.datatypes import Value
from hil_bench.errors import ConfigError
from hil_bench.plants.plant import Influence


@dataclass(frozen=True, slots=True)
class SetObject:
    """Set an object of a node, or a signal of a J1939 device.

    As ``bench.nodes["io"]["0x6401.01"] = 1234`` and ``bench.ecus["joystick"]["x"] = -50`` do.

    Attributes:
        node: the name of the node, or of the device.
        name: of the object: "0x6401.01"; or of the signal.
        value: what it is to hold.
    """

    node: str
    name: str
    value: Value

    def act(self, controls: Controls, now: int) -> Value | None:  # noqa: ARG002 - Command's
        """Set it; return what it holds now. `ConfigError` where it cannot."""
        objects = controls.device(self.node)
        objects[self.name] = self.value
        return objects[self.name]


@dataclass(frozen=True, slots=True)
class SetPlant:
    """Set what acts on a plant from outside, of a cylinder its load or its supply pressure.

    Attributes:
        axis: the name of the axis.
        quantity: one of the influences of its plant.
        value: in SI; it holds until it is set again.
    """

    axis: str
    quantity: str
    value: object

    def act(self, controls: Controls, now: int) -> None:  # noqa: ARG002 - Command's
        """Set it for this tick and the following ones.

        Raises:
            ConfigError: no such axis or quantity, or a value that cannot be.
        """
        bench = controls.bench
        names = [axis.name for axis in bench.axes]
        if self.axis not in names:
            right = ", ".join(names) or "this bench has none"
            raise ConfigError(f'axis "{self.axis}": there is no such axis; there is: {right}')
        axis = bench.axes[names.index(self.axis)]
        for influence in axis.influences:
            if influence.name == self.quantity:
                axis.plant.influence(influence.name, self._bounded(influence))
                return
        known = " or ".join(f'"{influence.name}"' for influence in axis.influences)
        right = f"give {known}" if known else "this plant takes nothing from outside"
        raise ConfigError(f"{self.axis}.{self.quantity}: cannot be set; {right}")

    def _bounded(self, influence: Influence) -> float:
        """Return the value.

        Raises:
            ConfigError: it is not a number, or out of range.
        """
        low, high = influence.low, influence.high
        if not (isinstance(self.value, (int, float)) and low <= self.value <= high):
            right = f"give {low:g} to {high:g} {influence.unit}"
            raise ConfigError(f"{self.axis}.{self.quantity} = {self.value!r}: {right}")
        return float(self.value)


@dataclass(frozen=True, slots=True)
class Mark:
    """Mark a moment of the run.

    Attributes:
        text: what for, in words.
    """

    text: str

    def act(self, controls: Controls, now: int) -> None:
        """Do nothing: the journal has it."""


@dataclass(frozen=True, slots=True)
class Stop:
    """End the run in order, with this tick."""

    def act(self, controls: Controls, now: int) -> None:  # noqa: ARG002 - Command's
        """Let the runner know."""
        controls.is_over = True
