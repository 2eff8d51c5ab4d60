"""`explain` on broken logs of known cause, and on sound ones.

Each log is made by the bench: its description is the function's docstring. The cause is what the
function does, so nothing here is taken from what `explain` says.
"""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import broken_messages, broken_nodes, broken_protection
from support.sdo_frames import MS, download, heard, upload
from support.sound_logs import SOUND

from device_profiles import PRESSURE_404
from hil_bench.abilities.eyes.explain.explain import explain
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import LoggedFrame

BITRATE = 1_000_000

BROKEN = {**broken_nodes.BROKEN, **broken_messages.BROKEN, **broken_protection.BROKEN}


@pytest.mark.parametrize("name", BROKEN)
def test_the_cause_of_a_broken_log_is_found_first(name):
    case = BROKEN[name]
    frames, known = case.make()
    found = explain(frames, known, BITRATE).findings
    assert found
    assert (found[0].cause, found[0].node) == (case.cause, case.node), found


@pytest.mark.parametrize("name", SOUND)
def test_nothing_is_found_in_a_sound_log(name):
    frames, known = SOUND[name]()
    assert explain(frames, known, BITRATE).findings == ()


def test_a_pdo_is_judged_by_the_event_timer_that_it_has():
    frames = [
        Frame(0x702, b"\0"),
        Frame(0x000, b"\x01\x02"),
        *[Frame(0x182, bytes(5))] * 5,
        *download(2, 0x1800, 5, struct.pack("<H", 400)),
        Frame(0x182, bytes(5)),
    ]
    logged = heard(*frames, step=10 * MS)
    logged[-1] = logged[-1]._replace(now=logged[-1].now + 300 * MS)
    known = [KnownNode(2, "pressure", load_eds(PRESSURE_404, 2))]
    assert explain(logged, known, BITRATE).findings == ()
    without = [each for each in logged if each.frame.can_id not in {0x602, 0x582}]
    (finding,) = explain(without, known, BITRATE).findings  # 10 ms by the EDS
    assert finding.cause is Cause.PDO_MISSING


def findings_of(*frames, end=0, known=()):
    """Explain frames of given times [ms], and a heartbeat of node 9 at an end."""
    frames = sorted(frames, key=lambda each: each[0])
    if end:
        frames.append((end, Frame(0x709, b"\x05")))
    logged = [LoggedFrame(frame, time * MS, None) for time, frame in frames]
    return explain(logged, list(known), BITRATE).findings


@pytest.mark.parametrize(
    ("of_eds", "causes"), [(0, []), (None, []), (0x123, []), (0x124, [Cause.OTHER_DEVICE])]
)
@pytest.mark.parametrize("subindex", [1, 2, 3])
def test_an_identity_is_compared_where_the_eds_gives_one(subindex, of_eds, causes):
    """The device says 0x123 as vendor, product or revision (0x1018, CiA 301)."""
    objects = load_eds(PRESSURE_404, 2)
    objects.variable(0x1018, subindex).default = of_eds
    logged = heard(*upload(2, 0x1018, subindex, struct.pack("<I", 0x123)))
    found = explain(logged, [KnownNode(2, "pressure", objects)], BITRATE).findings
    assert [each.cause for each in found] == causes


STARTED = [(0, Frame(0x702, b"\0")), (1, Frame(0x000, b"\x01\x02")), (2, Frame(0x702, b"\x05"))]


def sensor():
    """The transducer, whose EDS gives TPDO1 the event timer 10 ms."""
    return KnownNode(2, "pressure", load_eds(PRESSURE_404, 2))


@pytest.mark.parametrize(("gap", "causes"), [(30, []), (31, [Cause.PDO_MISSING])])
def test_a_pdo_is_missing_after_more_than_three_of_its_periods(gap, causes):
    pdos = [(time, Frame(0x182, bytes(5))) for time in (10, 20, 20 + gap)]
    found = findings_of(*STARTED, *pdos, known=[sensor()])
    assert [each.cause for each in found] == causes
    assert all(each.text.endswith("; its event timer is 10 ms") for each in found)


