"""What was done by hand, as the steps of a scenario."""

import pytest

from hil_bench.abilities.scenario.records import FaultStep, SetStep
from hil_bench.abilities.scenario.writing import JournalSteps

HELLO = {"channels": [["pressure_a.measured", "Pa"], ["position.measured", "m"]]}


def entry(time, action, *, number=None, **fields):
    return {"time": time, "do": action, "fields": fields, "number": number}


def fault(time, number, kind="freeze", target="position", **arguments):
    return entry(time, "begin_fault", number=number, kind=kind, target=target, arguments=arguments)


def clear(time, number=None):
    return {"time": time, "do": "clear_fault", "fields": {"number": number}}


def load(time, value):
    return entry(time, "set_plant", axis="axis1", quantity="load", value=value)


def steps(*entries, begin=10.0, end=20.0, lead=1.0):
    maker = JournalSteps(HELLO, begin, end, lead)
    maker.add(entries)
    return list(maker.steps), maker.remarks


def test_a_click_is_a_step_at_its_time():
    # 12.5 s on the bench, which begins at 10 s with 1 s of lead: 3.5 s.
    found, remarks = steps(fault(12.5, 1, "offset", "pressure_a", amount=2e6))
    assert found == [FaultStep(3.5, "offset", "pressure_a", (("offset_bar", 20.0),))]
    assert remarks == []


def test_a_clear_gives_its_fault_a_duration():
    found, _ = steps(fault(12.0, 1), clear(13.25, 1))
    assert found == [FaultStep(3.0, "freeze", "position", (("for_s", 1.25),))]


def test_a_clear_of_all_ends_what_is_open():
    found, _ = steps(
        fault(11.0, 1),
        fault(12.0, 2, target="pressure_a"),
        clear(13.0, 2),
        clear(14.0),
    )
    assert [dict(step.values)["for_s"] for step in found] == [3.0, 1.0]


def test_a_fault_that_ends_by_itself_keeps_its_duration():
    found, _ = steps(fault(12.0, 1, duration=0.5), clear(13.0))
    assert dict(found[0].values) == {"for_s": 0.5}


def test_what_is_there_at_the_beginning_comes_with_it():
    found, _ = steps(
        fault(5.0, 1),
        fault(5.0, 2, target="pressure_a", duration=1.0),
        fault(5.0, 3, target="pressure_b"),
        clear(6.0, 3),
        load(7.0, 100.0),
        load(9.5, 5000),
        load(12.0, 0.0),
    )
    assert found == [
        SetStep(0.0, "axis1.load", 5000.0),
        FaultStep(0.0, "freeze", "position"),
        SetStep(3.0, "axis1.load", 0.0),
    ]


@pytest.mark.parametrize(
    ("duration", "left"),  # begun at 5 s; the scenario has 0 s at 10 s, and 1 s of lead
    [(4.5, None), (5.0, None), (5.5, 1.5), (7.0, 3.0)],
)
def test_a_fault_of_before_ends_when_it_did(duration, left):
    found, _ = steps(fault(5.0, 1, duration=duration))
    assert [dict(step.values)["for_s"] for step in found] == ([] if left is None else [left])
    found, _ = steps(fault(5.0, 1, duration=7.0), clear(11.0))
    assert [dict(step.values)["for_s"] for step in found] == [2.0]


def test_what_has_ended_before_the_beginning_is_not_begun_again_by_a_clear():
    found, _ = steps(fault(5.0, 1, duration=1.0), clear(12.0))
    assert found == []


def test_what_comes_after_the_end_is_left_out():
    found, _ = steps(load(20.0, 1.0), fault(21.0, 1))
    assert found == []


def test_a_planned_fault_begins_when_it_is_planned():
    found, _ = steps(fault(11.0, 1, at=15.0), fault(11.0, 2, at=25.0))
    assert [step.at for step in found] == [6.0]


def test_an_object_is_set_by_its_name():
    found, _ = steps(entry(11.0, "set_object", node="valve", name="0x1017", value=500))
    assert found == [SetStep(2.0, "valve.0x1017", 500.0)]


@pytest.mark.parametrize(
    ("given", "remark"),
    [
        (
            entry(11.0, "set_object", node="valve", name="0x1008", value={"hex": "00"}),
            "a value that is no number was set at 11 s; scenarios have none",
        ),
        (
            clear(11.0, 9),
            "fault 9, cleared at 11 s, was not begun by hand",
        ),
        (entry(11.0, "begin_fault", number=1), "the fault at 11 s has too long arguments"),
    ],
)
def test_what_a_scenario_cannot_have_is_told(given, remark):
    assert steps(given) == ([], [remark])


def test_a_mark_is_no_step():
    assert steps(entry(11.0, "mark", text="here")) == ([], [])
