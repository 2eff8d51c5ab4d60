"""The free variables of the fit and what they stand for."""

from dataclasses import replace

import numpy as np
import pytest

from hil_bench.abilities.identification.unknowns import KINDS, Guess, Sensors, Unknowns
from hil_bench.plants.hydraulic_cylinder.model import paper_parameters

ALL = tuple(KINDS)


def test_the_start_stands_for_what_is_configured() -> None:
    unknowns = Unknowns(paper_parameters(), ALL)

    guess = unknowns.guess(unknowns.start)

    for name in ALL:
        assert getattr(guess.parameters, name) == pytest.approx(getattr(paper_parameters(), name))
    assert guess.offsets.tolist() == [[0.0, 0.0]]


def test_any_plant_is_found_again() -> None:
    plant = replace(paper_parameters(), w=0.03, beta=1e-4, E=1.5e9, F_c=300.0, F_s=310.0, C_L=1e-13)
    unknowns = Unknowns(paper_parameters(), ALL)

    found = unknowns.guess(unknowns.variables_of(Guess(plant, np.array([[1e4, -2e4]]))))

    for name in ALL:
        assert getattr(found.parameters, name) == pytest.approx(getattr(plant, name))
    assert found.offsets == pytest.approx(np.array([[1e4, -2e4]]))


@pytest.mark.parametrize("side", [0, 1])
def test_each_corner_of_the_bounds_is_a_plant(side: int) -> None:
    unknowns = Unknowns(paper_parameters(), ALL)

    plant = unknowns.guess(unknowns.bounds[side]).parameters

    assert plant.F_s >= plant.F_c


def test_what_is_configured_as_zero_is_sought_about_table_1() -> None:
    known = replace(paper_parameters(), beta=0.0, F_c=0.0, F_s=0.0, sigma=0.0)
    unknowns = Unknowns(known, ("beta", "F_c", "F_s", "sigma"))

    plant = unknowns.guess(np.array([0.5, np.log(2.0), 1.0, 0.0, 0.0, 0.0])).parameters

    # Table I: beta 0.3 mm, F_c 600 N, sigma 2000 kg/s
    assert plant.beta == pytest.approx(0.15e-3)
    assert plant.F_c == pytest.approx(1200.0)
    assert plant.F_s == pytest.approx(2400.0)
    assert plant.sigma == pytest.approx(2000.0)


def test_static_friction_that_is_not_sought_stays_unless_coulomb_friction_passes_it() -> None:
    unknowns = Unknowns(paper_parameters(), ("F_c",))

    below, above = (unknowns.guess(np.array([np.log(r), 0.0, 0.0])).parameters for r in (0.5, 2.0))

    assert (below.F_c, below.F_s) == pytest.approx((300.0, 900.0))
    assert (above.F_c, above.F_s) == pytest.approx((1200.0, 1200.0))


def test_what_is_not_sought_stays() -> None:
    known = replace(paper_parameters(), m=33.0)
    unknowns = Unknowns(known, tuple(name for name in ALL if name != "m"))

    assert unknowns.guess(unknowns.start + 0.01).parameters.m == 33.0


def test_a_gain_of_the_command_scales_the_valve() -> None:
    table_1 = paper_parameters()
    unknowns = Unknowns(table_1, ("gain",))

    guess = unknowns.guess(np.array([np.log(2.0), 0.0, 0.0]))

    # twice the opening at each set-point: the same flow as of a valve that opens at half of it
    assert guess.value("gain") == pytest.approx(2.0)
    assert guess.parameters.w * guess.parameters.alpha == pytest.approx(table_1.w * table_1.alpha)
    assert guess.parameters.beta == pytest.approx(0.5 * table_1.beta)


def test_delays_and_the_supply_are_unknowns_too() -> None:
    unknowns = Unknowns(paper_parameters(), ("P_S", "position_delay"), sensors=Sensors(2e-3))

    start = unknowns.guess(unknowns.start)
    guess = unknowns.guess(np.array([np.log(0.9), 1.5, 0.0, 0.0]))

    assert start.sensors.position_delay == pytest.approx(2e-3)
    assert guess.parameters.P_S == pytest.approx(90e5)  # of 100 bar
    assert guess.sensors.position_delay == pytest.approx(1.5e-3)


def test_each_recording_but_the_first_has_a_flow_of_its_own() -> None:
    unknowns = Unknowns(paper_parameters(), ("w",), sessions=3, has_flows=True)

    guess = unknowns.guess(np.array([0.0, *6 * [0.0], np.log(0.98), np.log(1.04)]))

    w = paper_parameters().w
    assert [guess.plant_in(session).w for session in range(3)] == pytest.approx(
        [w, 0.98 * w, 1.04 * w]
    )
    assert unknowns.guess(unknowns.variables_of(guess)).flows == pytest.approx((1.0, 0.98, 1.04))
    assert unknowns.guess(unknowns.start).flows == (1.0, 1.0, 1.0)