@pytest.mark.parametrize(("left", "causes"), [(False, [Cause.PDO_MISSING]), (True, [])])
def test_a_pdo_is_due_from_the_start_of_its_node_until_it_leaves_operational(left, causes):
    stop = [(10, Frame(0x000, b"\x80\x02")), (11, Frame(0x702, b"\x7f"))] if left else []
    found = findings_of(*STARTED, *stop, end=200, known=[sensor()])
    assert [each.cause for each in found] == causes
    assert not any(each.unshown for each in found)  # no frame shows that none came


@pytest.mark.parametrize(("heartbeat_ms", "causes"), [(0, []), (500, [Cause.NO_BOOT_UP])])
def test_a_node_that_is_never_heard_is_missed_where_it_has_a_heartbeat(heartbeat_ms, causes):
    """0x1017 is the producer heartbeat time; the bus is alive, and nobody asks for the node."""
    known = sensor()
    known.objects.variable(0x1017, 0).value = heartbeat_ms
    found = findings_of((0, Frame(0x709, b"\x05")), end=2000, known=[known])
    assert [each.cause for each in found] == causes


def test_an_emcy_counts_as_report_of_its_own_node_only():
    frames, known = BROKEN["controller_that_pauses"].make()
    (finding,) = explain(frames, known, BITRATE).findings
    assert "valve reports it by EMCY" in finding.text
    others = [
        each._replace(frame=each.frame._replace(can_id=0x082))
        if each.frame.can_id == 0x081
        else each
        for each in frames
    ]
    found = {each.cause: each for each in explain(others, known, BITRATE).findings}
    assert "reports it" not in found[Cause.RPDO_TIMEOUT].text


@pytest.mark.parametrize(("last", "causes"), [(0x05, []), (0x7F, [Cause.START_REFUSED])])
def test_a_node_that_obeys_late_has_obeyed(last, causes):
    beats = [(time, Frame(0x702, b"\x7f")) for time in (500, 1500, 2000)]
    boot, start = (0, Frame(0x702, b"\0")), (100, Frame(0x000, b"\x01\x02"))
    found = findings_of(boot, start, *beats, (2500, Frame(0x702, bytes([last]))))
    assert [each.cause for each in found] == causes


@pytest.mark.parametrize(
    ("index", "causes"), [(0x1017, []), (0x1018, [Cause.HEARTBEAT_LOST])], ids=["1017", "other"]
)
def test_a_heartbeat_that_a_client_switched_off_is_not_lost(index, causes):
    """The producer heartbeat time, 0x1017, is set to 0 and later to 100 ms again."""
    times = [*range(0, 1000, 100), *range(3000, 4000, 100)]
    beats = [(time, Frame(0x705, b"\x7f")) for time in times]
    writes = [
        (begin + place, frame)
        for begin, value in ((950, b"\0\0"), (2950, b"\x64\0"))
        for place, frame in enumerate(download(5, index, 0, value))
    ]
    assert [each.cause for each in findings_of(*beats, *writes)] == causes


@pytest.mark.parametrize(("boots", "more"), [([0, 500], ""), ([0, 500, 900], ", and once more")])
def test_restarts_are_counted(boots, more):
    (finding,) = findings_of(*((time, Frame(0x702, b"\0")) for time in boots))
    assert finding.text.startswith(f"node 2 restarts by itself at 0.500 s{more}: its supply")


@pytest.mark.parametrize(("waited", "causes"), [(1601, [Cause.NOT_STARTED]), (1600, [])])
def test_a_node_is_forgotten_a_second_after_its_last_boot_up(waited, causes):
    boots = [(0, Frame(0x702, b"\0")), (10, Frame(0x703, b"\0")), (600, Frame(0x702, b"\0"))]
    boots.append((500, Frame(0x000, b"\x81\x02")))
    started = [(11, Frame(0x000, b"\x01\x03")), (12, Frame(0x703, b"\x05"))]
    found = findings_of(*boots, *started, (waited, Frame(0x703, b"\x05")))
    assert [each.cause for each in found] == causes


