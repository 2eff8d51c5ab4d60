"""`explain` on logs of J1939 with a known cause, and on sound ones; each is made by the bench.

The cause is what the function does, so nothing here is taken from what `explain` says.
"""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench import VirtualBench, load_config
from hil_bench.abilities.eyes.explain.explain import explain
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.abilities.eyes.known_ecu import ecus_of
from hil_bench.abilities.eyes.known_node import nodes_of
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import LoggedFrame
from hil_drivers import Network, PositionSensor
from hil_drivers.j1939 import AuxiliaryValve, J1939Port, Name

EXAMPLE = Path(__file__).parents[3] / "examples" / "j1939.toml"
BROKEN, SOUND = {}, {}
MS = 1_000_000


class Rig:
    """The example's bench, and a controller on it."""

    def __init__(self, bench):
        self.bench, self.faults = bench, bench.faults
        self.network = Network(bench.bus, clock=bench.now)
        self.port = J1939Port(self.network, Name(identity=7), 39)
        self.valve = AuxiliaryValve(self.port, 128)

    def start(self):
        self.network.pump(0.3)
        self.port.claim()
        self.valve.setup()
        self.valve.spool_setpoint = 0.5

    def say(self, can_id, data):
        self.network.send_extended(can_id, bytes.fromhex(data))


def played(play, tables=None, *, is_known=True):
    """Return the frames of a run, and what is known of its bench."""
    config = load_config(EXAMPLE, tables=tables)
    with VirtualBench(config) as bench:
        play(Rig(bench))
        frames = list(bench.frames)
    return frames, nodes_of(config) if is_known else [], [*ecus_of(config)] if is_known else []


def broken(cause, node, **options):
    def register(play):
        BROKEN[play.__name__] = cause, node, play, options
        return play

    return register


def sound(play):
    SOUND[play.__name__] = play
    return play


@broken(
    Cause.ADDRESS_CLASH,
    "joystick",
    tables={"j1939": {"joystick": {"arbitrary_address": False}}},
)
def two_devices_with_one_address(rig):
    """Another device of a smaller NAME has the joystick's address, and that may take no other."""
    rig.start()
    rig.say(0x18EEFF13, "01 00 00 00 00 00 00 00")
    rig.network.pump(1.0)


@broken(Cause.J1939_SILENT, "joystick")
def device_that_dies(rig):
    """The joystick has no power after 1 s."""
    rig.start()
    rig.network.pump(1.0)
    with rig.faults.silence("joystick"):
        rig.network.pump(3.5)


@broken(Cause.J1939_MISSING, "sensors")
def message_that_stays_out(rig):
    """The pressures stay out for 400 ms, the rest goes on."""
    rig.start()
    rig.network.pump(1.0)
    with rig.faults.lose("sensors", can_id=0x18FF108C):
        rig.network.pump(0.4)
    rig.network.pump(0.5)


@broken(Cause.J1939_MISSING, "valve")
def dm1_that_is_lost(rig):
    """A code is active, and the DM1 of each second is lost for five of them."""
    rig.start()
    with rig.faults.report("valve", spn=100, fmi=3):
        rig.network.pump(2.5)
        with rig.faults.lose("valve", can_id=0x18FECA80):
            rig.network.pump(5.0)
        rig.network.pump(1.0)


@broken(Cause.TROUBLE_CODE, "valve")
def controller_that_stops_commanding(rig):
    """No command for 600 ms, so that the valve reports SPN 1907."""
    rig.start()
    rig.network.pump(0.3)
    rig.valve._due = float("inf")
    rig.network.pump(0.6)


@sound
def motion(rig):
    """The valve is commanded, and asked for its name and component."""
    rig.start()
    rig.valve.component()
    rig.network.pump(2.0)


@sound
def motion_beside_canopen(rig):
    """The same with the encoder, on one bus."""
    rig.network.pump(0.3)
    sensor = PositionSensor(rig.network, 4)
    sensor.setup(transmission_type=255, event_timer=0.01)
    rig.network.start_node(4)
    rig.start()
    rig.network.pump(2.0)
    assert sensor.position > 0.01


