"""The integer sets of a CiA 404 channel: REAL32 objects once more as scaled integers.

The first digit of an index tells the format: 0x6xxx REAL32, 0x7xxx INTEGER16, 0x8xxx INTEGER24,
0x9xxx INTEGER32. The integers are the REAL32 value times 10^(0x6132). What is too large for a
format shows as its lowest value there; so does a value that is none.

A parameter (scaling points, input offset, interrupt delta and limits, span) is one value in all
formats: what is written to one is shown by the others, and what one refuses they all refuse.

Source: HYDAC VFL protocol description (objects 71xxh and 91xxh beside 61xxh). Of the INTEGER24
set this device has the process value alone.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, Final

from hil_bench.canopen_device.datatypes import INTEGER16, INTEGER24, INTEGER32, DataType
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable
from hil_bench.devices.profile_objects import required
from hil_bench.devices.saturation import nearest

FORMATS: Final[tuple[tuple[int, DataType], ...]] = (
    (0x1000, INTEGER16),
    (0x2000, INTEGER24),
    (0x3000, INTEGER32),
)
"""How far each set is above the REAL32 objects, and its data type."""

_PARAMETERS: Final = (*range(0x6120, 0x6125), *range(0x6133, 0x6136), 0x6148, 0x6149)


class _Face:
    """A value in one format."""

    __slots__ = ("highest", "lowest", "variable")

    def __init__(self, variable: Variable) -> None:
        self.variable = variable
        self.lowest = int(variable.data_type.low or 0)
        self.highest = int(variable.data_type.high or 0)


class IntegerFaces:
    """One value in the integer formats that the device has of it."""

    def __init__(self, od: ObjectDictionary, index: int, channel: int) -> None:
        """Bind the objects; EdsError where one is of a wrong kind.

        Args:
            od: that of the sensor.
            index: of the REAL32 object.
            channel: sub-index.
        """
        self.variables = tuple(
            required(od, index + above, channel, data_type)
            for above, data_type in FORMATS
            if od.find(index + above, channel) is not None
        )
        self._faces = tuple(_Face(variable) for variable in self.variables)

    def show(self, value: float, decimals: int) -> None:
        """Show a finite value; `decimals` is a power of ten."""
        scaled = nearest(value * decimals)
        shown: Any = scaled  # made an object once for all formats
        for face in self._faces:
            if face.lowest <= scaled <= face.highest:
                face.variable.value = shown
            else:
                face.variable.value = face.lowest

    def show_none(self) -> None:
        """Show that there is no value."""
        for face in self._faces:
            face.variable.value = face.lowest


class IntegerParameters:
    """The parameters of one channel in the integer formats.

    Args:
        od: object dictionary of the sensor.
        channel: sub-index.
        digits: 0x6132 of the channel.
    """

    def __init__(self, od: ObjectDictionary, channel: int, digits: Variable) -> None:
        self._digits = digits
        self._faces: list[tuple[Variable, IntegerFaces]] = []
        for index in _PARAMETERS:
            real = od.find(index, channel)
            faces = IntegerFaces(od, index, channel)
            if real is not None and faces.variables:
                self._join(real, faces)
        digits.add_hook(self.show)

    def _join(self, real: Variable, faces: IntegerFaces) -> None:
        self._faces.append((real, faces))
        for face in faces.variables:
            # As a check, so that what the REAL32 object refuses is refused here too.
            face.add_check(partial(self._write, real))
        real.add_hook(partial(self._show, faces))

    def show(self, _written: float = 0.0) -> None:
        """Show what the REAL32 objects hold at present."""
        for real, faces in self._faces:
            self._show(faces, real.value)

    def _show(self, faces: IntegerFaces, value: float) -> None:
        faces.show(value, 10**self._digits.value)

    def _write(self, real: Variable, scaled: int) -> None:
        real.write(scaled / 10**self._digits.value)


def mapped_values(channel: int) -> Sequence[tuple[int, int]]:
    """Return the objects by which a TPDO may carry the process value of a channel."""
    indices = (0x6130, *(0x6130 + above for above, _ in FORMATS), 0x6140)
    return [(index, channel) for index in indices]