def syncs(times, counters=None):
    return [
        (time, Frame(0x080, bytes([counter]) if counters else b""))
        for time, counter in zip(times, counters or times, strict=True)
    ]


@pytest.mark.parametrize(
    ("frames", "end", "text"),
    [
        # A controller may take a second to end, in whatever order it does.
        (syncs(range(0, 100, 10)), 1090, ""),
        (syncs(range(0, 100, 10)), 1091, "SYNC stops at 0.090 s (every 10 ms before)"),
        ([*syncs(range(0, 100, 10)), (500, Frame(0x000, b"\x02\x00"))], 9000, ""),
        (
            [*syncs(range(0, 100, 10)), (500, Frame(0x000, b"\x02\x03"))],
            9000,
            "SYNC stops at 0.090 s (every 10 ms before)",
        ),
        (
            syncs([*range(0, 100, 10), 120, 130, 150]),
            160,
            "no SYNC for 30 ms after 0.090 s (every 10 ms); 2 such gaps",
        ),
        (syncs([*range(0, 100, 10), 105]), 110, ""),
        (syncs([*range(0, 100, 10), 105, 110]), 120, ""),  # two intervals, 15 and 5 ms
        (
            syncs(range(0, 80, 10), [238, 239, 240, 1, 2, 5, 6, 8]),
            90,
            "the SYNC counter jumps 2 times: frames lost, or two producers",
        ),
        (syncs(range(0, 80, 10), [1, 2, 3, 4, 5, 6, 7, 8]), 90, ""),
    ],
)
def test_lost_syncs_are_counted(frames, end, text):
    found = findings_of(*frames, end=end)
    assert [each.text for each in found] == ([text] if text else [])


@given(
    st.lists(
        st.builds(
            Frame,
            st.one_of(st.integers(0, 0x7FF), st.sampled_from([0x602, 0x582, 0x182, 0x702, 0x80])),
            st.binary(max_size=8),
            st.booleans(),
        ),
        max_size=60,
    ),
    st.booleans(),
)
def test_no_frames_make_it_stumble(frames, are_known):
    nodes = [KnownNode(2, "pressure", load_eds(PRESSURE_404, 2))] if are_known else []
    logged = [LoggedFrame(frame, 100 * MS * n, None) for n, frame in enumerate(frames)]
    assert explain(logged, nodes, BITRATE).frames == len(frames)


@pytest.mark.parametrize("name", ["motion_with_sync", "motion_with_pdos_on_event"])
def test_a_sound_log_that_merely_ends_has_no_finding(name):
    frames, nodes = SOUND[name]()
    for count in range(100, len(frames), 151):
        assert explain(frames[:count], nodes, 1_000_000).findings == ()


@pytest.mark.parametrize("silent", [{0x080}, {0x201}, {0x080, 0x201}], ids=["SYNC", "RPDO", "both"])
def test_a_controller_that_ends_in_any_order_has_not_lost_its_sync(silent):
    """Its last frames are those of the others, for up to the 0.4 s that the log has."""
    frames, nodes = SOUND["motion_with_sync"]()
    last = frames[-1].now
    for before in (20, 100, 200, 400):
        begin = last - before * MS
        left = [each for each in frames if each.now < begin or each.frame.can_id not in silent]
        found = explain(left, nodes, 1_000_000).findings
        assert Cause.SYNC_MISSING not in {each.cause for each in found}, before


def device_type(node_id):
    return upload(node_id, 0x1000, 0, bytes(4))


