"""Records of machines that the model lacks: are they refused, or does it not matter?

Run: `python benchmarks/identification_misfits.py [WORD ...]`, for all machines or for those whose
names have a word.

Each machine is Table I's with one thing that the fit does not have. It gives the two recordings of
`identification_rig.py`, P_A in the first and P_B in the second, and all parameters but the opening
are sought. Where the fit is accepted, what it has found predicts the same larger steps as there,
from rest to the end stop, and is compared with the machine. Prints Markdown.
"""

import argparse
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

import occasion
from hil_bench.abilities.identification.identify import Identification, identify
from hil_bench.abilities.identification.record import join_records
from hil_bench.abilities.identification.report import find_misses
from hil_bench.plants.hydraulic_cylinder.model import (
    Cushion,
    EntrainedAir,
    LoadSeries,
    LuGreFriction,
    MeteringLands,
    PlantOptions,
    PlantParameters,
    paper_parameters,
)
from identification import BRIEF_SOUGHT, FULL_OPENING
from identification_rig import (
    SOUGHT,
    Values,
    as_set,
    compare,
    first_setpoints,
    record,
    second_setpoints,
    setup_of,
)

STEP = 1e-4  # [s]
BAND = 0.01 * FULL_OPENING
BENCH, TABLE_1 = PlantOptions.bench(), paper_parameters()


@dataclass(frozen=True, slots=True, kw_only=True)
class Strange:
    """A machine that has what the model lacks.

    Attributes:
        name: in words.
        parameters: of the machine.
        options: of it.
        spool: what the valve makes of the set-points that are recorded.
        second: parameters in the second recording, where they differ.
    """

    name: str
    parameters: PlantParameters = field(default_factory=paper_parameters)
    options: PlantOptions = field(default_factory=PlantOptions.bench)
    spool: Callable[[Values], Values] = as_set
    second: PlantParameters | None = None


def stick(setpoints: Values) -> Values:
    """Return the position of a spool that stays until its set-point is `BAND` away."""
    place, places = 0.0, []
    for setpoint in setpoints.tolist():
        place = setpoint if abs(setpoint - place) > BAND else place
        places.append(place)
    return np.array(places)


def play(setpoints: Values) -> Values:
    """Return the position of a spool whose hysteresis is `BAND` wide: a backlash."""
    place, places = 0.0, []
    for setpoint in setpoints.tolist():
        place = min(max(place, setpoint - 0.5 * BAND), setpoint + 0.5 * BAND)
        places.append(place)
    return np.array(places)


def return_line() -> PlantOptions:
    """Return options with a throttle for all oil that leaves: 3 bar at an opening of 0.45 mm."""
    edge = TABLE_1.w * 0.45e-3
    area = edge * math.sqrt(0.5 * (TABLE_1.P_S - TABLE_1.P_T) / 3e5)
    whole = Cushion(length=1.99 * TABLE_1.h, orifice=math.sqrt(4.0 * area / math.pi))
    return replace(BENCH, cushion_a=whole, cushion_b=whole)


def drifted(share: float) -> PlantParameters:
    """Return a machine whose valve passes less by a share."""
    return replace(TABLE_1, w=(1.0 - share) * TABLE_1.w)


def strange_machines() -> list[Strange]:
    """Return the machines."""
    air = replace(BENCH, air=EntrainedAir(air_fraction=0.02, air_exponent=1.4))
    load = LoadSeries(times=(0.0, 3.3, 3.3), forces=(0.0, 0.0, 500.0))
    return [
        Strange(name="none: the model's own"),
        Strange(name="2 % of air in the soft oil of Table I (100 MPa)", options=air),
        Strange(
            name="2 % of air in oil of 1.4 GPa", parameters=replace(TABLE_1, E=1.4e9), options=air
        ),
        Strange(
            name="spool overlap of 0.3 mm one way, 0.4 mm the other",
            options=replace(BENCH, beta_negative=0.4e-3),
        ),
        Strange(name="supply of 85 bar, 100 bar configured", parameters=replace(TABLE_1, P_S=85e5)),
        Strange(name="return line of 3 bar at speed", options=return_line()),
        Strange(
            name="flow that saturates, s = 1",
            options=replace(BENCH, lands=MeteringLands(saturation=1.0)),
        ),
        Strange(
            name="edge P-B of 0.84 times the others",
            options=replace(BENCH, lands=MeteringLands(gain_pb=0.84)),
        ),
        Strange(name="spool that sticks within 1 %", spool=stick),
        Strange(name="hysteresis of the valve, 1 %", spool=play),
        Strange(
            name="friction with bristles (LuGre)", options=replace(BENCH, bristles=LuGreFriction())
        ),
        Strange(name="1 % less flow in the second recording", second=drifted(0.01)),
        Strange(name="4 % less flow in the second recording", second=drifted(0.04)),
        Strange(
            name="load of 500 N from 3.3 s of each recording on",
            options=replace(BENCH, loads=(load,)),
        ),
    ]


def fit(machine: Strange, sought: Sequence[str]) -> Identification:
    """Estimate the parameters of a machine from both of its recordings."""
    source = np.random.default_rng(7)
    runs = (
        (machine.parameters, first_setpoints(), "P_A"),
        (machine.second or machine.parameters, second_setpoints(), "P_B"),
    )
    records = [
        record(
            setup_of(parameters, machine.options, dt=STEP),
            setpoints,
            pressure,
            source,
            machine.spool,
        )
        for parameters, setpoints, pressure in runs
    ]
    return identify(join_records(records), TABLE_1, BENCH, step=STEP, names=sought, starts=1)


def main() -> None:
    """Identify, and print what is said."""
    parser = argparse.ArgumentParser()
    parser.add_argument("words", nargs="*", metavar="WORD")
    args = occasion.arguments(parser, words=["none:"])
    sought = BRIEF_SOUGHT if args.brief else SOUGHT
    print("| machine | residuals | what is said | predicts | processor time |")
    print("|---|---|---|---|---|")
    for machine in strange_machines():
        if args.words and not any(word in machine.name for word in args.words):
            continue
        start = time.process_time()
        found = fit(machine, sought)
        seconds = time.process_time() - start
        misses, errors = find_misses(found), ""
        if not misses:
            speed, pressure, arrival = np.array(
                compare(machine.parameters, found.parameters, machine.options, machine.spool)
            ).max(axis=0)
            errors = f"{speed:.2%}, {pressure / 1e5:.2f} bar, {arrival * 1e3:.0f} ms"
        residuals = ", ".join(f"{value:.2f}" for value in found.residual)
        more = f"; and {len(misses) - 1} more" if len(misses) > 1 else ""
        said = f"refused: {misses[0]}{more}" if misses else "accepted"
        print(f"| {machine.name} | {residuals} | {said} | {errors} | {seconds:.0f} s |", flush=True)


if __name__ == "__main__":
    main()
