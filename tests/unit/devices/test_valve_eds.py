"""The valve on other makers' EDS files: other objects, another reference value."""

import pytest
from support.valves import ACTIVE, FULL_OPENING, HOLD, control, fit_valve, status

from device_profiles import VALVE_408
from hil_bench.devices.valve_408 import ValveDevice
from hil_bench.errors import EdsError

PDOS = range(0x1400, 0x1C00)


@pytest.mark.parametrize("index", [0x6040, 0x6041, 0x6300, 0x6301])
def test_an_eds_without_a_needed_object_is_refused(make_rig, index):
    rig = make_rig(VALVE_408, without={*PDOS, index})
    with pytest.raises(EdsError, match=rf"valve_408\.eds: object 0x{index:04X}"):
        ValveDevice(rig.node, FULL_OPENING)


OPTIONAL = {0x6042, 0x6043, 0x604E, 0x604F, 0x6310, 0x6311, 0x6314, 0x6320, 0x6321, 0x6350}


def test_the_smallest_object_set_works(make_rig):
    rig = fit_valve(make_rig(VALVE_408, without=OPTIONAL))
    rig.nmt(rig.START)
    control(rig, 0x0007, 32767)
    assert (status(rig), rig.spool) == (ACTIVE, pytest.approx(32767 / 16384 * 1e-3))
    control(rig, 0x0003, 32767)
    assert (status(rig), rig.spool) == (HOLD, 0.0)


@pytest.fixture
def edited_eds(tmp_path):
    """Another maker's EDS: ours with one text replaced."""

    def edit(old, new):
        text = VALVE_408.read_text()
        assert text.count(old) == 1
        path = tmp_path / "other.eds"
        path.write_text(text.replace(old, new))
        return path

    return edit


REFERENCE = (
    "[6311sub1]\nParameterName=Spool reference value\n"
    "ObjectType=0x7\nDataType=0x0003\nAccessType=rw\nLowLimit=1\nHighLimit=32767\n"
)
UNLIMITED = REFERENCE[: REFERENCE.index("LowLimit")]


def test_another_reference_value_scales_setpoint_and_actual_value(make_rig, edited_eds):
    eds = edited_eds(f"{REFERENCE}DefaultValue=16384", f"{REFERENCE}DefaultValue=10000")
    rig = fit_valve(make_rig(eds))
    rig.nmt(rig.START)
    control(rig, 0x0007, 2500)
    assert rig.spool == 0.25e-3
    assert rig.value(0x6301, 1) == 2500


def test_a_reference_value_of_zero_is_refused(make_rig, edited_eds):
    eds = edited_eds(f"{REFERENCE}DefaultValue=16384", f"{UNLIMITED}DefaultValue=0")
    with pytest.raises(EdsError, match=r"object 0x6311\.01"):
        ValveDevice(make_rig(eds).node, FULL_OPENING)


def test_a_reference_value_has_a_limit_where_the_eds_gives_none(make_rig, edited_eds):
    eds = edited_eds(REFERENCE, UNLIMITED)
    rig = fit_valve(make_rig(eds))
    rig.nmt(rig.START)
    assert rig.write(0x6311, 1, 0, 2) == 0x06090032
    assert rig.write(0x6311, 1, 8192, 2) is None
    control(rig, 0x0007, 8192)
    assert rig.spool == 1e-3
    rig.nmt(rig.RESET_NODE)
    rig.tick()
    rig.nmt(rig.START)
    control(rig, 0x0007, 8192)
    assert rig.spool == 0.5e-3


def test_a_wrong_data_type_is_refused(make_rig, edited_eds):
    unsigned = REFERENCE.replace("0x0003", "0x0006")
    with pytest.raises(
        EdsError, match=r"0x6311\.01 \(Spool reference value\) is UNSIGNED16; .* INTEGER16"
    ):
        ValveDevice(make_rig(edited_eds(REFERENCE, unsigned)).node, FULL_OPENING)
