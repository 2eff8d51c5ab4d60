"""The measuring range and the identification of the encoder (CiA 406) behind a real node."""

import pytest
from support.encoders import fit_encoder, move, position

from device_profiles import ENCODER_406, IMITATIONS
from hil_bench import VirtualBench, load_config
from hil_bench.devices.encoder_406 import EncoderDevice

FIXED = 0x01000302  # profile version 3.2 in the low word, software version 1.0 above it


@pytest.fixture
def rig(make_rig):
    rig = make_rig(ENCODER_406)
    rig.device = EncoderDevice(rig.node, (-0.1, 0.3))
    move(rig, 0.0)
    return rig


def shown(rig):
    return rig.value(0x6002), rig.value(0x650A, 2), rig.value(0x650A, 3)


@pytest.mark.parametrize(
    ("step", "expected"),
    # -0.1 to 0.3 m in steps of 1 um (1000 x 0.001 um), 0.1 mm, 1 nm, and of 4 mm
    [
        (1000, (400_000, -100_000, 300_000)),
        (100_000, (4000, -1000, 3000)),
        (1, (400_000_000, -100_000_000, 300_000_000)),
        (4_000_000, (100, -25, 75)),
    ],
)
def test_the_range_counts_steps(rig, step, expected):
    assert rig.write(0x6005, 1, step, 4) is None
    assert shown(rig) == expected


def test_a_reversed_encoder_has_its_ends_the_other_way_round(rig):
    assert rig.write(0x6000, 0, 0x0008, 2) is None
    assert shown(rig) == (400_000, -300_000, 100_000)


def test_a_preset_shifts_the_position_and_not_the_range(rig):
    move(rig, 0.05)
    assert rig.write(0x6003, 0, 0, 4) is None
    assert (position(rig), rig.value(0x6509)) == (0, -50_000)
    assert shown(rig) == (400_000, -100_000, 300_000)
    assert rig.value(0x650A, 1) == 0  # the maker's own offset


def test_a_range_that_no_counter_holds_ends_with_it(make_rig):
    rig = make_rig(ENCODER_406)
    rig.device = EncoderDevice(rig.node, (-5.0, 5.0))
    rig.tick()
    assert rig.write(0x6005, 1, 1, 4) is None  # 1 nm: 10,000,000,000 steps
    assert shown(rig) == (0xFFFFFFFF, -(2**31), 2**31 - 1)


def test_it_is_back_after_a_reset(rig):
    before = shown(rig)
    rig.nmt(0x81)
    rig.tick(2)
    assert shown(rig) == before


def test_it_says_what_it_is(rig):
    assert rig.value(0x6507) == FIXED
    assert rig.value(0x6508) == 0xFFFFFFFF  # operating time: not supported


@pytest.mark.parametrize("subindex", [1, 2, 3])
def test_the_identification_is_read_only(rig, subindex):
    assert rig.write(0x650A, subindex, 0, 4) == 0x06010002


@pytest.mark.parametrize("index", [0x6002, 0x6507, 0x6508, 0x650B])
def test_the_others_are_read_only_too(rig, index):
    assert rig.write(index, 0, 0, 4) == 0x06010002


def test_a_file_that_lets_the_bus_write_the_range_takes_no_other(make_rig, tmp_path):
    eds = tmp_path / "writable.eds"
    text = ENCODER_406.read_text()
    at = text.index("[6002]")
    eds.write_text(text[:at] + text[at:].replace("AccessType=ro", "AccessType=rw", 1))
    rig = make_rig(eds)
    rig.device = EncoderDevice(rig.node, (-0.1, 0.3))
    rig.tick()
    assert rig.write(0x6002, 0, 400_000, 4) is None
    assert rig.write(0x6002, 0, 400_001, 4) == 0x06090030
    assert rig.value(0x6002) == 400_000


@pytest.mark.parametrize("eds", [ENCODER_406, IMITATIONS / "encoder_multi_sensor.eds"])
def test_on_a_bench_it_is_the_stroke_and_the_serial_number_that_of_the_node(make_file, eds):
    path = make_file(
        "bench.toml",
        "[plant.axis1]\nstroke_mm = 250.0\n"
        '[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n'
        f'[nodes.position]\nprofile = "encoder_406"\nnode_id = 4\neds = "{eds}"\n'
        "serial_number = 4711\n",
    )
    with VirtualBench(load_config(path)) as bench:
        bench.run(0.001)
        objects = bench.nodes["position"]
        assert [objects[f"0x650A.0{sub}"] for sub in (1, 2, 3)] == [0, -125_000, 125_000]
        assert (objects["0x6002"], objects["0x650B"]) == (250_000, 4711)


