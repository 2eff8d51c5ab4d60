"""A machine belongs to its own controller: after a commissioning it is as it was before."""

import json
import os
from types import SimpleNamespace

import can
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil_bench import ConfigError, VirtualBench, load_config
from hil_bench.abilities.commissioning.journal import BorrowedSetting, SettingsJournal
from hil_bench.abilities.commissioning.measures import Verdict
from hil_bench.abilities.commissioning.plan import load_plan
from hil_bench.abilities.commissioning.session import Console, commission
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.devices.valve_state_machine import FAULT_STATES
from hil_drivers import Network

BENCH = "[bench]\ntick_us = 2000\nstep_us = 200\n"
PLAN = """
[plan]
period_ms = 4
[limits]
position_mm = [-150, 150]
speed_mm_s = 400
pressure_bar = [-1, 110]
[communication]
[direction]
[leakage]
duration_s = 0.2
"""
THEIRS = {
    # The settings of a controller that is not ours: by event, with time-outs, watching node 127.
    1: {
        (0x1800, 2): (254, 1),
        (0x1800, 5): (20, 2),
        (0x1400, 5): (50, 2),
        (0x1017, 0): (500, 2),
        (0x1016, 1): (127 << 16 | 300, 4),
    },
    2: {(0x1800, 2): (255, 1), (0x1800, 5): (15, 2), (0x1017, 0): (0, 2)},
    3: {(0x1800, 2): (3, 1), (0x1017, 0): (250, 2)},
    4: {(0x1800, 2): (254, 1), (0x1800, 5): (7, 2), (0x1017, 0): (1000, 2)},
}


class Machine:
    """A virtual machine that another controller has set up."""

    def __init__(self, folder):
        (folder / "plan.toml").write_text(PLAN)
        (folder / "sheet.toml").write_text(BENCH)
        self.sheet = load_config(folder / "sheet.toml")
        self.plan = load_plan(folder / "plan.toml")
        self.bench = VirtualBench(self.sheet)
        self.network = self.connect()
        self.journal = SettingsJournal(folder / "unrestored.jsonl")
        self.returned = []

    def connect(self):
        """Return another controller's end of the bus."""
        network = Network(self.bench.bus, clock=self.bench.now)
        self.bench.pump = network.pump
        return network

    def set_up_theirs(self, *, is_started):
        self.bench.run(0.02)
        theirs = self.connect()
        for node_id, theirs_of in THEIRS.items():
            node = theirs.add_node(node_id)
            for (index, subindex), (value, length) in theirs_of.items():
                node.download(index, subindex, value.to_bytes(length, "little"))
        if is_started:
            theirs.start_node()
        self.bench.run(0.02)
        self.network = self.connect()

    def settings(self):
        """Return what all nodes hold in the objects of communication and the device mode."""
        return {
            (node.node_id, variable.index, variable.subindex): variable.value
            for node in self.bench.bench.nodes
            for variable in node.object_dictionary
            if 0x1005 <= variable.index < 0x1C00 or variable.index == 0x6042
        }

    def states(self):
        self.bench.run(0.02)
        return [node.state for node in self.bench.bench.nodes]

    def commission(self, **console):
        return commission(
            self.network,
            self.sheet,
            self.plan,
            console=Console(**console, returned=self.returned.append),
            journal=self.journal,
        )

    def when_it_moves(self, act):
        """Do something once, in the middle of the first motion."""

        def observe(_now):
            if self.bench.bench.axes[0].plant.output.x > 5e-3:
                self.bench.observers.remove(observe)
                act()

        self.bench.observers.append(observe)


@pytest.fixture
def machine(tmp_path):
    machine = Machine(tmp_path)
    yield machine
    machine.bench.close()


def interrupt():
    raise KeyboardInterrupt


def leave_a_limit(machine):
    """Push the piston so that it is too fast."""
    machine.when_it_moves(lambda: machine.bench.faults.offset("position", 0.2))


def interrupt_in_motion(machine):
    machine.when_it_moves(interrupt)


def reboot(machine):
    reset = can.Message(arbitration_id=0, data=[129, 2], is_extended_id=False)
    machine.when_it_moves(lambda: machine.bench.bus.send(reset))


def interrupt_twice(machine):
    """Have the second Ctrl-C come while the valve is being disabled."""
    valve = machine.bench.bench.axes[0].valve

    def interrupt_again(_now):
        if valve.state == "DISABLED":
            machine.bench.observers.remove(interrupt_again)
            interrupt()

    def interrupt_first():
        machine.bench.observers.append(interrupt_again)
        interrupt()

    machine.when_it_moves(interrupt_first)


