"""A motor of round numbers, built from a file as users build theirs."""

from collections.abc import Callable
from pathlib import Path

from hil_bench.plants.rotary.configuration import RotaryConfig
from hil_bench.plants.rotary.kind import HydraulicMotor

STEP = 50e-6

VALVE = """
[nodes]
valve = { profile = "valve_408", node_id = 1 }
"""

LOSSLESS = {
    "kind": '"rotary"',
    "displacement_cm3_rev": 62.83185307179586,  # 1e-5 m³/rad
    "inertia_kg_m2": 0.05,
    "volume_a_cm3": 200,
    "volume_b_cm3": 200,
    "coulomb_friction_n_m": 0,
    "bulk_modulus_mpa": 1000,
    "oil_density_kg_m3": 850,
    "rated_flow_l_min": 60,
    "rated_pressure_drop_bar": 35,
    "overlap_percent": 0,
    "frequency_90deg_hz": 100,
    "supply_pressure_bar": 210,
}
"""D = 1e-5 m³/rad: 1 bar makes 1 N m, 60 l/min make 100 rad/s."""

Motor = Callable[..., tuple[RotaryConfig, HydraulicMotor]]


def write_bench(folder: Path, keys: dict[str, object], rest: str = VALVE) -> Path:
    """Write a bench with one motor; a key that is None is left out."""
    path = folder / "bench.toml"
    lines = [f"{name} = {value}" for name, value in keys.items() if value is not None]
    path.write_text("[plant.axis1]\n" + "\n".join(lines) + "\n" + rest)
    return path
