"""Objects that may be written for a moment, and what they hold afterwards."""

import contextlib
from collections.abc import Callable, Iterator

from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable, Refused
from hil_bench.abilities.conformance.wire import code_text
from hil_bench.canopen_device.datatypes import VISIBLE_STRING
from hil_bench.canopen_device.object_dictionary import Variable
from hil_bench.config.objects import name_object

HARMLESS = ((0x1017, 0), (0x1015, 0), (0x100C, 0), (0x1016, 1))
"""Times that may be changed for a moment without anything moving."""

_NO_SUCH_TEXT = frozenset(
    {0x05040005, 0x06040047, 0x06070010, 0x06070012, 0x06070013, 0x06090030, 0x08000020}
)
"""Aborts by which a device may refuse a text: no memory for it, its length, what it says."""


@contextlib.contextmanager
def restored(dut: DeviceUnderTest, variable: Variable) -> Iterator[None]:
    """Restore an object that is written meanwhile, whatever transfer is then under way."""
    before = dut.sdo.upload(*variable.key)
    try:
        yield
    finally:
        dut.sdo.abort()
        dut.sdo.download(*variable.key, before)


@contextlib.contextmanager
def scratch(dut: DeviceUnderTest) -> Iterator[Variable]:
    """Restore a number that is written meanwhile.

    Yields:
        One whose change moves nothing.

    Raises:
        NotApplicable: there is none.
    """
    for key in HARMLESS:
        variable = dut.objects.find(*key)
        if variable is not None and variable.access.writable:
            with restored(dut, variable):
                yield variable
            return
    raise NotApplicable("the EDS has no time of the communication profile that can be written")


@contextlib.contextmanager
def long_scratch(dut: DeviceUnderTest) -> Iterator[Variable]:
    """Restore an object without a fixed length that is written meanwhile.

    Yields:
        One.

    Raises:
        NotApplicable: there is none.
    """
    for variable in dut.objects:
        if (
            variable.data_type.size == 0
            and variable.access.writable
            and variable.access.readable
            and variable.index >= 0x2000
            and variable.data_type.name != "UNICODE_STRING"
        ):
            with restored(dut, variable):
                yield variable
            return
    raise NotApplicable("the EDS has no string or domain that can be written")


@contextlib.contextmanager
def unchanged(dut: DeviceUnderTest, variable: Variable) -> Iterator[None]:
    """Judge that an object still holds what it held."""
    before = dut.number(*variable.key)
    yield
    expect_number(dut, variable, before)


def write_what_fits(
    dut: DeviceUnderTest, variable: Variable, wish: bytes, write: Callable[[bytes], None]
) -> bytes:
    """Write a text and return it; where the device takes none so long, or none so, another one.

    A device may bound its texts, have them of one length, or ask for a certain form.

    Args:
        dut: the device.
        variable: the object.
        wish: the text to try first.
        write: writes a text, and raises `Refused` where the device aborts.

    Raises:
        NotApplicable: it took neither the text nor the beginning of it, nor what is there already.
        Refused: an abort that says nothing about the text.
    """
    present = dut.sdo.upload(*variable.key)
    refusals = []
    for raw in (wish, wish[:15], wish[:8], present):
        if not raw:
            continue
        try:
            write(raw)
        except Refused as refused:
            if refused.code not in _NO_SUCH_TEXT:
                raise
            dut.sdo.abort()
            refusals.append(f"{len(raw)} bytes: {code_text(refused.code)}")
        else:
            return raw
    name = name_object(*variable.key)
    raise NotApplicable(f"{name} takes no text of this suite ({', '.join(refusals)})")


def expect_text(dut: DeviceUnderTest, variable: Variable, right: bytes) -> None:
    """Judge what a text holds; a string of a fixed length may be filled up with zeros.

    Raises:
        Deviation: something else.
    """
    found = dut.sdo.upload(*variable.key)
    is_filled = variable.data_type is VISIBLE_STRING and found.rstrip(b"\0") == right.rstrip(b"\0")
    if found != right and not is_filled:
        raise Deviation(f"{name_object(*variable.key)}: other bytes are read than were written")


def expect_number(dut: DeviceUnderTest, variable: Variable, right: int) -> None:
    """Judge what a number is.

    Raises:
        Deviation: another one.
    """
    found = dut.number(*variable.key)
    if found != right:
        raise Deviation(f"{name_object(*variable.key)} is {found}; {right} is right")
