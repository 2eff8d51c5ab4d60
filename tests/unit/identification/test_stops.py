"""Runs that end at a stop are fitted: found, masked, and worth their seconds."""

from dataclasses import replace

import numpy as np
import pytest
from support.machine_record import FULL_OPENING, Machine

from hil_bench.abilities.identification.identify import identify
from hil_bench.abilities.identification.pieces import cut_pieces
from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.abilities.identification.report import find_misses
from hil_bench.abilities.identification.stops import find_stops
from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.model import (
    EndStop,
    PlantOptions,
    balanced_state,
    paper_parameters,
)

# The stop is 0.7 mm before the end that Table I has.
MACHINE = replace(paper_parameters(), w=0.022, E=1.2e8, m=24.0, h=0.1993)

SETPOINTS = np.concatenate(
    [
        np.zeros(100),
        *(
            np.repeat([opening, -opening, opening, 0.0], [900, 150, 250, 100])
            for opening in (0.6e-3, 0.8e-3, 1.0e-3, 0.7e-3, 0.9e-3)
        ),
    ]
)


@pytest.fixture(scope="module")
def record() -> AxisRecord:
    """To the stop, a little back, and to it again: it stands there for most of 7 s."""
    machine = Machine(parameters=MACHINE, state=balanced_state(MACHINE, x=0.05))
    return AxisRecord.of(machine.record(SETPOINTS), "axis1", FULL_OPENING)


def test_the_stop_is_found_where_it_is(record: AxisRecord) -> None:
    found = find_stops(record, 0.2)

    # 10 MPa on 50 cm² press the piston 0.25 mm into a stop of 2e8 N/m at 199.3 mm.
    assert found.notes == ("end stop at 199.6 mm: pressures count there, positions do not",)
    assert found.at_stop is not None
    touching = found.at_stop[:, 0]
    assert touching.mean() == pytest.approx((record.measured[:, 0] > 0.19905).mean(), abs=0.01)
    struck = np.flatnonzero(np.diff(touching.astype(int)) == 1) + 1
    assert found.at_stop[struck[0] : struck[0] + 10, 1:].all()  # 10 ms
    assert not found.at_stop[struck[0] + 10 : struck[0] + 100, 1:].any()


def test_a_stop_elsewhere_is_none(record: AxisRecord) -> None:
    """What holds the piston 20 mm before the end of the stroke is no end stop."""
    assert find_stops(record, 0.22) is record


def test_a_record_clear_of_the_stops_has_none(record: AxisRecord) -> None:
    clear = replace(record, measured=record.measured - np.array([0.01, 0.0, 0.0]))

    assert find_stops(clear, 0.2) is clear


def test_unequal_ends_are_named(record: AxisRecord) -> None:
    position = record.measured[:, :1]
    other = np.hstack([-position - 1e-3, record.measured[:, 1:]])
    both = replace(
        record, measured=np.where(np.arange(len(record))[:, None] < 3000, other, record.measured)
    )

    assert "the middle of both end stops is at -0.50 mm" in find_stops(both, 0.2).notes[1]


def test_pieces_at_the_stop_are_taken_only_where_they_are_marked(record: AxisRecord) -> None:
    part = [range(20, len(record))]

    clear = cut_pieces(record, part, 200, 0.2)
    unmarked = cut_pieces(record, part, 200, 0.2, has_stops=True)
    marked = cut_pieces(find_stops(record, 0.2), part, 200, 0.2, has_stops=True)

    assert len(unmarked.rows) == len(clear.rows)
    assert len(marked.rows) > 3 * len(clear.rows)


@pytest.mark.long
def test_a_stiffer_contact_than_configured_misleads_nothing() -> None:
    """The bounce is the contact's: it neither counts in the fit nor in the trial."""
    options = replace(PlantOptions.bench(), end_stop=EndStop(stiffness=8e8, damping=8e4))
    machine = Machine(parameters=MACHINE, options=options, state=balanced_state(MACHINE, x=0.05))
    record = AxisRecord.of(machine.record(SETPOINTS), "axis1", FULL_OPENING)

    found = identify(
        find_stops(record, 0.2),
        paper_parameters(),
        PlantOptions.bench(),
        step=1e-4,
        names=("w", "E", "m", "h"),
        starts=1,
    )

    assert not find_misses(found)
    for estimate in found.estimates:
        if estimate.name != "h":  # the stop takes what its contact sinks in
            error = estimate.value - getattr(MACHINE, estimate.name)
            assert abs(error) < 4.0 * estimate.deviation


@pytest.mark.long
def test_a_record_that_ends_at_the_stop_tells_the_machine(record: AxisRecord) -> None:
    known, options = paper_parameters(), PlantOptions.bench()
    with pytest.raises(ConfigError, match="clear of the end stops"):
        identify(record, known, options, step=1e-4, names=("w", "E", "m"), starts=1)

    found = identify(
        find_stops(record, 0.2), known, options, step=1e-4, names=("w", "E", "m", "h"), starts=1
    )

    assert found.residual == pytest.approx(1.0, abs=0.1)
    for estimate in found.estimates:
        assert estimate.is_told
        error = estimate.value - getattr(MACHINE, estimate.name)
        assert abs(error) < 4.0 * estimate.deviation
    (E,) = [estimate for estimate in found.estimates if estimate.name == "E"]
    assert E.deviation < 0.01 * E.value