@sound
def lever_that_moves(rig):
    """Nobody commands the valve; a second of the joystick."""
    rig.network.pump(1.0)


@sound
def device_that_is_restarted(rig):
    """The sensors are off for 100 ms, two of their periods, and claim again."""
    rig.start()
    with rig.faults.reset("sensors", duration=0.1):
        rig.network.pump(0.2)
    rig.network.pump(1.0)


@pytest.mark.parametrize("name", BROKEN)
def test_the_cause_of_a_broken_log_is_found_first(name):
    cause, node, play, options = BROKEN[name]
    frames, nodes, ecus = played(play, **options)

    found = explain(frames, nodes, 1_000_000, ecus).findings

    assert found
    assert (found[0].cause, found[0].node) == (cause, node), found
    assert "\n" not in found[0].text


@pytest.mark.parametrize("is_known", [True, False])
@pytest.mark.parametrize("name", SOUND)
def test_nothing_is_found_in_a_sound_log(name, is_known):
    frames, nodes, ecus = played(SOUND[name], is_known=is_known)

    assert explain(frames, nodes, 1_000_000, ecus).findings == ()


def test_devices_that_are_not_known_count_by_their_addresses():
    frames, _, _ = played(SOUND["motion"], is_known=False)

    assert "address 128" in explain(frames, [], 1_000_000).nodes


J1939_IDS = [0x18EEFF21, 0x18EA2103, 0x1CECFF21, 0x1CEBFF21, 0x1CEC2103, 0x1CEC0321, 0x1CEB2103]


def extended(time, can_id, data):
    return LoggedFrame(Frame(can_id, bytes.fromhex(data), is_extended=True), time * MS, None)


@pytest.mark.parametrize(("times", "end"), [(1, "first at 9.000 s"), (3, "at 1.000 s; 3 such")])
def test_long_messages_that_do_not_arrive_are_counted(times, end):
    """BAM of DM1, 14 bytes in 2 packets; the next frame shows that none of them came."""
    announced = [extended(n * 1000, 0x1CECFF21, "200E0002FFCAFE00") for n in range(times)]
    found = explain([*announced, extended(9000, 0x18FF1221, "00")], [], 250_000).findings
    (finding,) = [each for each in found if each.cause is Cause.J1939_TRANSFER]
    assert finding.text.endswith(end)


@pytest.mark.parametrize(("claims", "gap"), [([], "1.101 s for 900"), ([1300], "2.901 s for 800")])
def test_a_device_that_claims_again_may_pause_and_is_watched_on(claims, gap):
    """Every 100 ms, and twice too late, as another sends on. Times count from the first frame."""
    times = [*range(0, 1200, 100), *range(2000, 3000, 100), *range(3700, 4500, 100)]
    messages = [extended(time, 0x18FF1021, "00") for time in times]
    messages += [extended(time, 0x18EEFF21, "0100000000000080") for time in (-1, *claims)]
    messages += [extended(time, 0x18FF1022, "00") for time in range(50, 4500, 100)]
    found = explain(sorted(messages, key=lambda each: each.now), [], 250_000).findings
    assert [each.cause for each in found] == [Cause.J1939_MISSING]
    assert f"after {gap} ms (every 100 ms before)" in found[0].text


def test_who_has_to_yield_and_claims_on_is_named():
    """J1939-81: the smaller NAME, its bytes from the lowest on, keeps the address."""
    claims = [
        extended(250 * place, 0x18EEFF21, "0200000000000080" if place % 2 else "0300000000000000")
        for place in range(20)
    ]
    found = explain([*claims, extended(9000, 0x18FF1022, "00")], [], 250_000).findings
    (clash,) = [each for each in found if each.cause is Cause.ADDRESS_CLASH]
    assert clash.text.startswith("two claim address 33 in turns from 0.250 s on: NAME ")
    assert clash.text.endswith("8000000000000002 has to yield, and claims it 10 times")


