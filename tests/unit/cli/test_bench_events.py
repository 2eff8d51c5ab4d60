"""What is said of a bench while it runs, on a bench in virtual time."""

from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.bus_side import POSITION, SYNC, VALVE, BusSide, download_request

from hil_bench import Faults, load_config
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.canopen_device.storage import FileStorage
from hil_bench.cli.bench_events import BenchEvents, _Budget, _NodeWatch, _SyncWatch


class Watched(BusSide):
    """A bench whose events are looked for after each tick."""

    def __init__(self, **options):
        super().__init__()
        self.said = []
        self.events = BenchEvents(load_config(), self.bench, self.said.append, **options)

    def tick(self, *frames, count=1):
        sent = []
        for number in range(count):
            sent += super().tick(*(frames if number == 0 else ()))
            self.events.look(self.now)
        return sent


@pytest.fixture
def bench():
    watched = Watched()
    watched.tick(count=150)
    return watched


def test_booting_is_no_news(bench):
    assert bench.said == []


def test_states_are_said_together_with_the_time(bench):
    bench.nmt(0x01)
    bench.tick(count=100)
    # Ticks of 1 ms; looks at 1, 101 and 201 ms.
    assert bench.said == ["0.201 s: valve, pressure_a, pressure_b, position: OPERATIONAL"]


def test_a_valve_that_loses_its_controller_says_state_and_error(bench):
    bench.download(VALVE, 0x1400, 5, b"\x32\x00")  # RPDO time-out 50 ms
    bench.nmt(0x01)
    bench.command(7, 0, count=200)
    bench.said.clear()
    bench.tick(count=200)
    (said,) = bench.said
    assert said.endswith(" s: valve: FAULT_HOLD, EMCY 0x8250 (RPDO time-out)")


def test_faults_have_the_time_at_which_they_begin_and_end(bench):
    bench.bench.part(Faults).freeze("pressure_a", at=0.2105, duration=0.02)
    bench.tick(count=160)
    # The first ticks at or after 210.5 and 230.5 ms of bench time, of which tick 1 is 1 ms.
    assert bench.said == [
        "0.211 s: fault freeze pressure_a begins",
        "0.231 s: fault freeze pressure_a ends, and has changed nothing",
    ]


def test_sync_that_stays_away_is_said_and_that_it_is_back(bench):
    bench.nmt(0x01)
    for _ in range(200):
        bench.tick(SYNC)
    bench.said.clear()
    bench.tick(count=1500)
    (lost,) = bench.said
    assert " s: no SYNC for 1." in lost
    assert lost.endswith("; PDOs that wait for it stand still")
    for _ in range(150):
        bench.tick(SYNC)
    assert " s: SYNC is back after 1.5 s" in bench.said[1]


def test_in_lockstep_somebody_else_watches_sync():
    watched = Watched(watches_sync=False)
    watched.nmt(0x01)
    watched.tick(SYNC)
    watched.tick(count=3000)
    assert not any("SYNC" in line for line in watched.said)


def test_parameters_that_cannot_be_stored_are_said(bench, tmp_path):
    (tmp_path / "file").touch()
    node = bench.bench.nodes[3]
    node._store._storage = FileStorage(tmp_path / "file" / "position.parameters")
    bench.tick(download_request(POSITION, 0x1010, 1, b"save"))
    bench.tick(count=150)
    (said,) = bench.said
    assert "position: " in said
    assert said.endswith(
        "position.parameters: cannot be written: File exists; what was stored before stays"
    )


def test_a_second_device_with_our_identifiers_is_said_once(bench):
    """Boot-up messages of nodes 1 and 4, as a second bench on the bus sends them."""
    for _ in range(3):
        bench.tick(Frame(0x701, b"\0"), Frame(0x704, b"\0"), count=100)
    (line,) = bench.said
    assert line.startswith("0.201 s: valve, position: another device sends with the same ident")
    assert [node.counters.foreign_frames for node in bench.bench.nodes] == [3, 0, 0, 3]


TENTH = 100_000_000


@settings(max_examples=40)
@given(st.lists(st.tuples(st.sampled_from([0, 1, 7, 10, 40]), st.integers(0, 30)), max_size=20))
def test_twenty_lines_may_follow_one_another_and_then_one_a_second(bursts):
    """A bucket of 20 lines, of which one flows back each second; here counted in tenths."""
    said, expected, now, bucket, left_out = [], [], 0, 200, 0
    budget = _Budget(said.append)
    for pause, lines in bursts:
        now += pause
        bucket = min(200, bucket + pause)
        for number in range(lines):
            budget.say(now * TENTH, f"{now} {number}")
            if bucket <= 0:
                left_out += 1
                continue
            more = f" ({left_out} lines left out before)" if left_out else ""
            expected.append(f"{now} {number}{more}")
            bucket, left_out = bucket - 10, 0
    assert said == expected


@settings(max_examples=40)
@given(st.lists(st.tuples(st.integers(1, 12), st.sampled_from([0, 0, 0, 1])), max_size=40))
def test_sync_is_missed_after_a_second_and_once(looks):
    """Each look comes some tenths later, with a SYNC to the second node or without."""
    nodes = [SimpleNamespace(syncs=0), SimpleNamespace(syncs=0)]
    watch, now, last, is_lost = _SyncWatch(nodes), 0, None, False
    for pause, came in looks:
        now += pause
        nodes[1].syncs += came
        expected = ""
        if came:
            expected = f"SYNC is back after {(now - last) / 10:.1f} s" if is_lost else ""
            last, is_lost = now, False
        elif last is not None and now - last >= 10 and not is_lost:
            expected = f"no SYNC for {(now - last) / 10:.1f} s; PDOs that wait for it stand still"
            is_lost = True
        assert watch.change(now * TENTH) == expected


ERRORS = {0x8130: "life guard or heartbeat error", 0x8140: "recovered from bus off"}  # CiA 301


@settings(max_examples=40)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(NmtState),
            st.booleans(),
            st.frozensets(st.sampled_from(sorted(ERRORS))),
            st.integers(0, 1),
            st.sampled_from([None, "disk full", "read only"]),
        ),
        max_size=12,
    )
)
def test_what_changed_of_a_node_is_said_and_nothing_else(looks):
    node = SimpleNamespace(counters=SimpleNamespace(foreign_frames=0))
    watch = _NodeWatch("valve", node, lambda: f"device {node.state.name}")
    known, had, foreign, problem = None, frozenset(), 0, None
    for state, power, errors, frames, trouble in looks:
        node.state, node.has_power, node.errors, node.storage_problem = (
            state,
            power,
            errors,
            trouble,
        )
        node.state_name = state.name if power else "off"
        node.counters.foreign_frames += frames
        expected = []
        is_off = known is not None and not power
        if state is not NmtState.INITIALISING or is_off:
            words = [node.state_name] if is_off else [node.state_name, f"device {state.name}"]
            if known is not None:
                both = zip(words, [*known, None], strict=False)
                expected = [new for new, old in both if new != old]
            known = words
        expected += [f"EMCY 0x{code:04X} ({ERRORS[code]})" for code in sorted(errors - had)]
        expected += [f"EMCY 0x{code:04X} gone" for code in sorted(had - errors)]
        if frames and not foreign:
            foreign = 1
            expected.append("the node-ID is twice on the bus")
        if trouble not in {None, problem}:
            expected.append(trouble)
        had, problem = errors, trouble
        said = list(watch.changes())
        assert len(said) == len(expected)
        assert all(part in whole for part, whole in zip(expected, said, strict=True))
