"""The values of a device's objects at power-on, from its EDS file and the configuration."""

from hil_bench.bench.configuration import NodeConfig
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
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