def interrupt_at_the_end(machine):
    """Have Ctrl-C come while the valve is being told to watch us no longer."""
    watch = machine.bench.bench.nodes[0].object_dictionary.variable(0x1016, 1)

    def arm():
        machine.bench.observers.append(interrupt_then)

    def interrupt_then(_now):
        if watch.value == 0:
            machine.bench.observers.remove(interrupt_then)
            interrupt()

    machine.when_it_moves(arm)


@pytest.mark.parametrize(
    ("happens", "is_started", "ended"),
    [
        (lambda _machine: None, False, [Verdict.PASSED, Verdict.PASSED, Verdict.PASSED]),
        (leave_a_limit, True, [Verdict.PASSED, Verdict.STOPPED, Verdict.NOT_RUN]),
        (interrupt_in_motion, False, [Verdict.PASSED, Verdict.STOPPED, Verdict.NOT_RUN]),
        (interrupt_twice, True, [Verdict.PASSED, Verdict.STOPPED, Verdict.NOT_RUN]),
        (interrupt_at_the_end, True, [Verdict.PASSED, Verdict.PASSED, Verdict.PASSED]),
    ],
    ids=["passed", "limit", "interrupted", "interrupted twice", "interrupted at the end"],
)
def test_however_it_ends_settings_and_states_are_as_before(machine, happens, is_started, ended):
    machine.set_up_theirs(is_started=is_started)
    before, states = machine.settings(), machine.states()
    assert states == [NmtState.OPERATIONAL if is_started else NmtState.PRE_OPERATIONAL] * 4
    happens(machine)
    found = machine.commission()
    assert [result.verdict for result in found.results] == ended
    assert machine.settings() == before
    assert machine.states() == states
    assert machine.returned == [found.returned]
    assert not found.returned.unrestored
    assert not machine.journal.path.exists()
    # The valve watches node 127 again, which is silent until their controller begins.
    machine.connect()
    machine.bench.run(1.0)
    assert machine.bench.bench.axes[0].valve.state not in FAULT_STATES


def test_what_was_changed_is_listed_with_its_values(machine):
    machine.set_up_theirs(is_started=True)
    found = machine.commission()
    listed = {(s.node_id, s.key): (s.before, s.during) for s in found.returned.settings}
    # The drivers have all devices send with SYNC, a heartbeat each 100 ms, and the valve watch
    # our commands (100 ms) and our heartbeat (node 127, 200 ms).
    assert listed[1, (0x1800, 2)] == (b"\xfe", b"\x01")
    assert listed[1, (0x1800, 5)] == ((20).to_bytes(2, "little"), bytes(2))
    assert listed[1, (0x1400, 5)] == ((50).to_bytes(2, "little"), (100).to_bytes(2, "little"))
    assert listed[1, (0x1016, 1)] == (
        (127 << 16 | 300).to_bytes(4, "little"),
        (127 << 16 | 200).to_bytes(4, "little"),
    )
    assert listed[3, (0x1800, 2)] == (b"\x03", b"\x01")
    assert set(listed) >= {(node, (0x1017, 0)) for node in THEIRS}
    # An identifier that was only disabled meanwhile is no change.
    assert not [key for _, key in listed if key[1] == 1 and key[0] != 0x1016]


def test_a_pdo_is_disabled_while_it_is_restored(machine):
    """Devices may take a transmission type only then."""
    machine.set_up_theirs(is_started=True)
    machine.commission()
    requests = [
        (logged.frame.data[3], logged.frame.data[4:8])
        for logged in machine.bench.frames
        if logged.frame.can_id == 0x603 and logged.frame.data[1:3] == b"\x00\x18"
        if logged.frame.data[0] >> 5 == 1  # initiate download
    ]
    theirs = [
        number for number, (subindex, data) in enumerate(requests) if (subindex, data[0]) == (2, 3)
    ]
    assert len(theirs) == 2  # their controller's, and ours at the end
    before = [data for subindex, data in requests[: theirs[1]] if subindex == 1]
    assert before[-1][3] & 0x80
    assert not requests[-1][1][3] & 0x80


def test_an_interrupted_question_restores_too(machine):
    machine.set_up_theirs(is_started=True)
    before = machine.settings()
    found = machine.commission(confirm=interrupt)
    assert found.is_interrupted
    assert machine.settings() == before


def test_an_error_of_the_console_restores_too(machine):
    """As a standard output that is full or closed."""

    def end(_result):
        raise BrokenPipeError

    machine.set_up_theirs(is_started=True)
    before = machine.settings()
    with pytest.raises(BrokenPipeError):
        machine.commission(end=end)
    assert machine.settings() == before
    assert len(machine.returned) == 1