@pytest.mark.parametrize(("waited", "causes"), [(1250, []), (1251, [Cause.J1939_REQUEST])])
def test_a_request_is_answered_within_its_time(waited, causes):
    """Address 3 asks 0x21 for PGN 65242; J1939-21 gives a response 1250 ms (T3)."""
    claims = [
        extended(0, 0x18EEFF00 | source, f"0{source % 8}00000000000080") for source in (3, 33)
    ]
    asked, answer = extended(1000, 0x18EA2103, "DAFE00"), extended(1000 + waited, 0x18FEDA21, "01")
    found = explain([*claims, asked, answer], [], 250_000).findings
    assert [each.cause for each in found] == causes
    assert [(each.node, each.others) for each in found] == [("address 3", ("address 33",))] * len(
        causes
    )


@given(
    st.lists(
        st.builds(
            Frame,
            st.one_of(st.integers(0, (1 << 29) - 1), st.sampled_from([*J1939_IDS, 0x18FECA21])),
            st.one_of(
                st.binary(max_size=8),
                st.builds(
                    lambda control, size, rest: bytes((control, size, 0, -(-size // 7))) + rest,
                    st.sampled_from([16, 17, 19, 32, 255]),
                    st.integers(0, 30),
                    st.sampled_from([b"\xff\xca\xfe\0", b"\xff\xeb\xfe\0"]),
                ),
            ),
            st.booleans(),
            is_extended=st.just(True),
        ),
        max_size=60,
    ),
    st.integers(0, 2000),
)
def test_no_frames_make_it_stumble(frames, pause):
    logged = [LoggedFrame(frame, pause * MS * n, None) for n, frame in enumerate(frames)]
    config = load_config(EXAMPLE)
    assert explain(logged, nodes_of(config), 1_000_000, ecus_of(config)).frames == len(frames)


def test_a_tool_that_asks_for_all_groups_is_one_fault_of_who_does_not_answer():
    """249 asks 15 for PGN 65024 to 65028, one each 500 ms, and is done: that is no silence."""
    frames = [extended(0, 0x18EEFF00 + each, f"{each:02X}00000000000080") for each in (15, 249)]
    frames += [extended(time, 0x18FEF10F, "FF" * 8) for time in range(0, 9000, 100)]
    frames += [extended(100 + 500 * n, 0x18EA0FF9, f"{n:02X}FE00") for n in range(5)]
    (found,) = explain(sorted(frames, key=lambda each: each.now), [], 500_000).findings
    assert (found.cause, found.total) == (Cause.J1939_REQUEST, 5)
    assert found.text == (
        "address 249: request to address 15: PGN 65024, PGN 65025, PGN 65026 and 2 more: "
        "not answered, at 0.100 s"
    )


def test_codes_that_come_at_once_are_one_fault_and_a_later_one_is_another():
    """By BAM SPN 157 FMI 3 and SPN 74 FMI 14, then SPN 102 FMI 4 alone."""
    frames = [
        extended(0, 0x18EEFF00, "0100000000000080"),
        extended(100, 0x18ECFF00, "200A0002FFCAFE00"),
        extended(150, 0x18EBFF00, "0104FF9D0003014A"),
        extended(200, 0x18EBFF00, "02000E01FFFFFFFF"),
        extended(1200, 0x18FECA00, "04FF66000401FFFF"),
    ]
    assert [each.text for each in explain(frames, [], 500_000).findings] == [
        "address 0 reports SPN 157 FMI 3, SPN 74 FMI 14, from 0.200 s on",
        "address 0 reports SPN 102 FMI 4, from 1.200 s on",
    ]


def test_the_period_of_dm1_is_the_standards_and_not_one_that_was_seen():
    """Each 2.5 s, which three periods allow, then 5 s without one."""
    frames = [extended(0, 0x18EEFF00, "0100000000000080")]
    frames += [
        extended(time, 0x18FECA00, "04FF66000401FFFF") for time in (100, 2600, 5100, 10100, 12600)
    ]
    (missing, _) = explain(frames, [], 500_000).findings
    assert missing.cause is Cause.J1939_MISSING
    assert "for 5000 ms (every 1000 ms by SAE J1939-73), while a trouble code" in missing.text
