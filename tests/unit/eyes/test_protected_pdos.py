"""PDOs with counter and checksum, as `monitor`, `explain` and `shadow` see them."""

from itertools import count

import pytest
from support.built_in_nodes import NODES
from support.bus_logs import played
from support.sdo_frames import MS, heard

from device_profiles import PRESSURE_404
from hil_bench.abilities.eyes.explain.explain import explain
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.abilities.eyes.known_node import KnownNode, nodes_of
from hil_bench.abilities.recording.frames import message_of
from hil_bench.abilities.shadow.twin import Shadow
from hil_bench.bench.configuration import load_config
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.frame import Frame
from hil_drivers.protection import crc8

BITRATE = 1_000_000
TPDO1 = 0x182


def sealed(mapped, counter):
    """What a device sends: mapped bytes, counter, checksum of identifier and all before it."""
    data = mapped + bytes([counter])
    return Frame(TPDO1, data + bytes([crc8(TPDO1.to_bytes(2, "little") + data)]))


def log(*frames):
    return heard(Frame(0x702, b"\0"), Frame(0, b"\x01\x02"), *frames, step=10 * MS)


def sensor(protected):
    return [KnownNode(2, "pressure", load_eds(PRESSURE_404, 2), protected_tpdos=protected)]


# The transducer's TPDO1 maps a REAL32 and a status byte.
GOOD = [sealed(bytes(5), number) for number in range(5)]


@pytest.mark.parametrize("protected", [(1,), None])
def test_a_protected_pdo_is_sound(protected):
    assert explain(log(*GOOD), sensor(protected), BITRATE).findings == ()


def test_where_none_is_protected_two_bytes_are_too_many():
    (finding,) = explain(log(*GOOD), sensor(()), BITRATE).findings
    assert finding.cause is Cause.PDO_LENGTH
    assert "7 bytes, and its mapping has 5" in finding.text


def test_a_wrong_checksum_is_one():
    wrong = GOOD[2]._replace(data=GOOD[2].data[:-1] + bytes([GOOD[2].data[-1] ^ 1]))
    (finding,) = explain(log(*GOOD[:2], wrong, *GOOD[3:]), sensor((1,)), BITRATE).findings
    assert finding.cause is Cause.PDO_CHECKSUM
    assert finding.text == (
        f"pressure TPDO1: checksum 0x{wrong.data[-1]:02X}, and 0x{GOOD[2].data[-1]:02X} is right"
    )


def test_a_protected_pdo_without_its_protection_is_too_short():
    plain = [Frame(TPDO1, bytes(5))] * 5
    (finding,) = explain(log(*plain), sensor((1,)), BITRATE).findings
    assert finding.cause is Cause.PDO_LENGTH
    assert "5 bytes, and its mapping with counter and checksum has 7" in finding.text


@pytest.mark.parametrize("protected", [(1,), None])
@pytest.mark.parametrize(
    ("counters", "cause", "text"),
    [
        ([5, 6, 7, 7, 8], Cause.PDO_REPEATED, "frame with counter 7 repeated at 0.050 s"),
        (
            [5, 6, 6, 6, 9],
            Cause.PDO_REPEATED,
            "counter stands at 6 from 0.040 s on, 2 frames repeated",
        ),
        ([254, 255, 2, 3, 4], Cause.PDO_LOST, "counter goes from 255 to 2 at 0.040 s, 2 sent and"),
        (
            [1, 2, 5, 6, 8],
            Cause.PDO_LOST,
            "from 2 to 5 at 0.040 s, 2 sent and not seen; once more, 3 not seen in all",
        ),
        ([9, 10, 3, 4, 5], Cause.PDO_LOST, "goes back from 10 to 3 at 0.040 s, overtaken or"),
    ],
)
def test_a_counter_that_does_not_go_on_by_one_is_one_finding(protected, counters, cause, text):
    frames = [sealed(bytes(5), number) for number in counters]
    (finding,) = explain(log(*frames), sensor(protected), BITRATE).findings
    assert finding.cause is cause
    assert text in finding.text


@pytest.mark.parametrize("protected", [(1,), None])
def test_frames_that_arrived_broken_are_not_lost(protected):
    """Of the five from 7 to 11, two were seen broken. Three of five are sealed."""
    broken = [Frame(TPDO1, bytes(7))] * 2
    frames = [sealed(bytes(5), 5), sealed(bytes(5), 6), *broken, sealed(bytes(5), 12)]
    found = {
        each.cause: each for each in explain(log(*frames), sensor(protected), BITRATE).findings
    }
    assert "from 6 to 12 at 0.060 s, 3 sent and not seen" in found[Cause.PDO_LOST].text


def test_the_counter_of_a_pdo_that_is_seldom_sealed_is_no_counter():
    by_chance = [sealed(bytes(5), 3), sealed(bytes(5), 90)]
    longer = [Frame(TPDO1, bytes(7))] * 3
    (finding,) = explain(log(*by_chance, *longer), sensor(None), BITRATE).findings
    assert finding.cause is Cause.PDO_LENGTH


def test_a_counter_may_begin_anew_after_a_reset():
    frames = [*GOOD, Frame(0x000, b"\x81\x02"), Frame(0x702, b"\0"), Frame(0, b"\x01\x02")]
    assert explain(log(*frames, *GOOD), sensor((1,)), BITRATE).findings == ()


def test_two_bytes_too_many_without_a_checksum_are_a_wrong_length():
    wrong = [Frame(TPDO1, bytes(5) + bytes([0, crc8(b"")]))] * 5
    (finding,) = explain(log(*wrong), sensor(None), BITRATE).findings
    assert finding.cause is Cause.PDO_LENGTH


@pytest.fixture
def protected_config(tmp_path):
    numbers = count()

    def load(*protected, can_id=0x184):
        objects = f'node_id = 4, objects = {{ "0x1800.01" = {can_id} }}'
        text = f"[plant.axis1]\n{NODES.replace('node_id = 4', objects)}"
        for name in protected:
            text = text.replace(f"{name} = {{", f"{name} = {{ protected_tpdos = [1],")
        path = tmp_path / f"bench{next(numbers)}.toml"
        path.write_text(text, encoding="utf-8")
        return load_config(path)

    return load


def motion(rig):
    rig.set_up(rig.valve)
    rig.network.start_node()
    rig.valve.enable()
    rig.move(1.0)


def test_a_motion_with_protected_pdos_is_sound(protected_config):
    config = protected_config("pressure_a", "position")
    frames = played(motion, config)
    assert explain(frames, nodes_of(config), BITRATE).findings == ()
    assert explain(frames, nodes_of(protected_config()), BITRATE).findings[0].cause is (
        Cause.PDO_LENGTH
    )


@pytest.mark.parametrize("can_id", [0x184, 0x1F4])
def test_the_twin_follows_protected_pdos_and_refuses_what_is_wrong(protected_config, can_id):
    config = protected_config("pressure_a", "position", can_id=can_id)
    messages = [message_of(logged) for logged in played(motion, config)]

    def residuals(spoil):
        shadow = Shadow(config, horizon=0.25)
        for message in messages:
            if spoil and message.arbitration_id == can_id:
                message.data[0] ^= 0xFF
            shadow.take(message)
        shadow.finish()
        return [window.residuals["position"] for window in shadow.windows]

    followed = residuals(spoil=False)
    assert all(each.count > 10 for each in followed)
    assert max(each.rms for each in followed) < 0.05e-3
    assert sum(each.count for each in residuals(spoil=True)) == 0
