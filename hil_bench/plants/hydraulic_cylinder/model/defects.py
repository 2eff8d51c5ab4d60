"""Defects of a plant: wear and breakage as changed parameters.

Each defect is an amount that may grow and go away while the plant runs. The equations stay those of
the model; a defect changes the constants in them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from hil_bench.plants.hydraulic_cylinder.model.constants import (
    RELIEF_PRESSURE,
    pack,
    pack_extended,
)
from hil_bench.plants.hydraulic_cylinder.model.extensions import (
    EntrainedAir,
    MeteringLands,
    SupplyUnit,
)
from hil_bench.plants.hydraulic_cylinder.model.load import (
    ConstantLoad,
    Load,
    LoadSeries,
    MassOnSlope,
)
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters

MOST_AIR = 0.5
"""Largest share of air that the mixture law takes [-]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Defects:
    """The amounts of all defects; 0 is sound.

    Attributes:
        internal_leakage: adds to C_L [m³/(s Pa)].
        leakage_a: adds to C_LA, from chamber A to the tank [m³/(s Pa)].
        leakage_b: adds to C_LB, from chamber B to the tank [m³/(s Pa)].
        entrained_air: adds to the volume of air in the oil at atmospheric pressure [-].
        null_opening: adds to x_0, the opening that leaks in the centre of the valve [m].
        dry_friction: adds to F_c and F_s [N].
        load_loss: share of the loads, with their mass, that is gone [-].
        pump_loss: share of the pump's flow that is lost [-].
        relief_sag: by how much the relief valve opens too early [Pa].
        gas_loss: share of the accumulator's gas that is gone [-].
        filter_clogging: share of the filter's element that is blocked [-].
    """

    internal_leakage: float = 0.0
    leakage_a: float = 0.0
    leakage_b: float = 0.0
    entrained_air: float = 0.0
    null_opening: float = 0.0
    dry_friction: float = 0.0
    load_loss: float = 0.0
    pump_loss: float = 0.0
    relief_sag: float = 0.0
    gas_loss: float = 0.0
    filter_clogging: float = 0.0

    @property
    def needs_extension(self) -> bool:
        """Return True if the paper's equations cannot hold them."""
        amounts = (self.leakage_a, self.leakage_b, self.entrained_air, self.null_opening)
        return any(amounts)


def pack_defective(
    parameters: PlantParameters,
    options: PlantOptions,
    dt: float,
    defects: Defects,
    *,
    is_extended: bool,
) -> Sequence[float]:
    """Return the constants of a plant with defects, as `pack` or `pack_extended` give them.

    Args:
        parameters: of the sound plant.
        options: of the sound plant.
        dt: step [s].
        defects: what is wrong with it.
        is_extended: whether it runs the extended kernels.
    """
    worn = replace(
        parameters,
        C_L=parameters.C_L + defects.internal_leakage,
        F_c=parameters.F_c + defects.dry_friction,
        F_s=parameters.F_s + defects.dry_friction,
    )
    if not is_extended:
        return pack(worn, options, dt)
    changed = replace(
        options,
        C_LA=options.C_LA + defects.leakage_a,
        C_LB=options.C_LB + defects.leakage_b,
        air=_aerate(options.air, defects.entrained_air),
        lands=_round_off(options.lands, defects.null_opening),
        supply=None if options.supply is None else wear_supply(options.supply, defects),
        loads=tuple(_lighten(load, 1.0 - defects.load_loss) for load in options.loads),
    )
    row = list(pack_extended(worn, changed, dt))
    # A relief valve that is stuck open lets the pressure fall below the accumulator's precharge,
    # which no one would configure.
    row[RELIEF_PRESSURE] = max(row[RELIEF_PRESSURE] - defects.relief_sag, 0.0)
    return row


def _aerate(air: EntrainedAir | None, more: float) -> EntrainedAir | None:
    if not more:
        return air
    if air is None:
        return EntrainedAir(air_fraction=min(more, MOST_AIR))
    return replace(air, air_fraction=min(air.air_fraction + more, MOST_AIR))


def _round_off(lands: MeteringLands | None, more: float) -> MeteringLands | None:
    if not more:
        return lands
    lands = MeteringLands() if lands is None else lands
    return replace(lands, null_opening=lands.null_opening + more)


def wear_supply(unit: SupplyUnit, defects: Defects) -> SupplyUnit:
    """Return a unit with what its pump, its accumulator and its filter have lost."""
    element = unit.filter
    return replace(
        unit,
        pump_flow=unit.pump_flow * (1.0 - defects.pump_loss),
        accumulator_volume=unit.accumulator_volume * (1.0 - defects.gas_loss),
        filter=None if element is None else element.clogged(defects.filter_clogging),
    )


def _lighten(load: Load, share: float) -> Load:
    """Return the load reduced to a share; a spring stays."""
    if share == 1.0:
        return load
    if isinstance(load, ConstantLoad):
        return replace(load, load_force=load.load_force * share)
    if isinstance(load, MassOnSlope):
        return replace(load, load_mass=load.load_mass * share)
    if isinstance(load, LoadSeries):
        return replace(load, forces=tuple(force * share for force in load.forces))
    return load
