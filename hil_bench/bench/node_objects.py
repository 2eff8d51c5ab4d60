"""The objects of a bench's nodes from Python: ``bench.nodes["io"]["0x6401.01"] = 1234``.

What the bus may write is written as the bus does, with the device's limits, checks and actions.
What the bus may only read is set as the device itself does. A change is an event for the TPDOs that
carry the object (types 0, 254 and 255), and they go with the next tick.
"""

import struct
from collections.abc import Iterable, Iterator
from numbers import Integral, Real
from typing import NoReturn

from hil_bench.bench.configuration import NodeConfig, SourceConfig
from hil_bench.canopen_device.datatypes import (
    BooleanType,
    BytesType,
    DataType,
    IntegerType,
    RealType,
    Value,
)
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import Access, Variable
from hil_bench.config.objects import find_object, name_object, parse_object
from hil_bench.config.values import quote
from hil_bench.devices.bound_objects import TpdoTrigger
from hil_bench.errors import ConfigError, SdoAbort

_SCRIPTED = "follows a script in each tick; give it none, or bend the script"


class NodeObjects:
    """The objects of one node, by their names as in the configuration: "0x6401.01", "0x1017".

    Args:
        node: the node.
        config: its configuration.
    """

    def __init__(self, node: Node, config: NodeConfig) -> None:
        self._node = node
        self._name = config.name
        self._bound = {
            **{(each.index, each.subindex): _SCRIPTED for each in config.scripts},
            **{(each.index, each.subindex): _bound_text(each) for each in config.sources},
        }

    def __iter__(self) -> Iterator[str]:
        for variable in self._node.object_dictionary:
            yield name_object(variable.index, variable.subindex)

    def __contains__(self, name: str) -> bool:
        return self._node.object_dictionary.find(*parse_object(name)) is not None

    def __getitem__(self, name: str) -> Value | None:
        """Return the present value of an object; None where it has no data."""
        value: Value | None = self._reach(name).value
        return value

    def __setitem__(self, name: str, value: Value) -> None:
        """Set an object, and let the TPDOs that carry it know where that is a change."""
        variable = self._reach(name)
        bound = self._bound.get((variable.index, variable.subindex))
        if bound is not None:
            self._refuse(variable, bound)
        if variable.access is Access.CONST:
            right = f"give it as power-on value in [nodes.{self._name}.objects]"
            self._refuse(variable, f"is const; {right}")
        try:
            new = _convert(value, variable.data_type)
        except ValueError as error:
            self._refuse(variable, str(error))
        before = variable.value
        self._set(variable, new)
        if variable.value != before:
            TpdoTrigger(self._node, (variable.index, variable.subindex)).pull()

    def _reach(self, name: str) -> Variable:
        """Return an object of a node that has power."""
        variable = self._find(name)
        if not self._node.has_power:
            self._refuse(variable, "is out of reach: the node has no power")
        return variable

    def _find(self, name: str) -> Variable:
        try:
            return find_object(self._node.object_dictionary, *parse_object(name))
        except ConfigError as error:
            raise ConfigError(f"nodes.{self._name}: {error}") from None
        except ValueError as error:
            raise ConfigError(f"nodes.{self._name}: {name} {error}") from None

    def _set(self, variable: Variable, value: Value) -> None:
        try:
            if variable.access.writable:
                variable.write(value)
            else:
                variable.check_limits(value)
                variable.value = value
        except SdoAbort as abort:
            low, high = _limits(variable)
            right = "" if low is None or high is None else f"; give {low:.9g} to {high:.9g}"
            self._refuse(variable, f"refuses {value!r}: {abort.text}{right}")

    def _refuse(self, variable: Variable, why: str) -> NoReturn:
        """Say which object refuses what.

        Raises:
            ConfigError: always.
        """
        name = name_object(variable.index, variable.subindex)
        raise ConfigError(f"nodes.{self._name}: {name} {quote(variable.name)} {why}") from None


class NodeTable(dict[str, NodeObjects]):
    """The nodes of a bench by their names; another name is a `ConfigError`."""

    def __init__(self, nodes: Iterable[Node], configs: Iterable[NodeConfig]) -> None:
        super().__init__(
            (config.name, NodeObjects(node, config))
            for node, config in zip(nodes, configs, strict=True)
        )

    def __missing__(self, name: str) -> NoReturn:
        raise ConfigError(f'nodes: there is no node "{name}"; give one of {", ".join(self)}')


def _bound_text(source: SourceConfig) -> str:
    shown = f"{source.axis}.{source.quantity}"
    return f"shows {shown} in each tick; give it no source, or disturb it by bench.faults"


def _limits(variable: Variable) -> tuple[float | None, float | None]:
    data_type = variable.data_type
    low = data_type.low if variable.low is None else variable.low
    high = data_type.high if variable.high is None else variable.high
    return low, high


def _convert(value: object, data_type: DataType) -> Value:
    """Return the value as the object holds it.

    Raises:
        ValueError: it is none of this data type.
    """
    match data_type:
        case BooleanType():
            fits, right = isinstance(value, Integral) and value in (0, 1), "True or False"
        case IntegerType():
            fits, right = isinstance(value, Integral), f"{data_type.low} to {data_type.high}"
        case RealType():
            fits, right = isinstance(value, Real), "a number"
        case BytesType():
            fits, right = isinstance(value, bytes), "bytes"
        case _:
            fits, right = isinstance(value, str), "text"
    wrong = f"is {data_type}, which cannot hold {value!r}; give {right}"
    if not fits:
        raise ValueError(wrong)
    try:
        return data_type.decode(data_type.encode(value))  # type: ignore[arg-type]
    except (OverflowError, UnicodeError, struct.error, SdoAbort):
        raise ValueError(wrong) from None