# Presets of the linear encoder, 0x6003 and 0x6010: the present position becomes a value.
#
# Steps: 0x6005.01 = 1000 is 1 um, so that 1 m is 1,000,000 steps.


@pytest.fixture
def plain(make_rig):
    return fit_encoder(make_rig(ENCODER_406))


@pytest.mark.parametrize(("index", "subindex"), [(0x6003, 0), (0x6010, 1)])
@pytest.mark.parametrize("preset", [0, 5000, -5000, 2147483647])
def test_a_preset_makes_the_present_position_that_value(plain, index, subindex, preset):
    move(plain, 0.25)  # 250000 steps
    assert plain.write(index, subindex, preset, 4, signed=True) is None
    assert position(plain) == preset  # at once, not only with the next tick
    assert (plain.value(0x6003), plain.value(0x6010, 1)) == (preset, preset)
    assert (plain.value(0x6509), plain.value(0x650C, 1)) == (preset - 250000, preset - 250000)
    move(plain, 0.25)
    assert position(plain) == preset
    move(plain, 0.2)
    assert position(plain) == preset - 50000


def test_presets_do_not_add_up(plain):
    move(plain, 0.1)
    assert plain.write(0x6003, 0, 7, 4) is None
    move(plain, 0.2)
    assert plain.write(0x6003, 0, 9, 4) is None
    move(plain, 0.2)
    assert (position(plain), plain.value(0x6509)) == (9, 9 - 200000)


def test_a_preset_rounds_like_the_position(plain):
    move(plain, 1.5e-6)  # 1.5 steps show as 2
    assert plain.write(0x6003, 0, 101, 4) is None
    move(plain, 1.5e-6)
    assert position(plain) == 101


def test_a_preset_counts_in_the_steps_that_are_in_force(plain):
    move(plain, 0.1)
    for index, subindex, value in ((0x6005, 1, 10000), (0x6003, 0, 50)):  # in one tick
        plain.object_dictionary.download(index, subindex, value.to_bytes(4, "little"))
    move(plain, 0.1)
    assert position(plain) == 50
    assert plain.value(0x6509) == 50 - 10000  # 0.1 m are 10000 steps of 10 um


def test_a_reversed_encoder_takes_a_preset(plain):
    assert plain.write(0x6000, 0, 0x0008, 2) is None
    move(plain, 0.1)
    assert plain.write(0x6003, 0, 1000, 4) is None
    move(plain, 0.101)
    assert position(plain) == 0  # 1 mm against the direction


def test_a_preset_beyond_the_offset_is_refused(plain):
    move(plain, -2147.0)  # -2,147,000,000 steps
    assert plain.write(0x6003, 0, 1000000, 4) == 0x06090030
    assert (position(plain), plain.value(0x6003), plain.value(0x6509)) == (-2147000000, 0, 0)


def test_the_counter_ends_after_the_offset(plain):
    move(plain, 0.0)
    assert plain.write(0x6003, 0, 2147483000, 4) is None
    move(plain, 0.000648)  # one step too far
    assert (position(plain), plain.value(0x6503)) == (2147483647, 0x0001)
    move(plain, 0.000647)
    assert (position(plain), plain.value(0x6503)) == (2147483647, 0)


def test_a_node_reset_takes_the_preset_back(plain):
    move(plain, 0.1)
    assert plain.write(0x6003, 0, 7, 4) is None
    plain.nmt(plain.RESET_NODE)
    move(plain, 0.1)
    assert (position(plain), plain.value(0x6509)) == (100000, 0)


def test_an_unsigned_preset_beyond_the_counter_is_refused(make_rig, make_file):
    # Profile files have UNSIGNED32 for 0x6003, and makers of linear encoders INTEGER32 for 0x6004.
    text = ENCODER_406.read_text(encoding="ascii")
    start = text.index("[6003]")
    eds = make_file("unsigned.eds", text[:start] + text[start:].replace("0x0004", "0x0007", 1))
    plain = fit_encoder(make_rig(eds))
    move(plain, 1000.0)  # 1,000,000,000 steps, so that the offset would fit
    assert plain.write(0x6003, 0, 2147483648, 4) == 0x06090030
    assert plain.write(0x6003, 0, 2147483647, 4) is None
    assert position(plain) == 2147483647