def test_a_node_that_rebooted_gets_what_it_held_before(machine):
    """Its power-on values are not those which its controller had written."""
    machine.set_up_theirs(is_started=True)
    before = machine.settings()
    reboot(machine)
    found = machine.commission()
    assert found.results[1].problem == "node 2 rebooted; the valve was closed"
    assert machine.settings() == before


def test_what_a_lost_node_holds_is_named_and_kept_until_it_is_restored(machine):
    machine.set_up_theirs(is_started=True)
    before = machine.settings()
    lost_at = []

    def lose():
        lost_at.append(machine.bench.now())
        machine.bench.faults.silence("position")

    machine.when_it_moves(lose)
    found = machine.commission()
    lost = {(s.node_id, s.key): s.problem for s in found.returned.unrestored}
    assert {node for node, _ in lost} == {4}
    assert {(4, (0x1800, 2)), (4, (0x1800, 5)), (4, (0x1017, 0))} <= set(lost)
    assert set(lost.values()) == {"node 4 does not answer"}
    # One request that waits in vain is enough.
    after = [m for m in machine.bench.frames if m.now > lost_at[0] * 1e9]
    assert [m.frame.can_id for m in after].count(0x604) == 1
    others = {key: value for key, value in before.items() if key[0] != 4}
    assert others.items() <= machine.settings().items()

    # The node is there again, and another process reads what the first one left behind.
    for fault in list(machine.bench.faults.active):
        fault.clear()
    machine.bench.run(0.1)
    journal = SettingsJournal.read(machine.journal.path)
    journal.restore(machine.connect())
    assert not journal.unrestored
    assert machine.settings() == before
    assert not machine.journal.path.exists()


def test_a_killed_process_leaves_behind_what_restores_everything(machine):
    """Whatever is killed has written each old value before it changed it."""

    class Killed(BaseException):
        """What nobody catches."""

    def kill():
        machine.journal.restore = lambda _network: interrupt()  # nothing runs any more
        raise Killed

    machine.set_up_theirs(is_started=True)
    before = machine.settings()
    machine.when_it_moves(kill)
    with pytest.raises((Killed, KeyboardInterrupt)):
        machine.commission()
    assert machine.settings() != before
    theirs = SettingsJournal.read(machine.journal.path)
    theirs.restore(machine.connect())
    assert machine.settings() == before


def test_an_object_that_refuses_its_old_value_is_named_and_its_pdo_works_on(machine):
    machine.set_up_theirs(is_started=True)
    before = machine.settings()
    machine.when_it_moves(lambda: refuse(machine, 0x1800, 5))
    found = machine.commission()
    (refused,) = found.returned.unrestored
    assert (refused.node_id, refused.key) == (4, (0x1800, 5))
    assert "SDO abort 0x08000022" in refused.problem
    after = machine.settings()
    assert after[4, 0x1800, 1] == before[4, 0x1800, 1]
    assert {key for key in before if before[key] != after[key]} == {(4, 0x1800, 5)}


def refuse(machine, index, subindex):
    """Have node 4 refuse whatever is written to an object."""
    from hil_bench.canopen_device import abort_codes  # noqa: PLC0415
    from hil_bench.errors import SdoAbort  # noqa: PLC0415

    def check(_value):
        raise SdoAbort(*abort_codes.DEVICE_STATE)

    node = next(node for node in machine.bench.bench.nodes if node.node_id == 4)
    node.object_dictionary.add_check(index, subindex, check)


class Dictionary:
    """A node that is a dictionary, and takes the parameters of a PDO while that is disabled."""

    node_id, before_download = 3, None

    def __init__(self, objects):
        self.objects = dict(objects)
        self.network = SimpleNamespace(nodes={}, add_node=lambda *_: self)

    def has(self, *_key):
        return False

    def upload(self, *key):
        return self.objects[key]

    def download(self, index, subindex, raw):
        if self.before_download:
            self.before_download(index, subindex, raw)
        elif 0x1400 <= index < 0x1A00 and index & 0x200 == 0 and subindex != 1:
            assert self.objects[index, 1][3] & 0x80, "a parameter of an enabled PDO"
        self.objects[index, subindex] = raw


OBJECTS = {(index, 1): (0x181 + index).to_bytes(4, "little") for index in (0x1400, 0x15FF, 0x1800)}
OBJECTS |= {(index, sub): bytes([sub, 0]) for index in (0x15FF, 0x1800, 0x19FF) for sub in (2, 5)}
OBJECTS |= {(0x19FF, 1): b"\x85\2\0\x80", (0x1017, 0): b"\x64\0", (0x2000, 1): bytes(8)}


