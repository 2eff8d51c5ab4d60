"""Loop, mailbox, Modbus server and hub in virtual time: nothing escapes, is lost, or is doubled.

Each seed is another course of events: honest clients beside hostile ones, everything cut into
segments and delayed at random, connections half-closed and reset. `benchmarks/modbus_attack.py`
runs more seeds.
"""

import pytest
from support.modbus_world import World, run_seeds

from hil_bench.abilities.hub.server import _Client
from hil_bench.abilities.modbus.protocol.mailbox import Mailbox
from hil_bench.abilities.modbus.server import pdu
from hil_bench.abilities.modbus.server.connections import _Connection
from hil_bench.abilities.modbus.server.register_server import RegisterServer
from hil_bench.abilities.modbus.server.session import FramingError, ModbusSession


def faults(reports):
    return {seed: report.faults for seed, report in reports.items() if report.faults}


@pytest.mark.long
def test_honest_clients_are_served_whatever_the_others_do():
    reports = run_seeds(range(6))
    assert faults(reports) == {}
    # The runs are not empty ones.
    assert sum(report.answered for report in reports.values()) > 6 * 50
    assert sum(report.writes for report in reports.values()) > 6 * 50
    assert sum(report.frames for report in reports.values()) > 6 * 9


def test_more_clients_than_slots_of_the_mailbox_are_served_by_a_server_that_looks_seldom():
    assert faults(run_seeds(range(3), is_crowded=True)) == {}


@pytest.mark.long
def test_a_loop_that_stands_still_and_a_server_that_dies_double_and_lose_nothing():
    assert faults(run_seeds(range(2), may_stall=True)) == {}
    assert faults(run_seeds(range(2), may_die=True)) == {}
    assert faults(run_seeds(range(2, 5), may_stall=True, may_die=True)) == {}


def test_a_seed_is_one_course_of_events():
    first, again, other = World(1).run(), World(1).run(), World(2).run()
    assert first == again
    assert first.trace != other.trace


# A simulation that finds nothing might look at nothing: each of these defects must be found.


def first_faults(seeds=20, **options):
    """The faults of the first run that has some."""
    for seed in range(seeds):
        if found := World(seed, **options).run().faults:
            return found
    return []


def unguarded_work(self):
    if self._is_working or self.is_over:
        return
    self._is_working = True
    try:
        while self._step():
            pass
    finally:
        self._is_working = False


def guarded_update(self, nbytes):
    self.active_at = self._loop.time()
    try:
        self._session.receive(memoryview(self._chunk)[:nbytes])
    except FramingError:
        self.abort()
        return
    self._hold_back()


def unguarded_delivery(self, write, code):
    write.reply(self._write_response(write, code))


def test_it_finds_the_segment_that_ended_the_bench(monkeypatch):
    # The handlers as they were: around what comes in, and none around what comes out.
    monkeypatch.setattr(ModbusSession, "_work", unguarded_work)
    monkeypatch.setattr(_Connection, "buffer_updated", guarded_update)
    monkeypatch.setattr(RegisterServer, "_deliver", unguarded_delivery)
    assert any(fault.startswith("_serve ended: FramingError") for fault in first_faults())


def test_it_finds_a_defect_that_costs_a_connection_only(monkeypatch):
    decode = pdu.decode_request

    def fragile(data):
        return decode(data) if len(data) > 1 else data[1]

    monkeypatch.setattr(pdu, "decode_request", fragile)
    assert any("internal error: IndexError" in fault for fault in first_faults())


def test_it_finds_a_write_that_is_executed_twice(monkeypatch):
    post = Mailbox.post
    monkeypatch.setattr(Mailbox, "post", lambda box, order: post(box, order) and post(box, order))
    assert any(fault.endswith("was written twice") for fault in first_faults())


def test_it_finds_a_new_server_that_does_not_know_where_the_old_one_was(monkeypatch):
    monkeypatch.setattr(Mailbox, "resume", lambda _: None)
    assert first_faults(may_die=True)


def test_it_finds_responses_that_pile_up(monkeypatch):
    monkeypatch.setattr(_Connection, "_hold_back", lambda _: None)
    assert any("unread are kept" in fault for fault in first_faults())


def test_it_finds_responses_that_a_half_closed_connection_is_due(monkeypatch):
    monkeypatch.setattr(_Connection, "eof_received", lambda _: False)
    assert any("responses due" in fault for fault in first_faults())


def test_it_finds_frames_in_another_order_for_some(monkeypatch):
    def broadcast(self, frames):
        for client in self._bus or ():
            if client is not self:
                client.deliver(b"".join(frames[::-1]))

    monkeypatch.setattr(_Client, "_broadcast", broadcast)
    assert any("of the hub" in fault for fault in first_faults())
