"""A device's objects at power-on, from its EDS file and the configuration, and its periods."""

from collections.abc import Iterator
from typing import Final

from hil_bench.bench.configuration import NodeConfig
from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.agenda import MILLISECOND
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable
from hil_bench.config.objects import named_serial_number, override_defaults
from hil_bench.devices.kinds.bindings import find_bound, find_scripted
from hil_bench.errors import EdsError


def load_objects(config: NodeConfig) -> ObjectDictionary:
    """Return the objects of one device with what they hold at power-on."""
    object_dictionary = load_eds(config.eds, config.node_id)
    set_serial_number(object_dictionary, config)
    override_defaults(
        object_dictionary, config.objects, place=f"{config.place}.objects", node_id=config.node_id
    )
    for binding in config.bindings:
        find_bound(object_dictionary, binding)
    for script in config.scripts:
        find_scripted(object_dictionary, script)
    return object_dictionary


def set_serial_number(object_dictionary: ObjectDictionary, config: NodeConfig) -> None:
    """Give a device a serial number of its own, which no change of its node-ID changes.

    Raises:
        EdsError: the configuration gives one, and the device has no object for it.
    """
    variable = object_dictionary.find(0x1018, 4)
    if variable is None and config.serial_number is not None:
        raise EdsError(
            f"{object_dictionary.source}: object 0x1018.04, the serial number, is missing"
        )
    if variable is None or not isinstance(variable.default, int):
        return
    serial_number = config.serial_number
    if serial_number is None:
        of_its_own = 0 if variable.base is not None else variable.default
        serial_number = of_its_own or named_serial_number(config.name)
    variable.base = None
    variable.default = variable.value = serial_number


# The shortest period that a device can keep.
#
# A node sends once a round at most what it sends by the clock: SYNC (0x1006), its heartbeat
# (0x1017) and TPDOs by their event timers (0x18xx.05). A shorter period would be accepted and not
# kept, so it is refused. 0 switches off, and is none. Time-outs and inhibit times are not
# concerned: they say how long something takes at least, and rounds make that no shorter.

_MICROSECOND: Final = 1000
_TPDOS: Final = range(0x1800, 0x1A00)
_EVENT_TIMER: Final = 5


def limit_periods(object_dictionary: ObjectDictionary, shortest: int) -> None:
    """Refuse (0609 0030) periods that are written from now on and shorter than `shortest` [ns]."""
    for variable, unit in _periods(object_dictionary):

        def check(value: int, unit: int = unit) -> None:
            if 0 < value * unit < shortest:
                raise SdoAbort(*abort_codes.VALUE)

        variable.add_check(check)


def find_short_periods(object_dictionary: ObjectDictionary, shortest: int) -> list[Variable]:
    """Return the periods that are shorter than `shortest` [ns] at present."""
    return [
        variable
        for variable, unit in _periods(object_dictionary)
        if 0 < variable.value * unit < shortest
    ]


def _periods(object_dictionary: ObjectDictionary) -> Iterator[tuple[Variable, int]]:
    """Yield the objects that are periods, each with its unit [ns]."""
    places = [(0x1006, 0, _MICROSECOND), (0x1017, 0, MILLISECOND)]
    places += [(index, _EVENT_TIMER, MILLISECOND) for index in object_dictionary.indices(_TPDOS)]
    for index, subindex, unit in places:
        variable = object_dictionary.find(index, subindex)
        if variable is not None:
            yield variable, unit