@settings(max_examples=40)
@given(st.lists(st.tuples(st.sampled_from(sorted(OBJECTS)), st.binary(min_size=1, max_size=9))))
def test_whatever_was_written_the_node_holds_what_it_held(tmp_path_factory, writes):
    node, path = Dictionary(OBJECTS), tmp_path_factory.mktemp("journal") / "unrestored.jsonl"
    journal = SettingsJournal(path)
    journal.watch(node)
    for key, raw in writes:
        node.download(*key, raw.ljust(4, b"\0") if key[1] == 1 else raw)
    during = {key: raw for key, raw in node.objects.items() if key in dict(writes)}
    first = dict.fromkeys(key for key, _ in writes)
    if writes:
        found = SettingsJournal.read(path).settings
        assert [(each.node_id, each.key, each.before) for each in found] == [
            (3, key, OBJECTS[key]) for key in first
        ]
    assert {each.key: each.during for each in journal.settings} == during
    changed = [key for key in first if during[key] != OBJECTS[key]]
    assert [each.key for each in journal.changed] == changed
    journal.restore(node.network)
    assert node.objects == OBJECTS
    assert ([each.key for each in journal.changed], journal.unrestored) == (changed, [])
    assert not path.exists()


@pytest.mark.parametrize(
    ("index", "subindex", "raw", "text"),
    [
        (0x1017, 0, "6400", "100"),
        (0x1017, 0, "ffff", "65535"),
        (0x1016, 1, "00000100", "0x00010000"),
        (0x1800, 1, "81010000", "0x00000181"),
        (0x1400, 1, "01", "0x00000001"),
        (0x19FF, 1, "01", "0x00000001"),
        (0x15FF, 1, "01", "0x00000001"),
        (0x1800, 2, "fe", "254"),
        (0x1A00, 1, "01", "1"),
        (0x1600, 1, "01", "1"),
        (0x13FF, 1, "01", "1"),
        (0x17FF, 1, "01", "1"),
        (0x2000, 0, "0102030405", "0x0504030201"),
        (0x2000, 0, "01020304", "0x04030201"),
    ],
)
def test_identifiers_and_what_is_long_are_shown_by_their_digits(index, subindex, raw, text):
    setting = BorrowedSetting(1, (index, subindex), "", b"", b"")
    assert setting.text(bytes.fromhex(raw)) == text
    assert str(setting) == (f"0x{index:04X}.{subindex:02X}" if subindex else f"0x{index:04X}")


def test_a_setting_is_on_the_disk_before_it_is_changed(tmp_path, monkeypatch):
    """So that a machine that loses its power can be restored as well."""
    path, on_disk = tmp_path / "unrestored.jsonl", []
    monkeypatch.setattr(os, "fsync", lambda _file: on_disk.append(path.read_text()))
    node = SimpleNamespace(node_id=1, upload=lambda *_: b"\x64\x00", has=lambda *_: False)
    SettingsJournal(path).watch(node)
    node.before_download(0x1017, 0, b"\x00\x00")
    (text,) = on_disk
    assert (json.loads(text)["object"], json.loads(text)["before"]) == ("0x1017.00", "6400")


@pytest.mark.parametrize("length", range(9, 84, 15))
def test_a_line_that_was_not_written_to_its_end_leaves_those_before_it(tmp_path, length):
    """It stands before the write to the device, which therefore did not happen."""
    path = tmp_path / "unrestored.jsonl"
    line = '{"node": 1, "object": "0x1017.00", "name": "", "before": "6400", "during": "0000"}'
    path.write_text(f"{line}\n{line.replace('1017', '1018')[:length].removesuffix('}')}")
    (setting,) = SettingsJournal.read(path).settings
    assert (setting.key, setting.before) == ((0x1017, 0), b"\x64\x00")


@pytest.mark.parametrize(
    "line",
    [
        "nonsense",
        "{}",
        '{"node": 0, "object": "0x1017.00", "name": "", "before": "00", "during": "00"}',
        '{"node": 1, "object": "0x11017.00", "name": "", "before": "00", "during": "00"}',
        '{"node": 1, "object": "0x1017.00", "name": "", "before": "xy", "during": "00"}',
        '{"node": 1, "object": "0x1017.00", "name": "", "before": "", "during": "00"}',
        json.dumps(
            {"node": 1, "object": "0x1017.00", "name": "", "before": "00" * 65, "during": "00"}
        ),
        "[1]",
    ],
)
def test_a_file_that_is_no_journal_is_refused(make_file, line):
    path = make_file("unrestored.jsonl", line)
    with pytest.raises(ConfigError, match="is no journal of settings; each line of one names"):
        SettingsJournal.read(path)
