"""What a record tells of a plant, and what it does not."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from support.machine_record import (
    FULL_OPENING,
    POSITION_NOISE,
    PRESSURE_NOISE,
    Machine,
    random_steps,
)

from hil_bench.abilities.identification.identify import Identification, find_vague, identify
from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.abilities.identification.unknowns import Guess, Unknowns
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import Recording
from hil_bench.plants.hydraulic_cylinder.model import (
    ConstantLoad,
    EntrainedAir,
    LuGreFriction,
    MeteringLands,
    PlantOptions,
    PlantParameters,
    SupplyUnit,
    balanced_state,
    paper_parameters,
)

STEP = 1e-4
# Each within 30 % of Table I, from which the search starts.
MACHINE = replace(paper_parameters(), w=0.022, E=1.2e8, F_c=500.0, m=24.0)


def run(
    recording: Recording, known: PlantParameters, names: tuple[str, ...], step: float = STEP
) -> Identification:
    record = AxisRecord.of(recording, "axis1", FULL_OPENING)
    return identify(record, known, PlantOptions.bench(), step=step, names=names, starts=3)


@pytest.fixture(scope="module")
def found() -> Identification:
    """Of set-points that stay below the full opening, 1.3 mm."""
    recording = Machine(parameters=MACHINE, offset=2e4).record(random_steps(0.5e-3, 1e-3, 40, 100))
    return run(recording, paper_parameters(), ("w", "alpha", "E", "F_c", "m"))


@pytest.mark.long
@pytest.mark.parametrize("name", ["w", "E", "F_c", "m"])
def test_a_parameter_is_found_within_its_uncertainty(found: Identification, name: str) -> None:
    estimate = {estimate.name: estimate for estimate in found.told}[name]

    assert estimate.value == pytest.approx(getattr(MACHINE, name), rel=0.01)
    assert abs(estimate.value - getattr(MACHINE, name)) < 5.0 * estimate.deviation


@pytest.mark.long
def test_without_saturation_alpha_is_not_told_and_stays(found: Identification) -> None:
    assert [estimate.name for estimate in found.not_told] == ["alpha"]
    assert found.parameters.alpha == paper_parameters().alpha


@pytest.mark.long
def test_an_opening_that_no_setpoint_reaches_is_not_told(found: Identification) -> None:
    # Whatever the deviation: the fit is made to claim that it knows alpha exactly.
    unknowns = Unknowns(paper_parameters(), ("w", "alpha", "E", "F_c", "m"))
    values = replace(found.parameters, alpha=3.0 * paper_parameters().alpha)
    variables = unknowns.variables_of(Guess(values, found.offsets))
    sure = 1e-20 * np.eye(len(variables))
    fit = cast("Any", SimpleNamespace(variables=variables, covariance=sure))

    assert find_vague(found.record, unknowns, fit) == ["alpha"]


@pytest.mark.long
def test_noise_is_found_to_what_was_added(found: Identification) -> None:
    # The residuals of 2.9 s scatter by 1.3 %.
    assert found.record.noise == pytest.approx([POSITION_NOISE, *2 * [PRESSURE_NOISE]], rel=0.05)


@pytest.mark.long
def test_the_fit_has_reached_its_optimum(found: Identification) -> None:
    assert found.is_reached
    assert found.is_white
    for estimate in found.told:
        assert estimate.interval[0] < estimate.value < estimate.interval[1]


@pytest.mark.long
def test_an_offset_of_a_pressure_sensor_is_told_apart(found: Identification) -> None:
    # 0.2 bar on P_A alone; what both share hardly shows
    difference = found.offsets[0, 0] - found.offsets[0, 1]
    assert difference == pytest.approx(2e4, abs=3e3)


@pytest.mark.long
def test_the_model_is_right_to_the_noise_where_it_was_not_fitted(found: Identification) -> None:
    assert found.residual == pytest.approx(1.0, abs=0.2)
    assert np.all(found.trial.residual < 1.3)
    (run,) = found.trial.runs
    assert run.rows.min() == found.trial.rows.min()
    drift = run.model[:, 0] - found.record.measured[run.rows, 0]
    assert np.abs(drift).max() < 1e-3  # [m], after 0.8 s on its own
    assert found.trial.rows.min() >= 0.8 * len(found.record)  # the last fifth


@pytest.mark.long
def test_without_slow_motion_the_stribeck_velocity_is_not_told() -> None:
    # Openings from 0.15 mm on give 40 mm/s and more; there F_s - F_c has faded by exp(-8^0.8).
    parameters = replace(paper_parameters(), chi=5e-3)
    machine = Machine(parameters=parameters, state=balanced_state(parameters, x=-0.17))
    setpoints = np.abs(random_steps(0.45e-3, 0.55e-3, 36, 100))

    found = run(machine.record(setpoints)[400:], paper_parameters(), ("w", "F_s", "chi"))

    # What can be seen is (F_s - F_c) exp(-(v / chi)^0.8) at 40 mm/s: one number of two.
    assert [estimate.name for estimate in found.not_told] == ["F_s", "chi"]
    assert found.parameters.chi == paper_parameters().chi
    (chi,) = [estimate for estimate in found.estimates if estimate.name == "chi"]
    assert chi.interval[0] < 5e-3 < chi.interval[1]


@pytest.mark.long
def test_a_recorded_spool_is_fitted_by_itself() -> None:
    parameters = replace(paper_parameters(), omega_0=1000.0)
    machine = Machine(parameters=parameters, has_spool=True)

    found = run(
        machine.record(random_steps(0.5e-3, 1e-3, 34, 100)), paper_parameters(), ("omega_0", "w")
    )

    estimates = {estimate.name: estimate for estimate in found.told}
    assert estimates["omega_0"].value == pytest.approx(1000.0, rel=0.01)
    assert estimates["w"].value == pytest.approx(0.02, rel=0.01)


def test_a_record_at_the_end_stop_is_refused() -> None:
    setpoints = np.full(4000, 1.3e-3)
    setpoints[:10] = 0.0

    with pytest.raises(ConfigError, match="end stops"):
        run(Machine().record(setpoints), paper_parameters(), ("w",))


@pytest.mark.long
def test_loads_air_and_lands_of_the_data_sheet_are_carried() -> None:
    """The plain model misses this machine by far more than the noise."""
    options = replace(
        PlantOptions.bench(),
        air=EntrainedAir(air_fraction=0.02, air_exponent=1.4),
        lands=MeteringLands(gain_pb=0.84),
        loads=(ConstantLoad(load_force=4e3),),
    )
    parameters = replace(paper_parameters(), w=0.022, E=1.4e9, m=24.0)
    machine = Machine(parameters=parameters, options=options)
    record = AxisRecord.of(
        machine.record(random_steps(0.5e-3, 1e-3, 34, 100)), "axis1", FULL_OPENING
    )
    names = ("w", "E", "m")
    known = replace(paper_parameters(), E=1.3e9)

    found = identify(record, known, options, step=STEP, names=names, starts=1)

    assert np.all(found.residual < 1.1)
    for estimate in found.told:
        true = getattr(parameters, estimate.name)
        assert abs(estimate.value - true) < 4.0 * estimate.deviation
    assert {estimate.name for estimate in found.told} == {"w", "E", "m"}


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"bristles": LuGreFriction()}, "LuGre friction of this axis"),
        ({"supply": SupplyUnit(pump_flow=1e-3)}, "the supply unit of this axis"),
    ],
)
def test_extensions_with_states_of_their_own_are_refused(
    changes: dict[str, Any], named: str
) -> None:
    record = AxisRecord.of(
        Machine().record(random_steps(0.5e-3, 1e-3, 34, 100)), "axis1", FULL_OPENING
    )

    with pytest.raises(ConfigError, match=f"cannot carry {named}.*no recording shows"):
        identify(record, paper_parameters(), replace(PlantOptions.bench(), **changes))