def test_a_master_is_not_judged_by_its_own_broadcast():
    """Lely resets all nodes while its own heartbeat says OPERATIONAL."""
    reset = [(250, Frame(0x000, b"\x82\x00"))]
    beats = [(time, Frame(0x77F, b"\x05")) for time in range(10, 3000, 100)]
    assert findings_of(*reset, *beats) == ()
    # One that is asked by somebody else is no master, and has to obey.
    asked = [(time, frame) for time, frame in enumerate(device_type(127), 1)]
    (finding,) = findings_of(*asked, *reset, *beats)
    assert finding.cause is Cause.START_REFUSED


def late_answers(*, late=20, aborts=True):
    request, answer = device_type(4)
    frames = [(1, request), (2, answer)]  # at first it is quick
    for begin in (100, 400, 700):
        frames.append((begin, request))
        if aborts:
            frames.append((begin + 100, Frame(0x604, b"\x80\x00\x10\x00\x00\x00\x04\x05")))
        frames.append((begin + 100 + late, answer))
    return frames


def test_a_slow_server_is_slow_and_no_twin():
    (finding,) = findings_of(*late_answers(), end=1500)
    assert finding.cause is Cause.SDO_LATE
    assert finding.text == (
        "node 4 answers 20 ms after its client has given up, at 0.219 s, and 2 times more: it is "
        "slow, or the client's time-out short"
    )
    assert findings_of(*late_answers(aborts=False), end=1500) == ()


def test_two_answers_to_one_request_are_still_of_two():
    request, answer = device_type(4)
    (finding,) = findings_of((1, request), (2, answer), (3, answer), end=1500)
    assert finding.cause is Cause.NODE_ID_CLASH


def test_a_scan_of_all_node_ids_is_no_fault():
    """As python-canopen's scanner does it: 1000h of each, without an abort."""
    frames = [(node, device_type(node)[0]) for node in range(1, 128)]
    frames.append((128, device_type(9)[1]))
    assert findings_of(*frames, end=3000) == ()
    # One that is asked again and again is missed, in a scan too.
    again = [(200 + number * 10, device_type(50)[0]) for number in range(3)]
    (finding,) = findings_of(*frames, *again, end=3000)
    assert (finding.cause, finding.node) == (Cause.NO_BOOT_UP, "node 50")


@pytest.mark.parametrize(
    ("place", "code", "causes"),
    [
        ("00 20 03", "30 00 09 06", [Cause.SDO_ABORT]),
        ("18 10 04", "11 00 09 06", []),  # somebody looks whether there is a serial number
    ],
)
def test_an_abort_of_a_transfer_that_began_before_the_log_is_one(place, code, causes):
    """0609 0030h is a value beyond its range, 0609 0011h a sub-index that does not exist."""
    beats = [(time, Frame(0x704, b"\x05")) for time in range(0, 1500, 100)]
    abort = 50, Frame(0x584, bytes.fromhex(f"80 {place} {code}"))
    found = findings_of(*beats, abort)
    assert [each.cause for each in found] == causes
    assert all("node 4: transfer of 0x2000.03 aborted, 0x06090030" in each.text for each in found)


def test_pdos_that_stay_out_together_are_told_once():
    """Their last ones are at 492, 496 and 499 ms: the third is 7 ms later than the first."""

    def cycle(node, begin, end):
        return [(time, Frame(0x180 + node, bytes(5))) for time in range(begin, end, 10)]

    nodes = {2: 12, 3: 16, 4: 19}
    known = [KnownNode(node, f"sensor {node}", load_eds(PRESSURE_404, node)) for node in nodes]
    frames = []
    for node, first in nodes.items():
        frames += [(1, Frame(0x700 + node, b"\0"))]
        frames += [*cycle(node, first, 500), *cycle(node, 700 + node, 1000)]
    found = findings_of((5, Frame(0x000, b"\x01\x00")), *frames, known=known)
    assert {each.cause for each in found} == {Cause.PDO_MISSING}
    assert [each.text.partition("; at the same time")[2] for each in found] == [" sensor 3", ""]
