"""Manoeuvres that go to the end stops: only where that is allowed, and no faster."""

from dataclasses import replace
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest

from hil_bench.abilities.commissioning.plan import Limits
from hil_bench.abilities.identification.design.bounds import Bounds
from hil_bench.abilities.identification.design.choosing import Designer
from hil_bench.abilities.identification.design.foresight import Foresight
from hil_bench.abilities.identification.design.manoeuvres import draw_contacts, measure_paces
from hil_bench.abilities.identification.design.twin import Twin
from hil_bench.abilities.identification.machine import Template
from hil_bench.bench.configuration import load_config
from hil_bench.plants.hydraulic_cylinder.model import paper_parameters

if TYPE_CHECKING:
    from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig

AXIS = cast("CylinderConfig", load_config(None).first_axis)
SETTINGS = {
    one.key.name: one for one in load_config(None).settings if one.table == f"plant.{AXIS.name}"
}
STROKE_END = paper_parameters().h  # 200 mm
CLEAR = Limits(position=(-0.15, 0.15), speed=0.4, pressure=(-1e5, 1.2e7), time=60.0)
TOUCHING = replace(CLEAR, position=(-0.203, 0.203), contact_speed=0.05)
TWIN = Twin(
    axis="axis1",
    parameters=paper_parameters(),
    options=AXIS.options,
    step=2.5e-4,
    interval=2e-3,
    full_opening=paper_parameters().full_opening,
    noise=np.array([2e-6, 5e3, 5e3]),
)


def test_without_permission_nothing_touches_a_stop() -> None:
    bounds = Bounds.of(AXIS, CLEAR)

    assert bounds.stops == ()
    assert not [*draw_contacts(TWIN, bounds, measure_paces(TWIN, bounds))]


def test_limits_that_end_before_a_stop_do_not_allow_to_touch_it() -> None:
    assert Bounds.of(AXIS, replace(TOUCHING, position=(-0.19, 0.203))).stops == (STROKE_END,)


def test_the_piston_reaches_each_stop_slowly_and_stands_there() -> None:
    bounds = Bounds.of(AXIS, TOUCHING)
    paces = measure_paces(TWIN, bounds)

    back, out = draw_contacts(TWIN, bounds, paces)

    for side, manoeuvre in ((-1.0, back), (1.0, out)):
        states = TWIN.run(manoeuvre.setpoints, bounds.middle)
        outward, speed = side * states[:, 0], side * states[:, 1]
        assert outward.max() > STROKE_END
        assert 0.02 < speed[outward > STROKE_END - 0.015].max() < 0.05
        assert not bounds.leaves(states)
        standing = (outward > STROKE_END - 1e-3).sum() * TWIN.interval
        assert standing > 0.6  # 0.3 s closed, 0.1 s open, 0.2 s closed


def test_a_piston_that_comes_too_fast_leaves_the_bounds() -> None:
    bounds = Bounds.of(AXIS, TOUCHING)
    states = np.zeros((2, 4))
    states[1] = 0.199, 0.06, 0.0, 0.0

    assert bounds.leaves(states) == "contact speed"
    assert Bounds.of(AXIS, CLEAR).leaves(states) == "position"
    states[1, 1] = -0.3  # away
    assert not bounds.leaves(states)


@pytest.mark.long
def test_a_stop_is_taken_where_it_tells_most() -> None:
    """Leakage of a stiff axis: 100 bar stand across a piston at its stop, a tenth elsewhere."""
    stiff = replace(TWIN, parameters=replace(paper_parameters(), E=1.4e9))
    leak, stop = "internal_leakage_l_min_bar", "stroke_mm"
    keys = ("bulk_modulus_mpa", leak, "orifice_width_mm", "moving_mass_kg", stop)
    modulus = SETTINGS["bulk_modulus_mpa"]._replace(value=1400.0)
    axis = replace(AXIS, parameters=stiff.parameters)
    template = Template(axis, SETTINGS | {"bulk_modulus_mpa": modulus}, 1)
    foresight = Foresight(stiff, template, keys)
    limits = (CLEAR, replace(TOUCHING, contact_speed=0.2))

    clear, touching = (
        Designer(foresight, Bounds.of(AXIS, one), aside=(stop,)).design(20.0) for one in limits
    )

    assert not any("end stop" in name for _, name in clear.names)
    assert any("end stop" in name for _, name in touching.names)
    leakage, others = touching.outlooks[1], clear.outlooks[1]
    assert (leakage.name, others.name) == (leak, leak)
    assert leakage.after < 0.3 * others.after
