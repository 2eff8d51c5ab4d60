"""The areas that ``benchmarks/mutation.py`` mutates, and the tests that must notice."""

from pathlib import Path
from typing import Final

_ROOT: Final = Path(__file__).resolve().parent.parent


def _files(folder: str, names: str, prefix: str = "") -> list[str]:
    """Return the paths of Python files in a folder."""
    return [f"{folder}/{prefix}{name}.py" for name in names.split()]


def _tests(folder: str, names: str) -> list[str]:
    """Return the paths of test files beside the code."""
    return _files(f"tests/unit/{folder}".rstrip("/"), names, "test_")


PACKAGES: Final = {
    folder.name: sorted(
        str(path.relative_to(_ROOT)) for path in folder.rglob("*.py") if path.stat().st_size
    )
    for folder in (
        *sorted((_ROOT / "hil_bench").iterdir()),
        *sorted((_ROOT / "hil_bench/abilities").iterdir()),
        _ROOT / "drivers",
    )
    if ((folder / "__init__.py").exists() and folder.name != "abilities")
    or folder.name == "drivers"
}
"""All modules of each package and ability. Its tests are those that run the changed line."""

KERNELS: Final = "hil_bench/plants/hydraulic_cylinder/model/"
"""Modules whose tests run with `NUMBA_DISABLE_JIT=1`: what Numba has cached has no mutant in it."""

_DIALOGUES: Final = ["tests/transcripts/test_transcripts.py"]
_REFEREE: Final = ["tests/referee/test_referee.py"]
_VALVE: Final = "valve_limits valve_state_machine valve_408 valve_demand valve_ramp"

AREAS: Final = {
    "sdo": _files("hil_bench/canopen_device", "sdo sdo_block sdo_channels sdo_transfer"),
    "pdo": _files("hil_bench/canopen_device", "rpdo tpdo pdo_mapping pdo_parameters"),
    "sync": _files("hil_bench/canopen_device", "sync"),
    "valve": _files(
        "hil_bench/devices",
        "valve_408 valve_state_machine demand_generator deviation_monitor motion_profiles",
    ),
    "limits": [
        *_files("hil_bench/canopen_device", "object_dictionary"),
        *_files("hil_bench/devices", "encoder_406 profile_objects"),
        *_files("hil_bench/abilities/commissioning", "plan rig"),
        *_files("drivers/hil_drivers", "valve"),
    ],
    "lock-step": _files("hil_bench/abilities/lockstep", "lockstep links"),
    "verdict": [
        *_files(
            "hil_bench/abilities/scenario",
            "build dimensions examination judgement monitor nodes operators parse",
        ),
        *_files(
            "hil_bench/abilities/scenario",
            "reach recorded resolve results streams syntax values witness",
        ),
        *_files("hil_bench/abilities/campaign", "records"),
        *_files("hil_bench/abilities/scenario/verbs", "scenario_report"),
        *_files("hil_bench/cli", "exit_codes"),
    ],
    "modbus": [
        *_files("hil_bench/abilities/modbus/protocol", "register_map mailbox unit_image"),
        *_files("hil_bench/abilities/modbus/server", "session pdu register_server connections"),
    ],
    **PACKAGES,
}
"""Modules of each area."""

TESTS: Final = {
    "sdo": [
        *_DIALOGUES,
        *_tests("canopen_device", "boundaries flags_and_ranges sdo_ends sdo sdo_block"),
        *_tests("canopen_device", "sdo_dialogue"),
    ],
    "pdo": [
        *_DIALOGUES,
        *_tests("canopen_device", "boundaries flags_and_ranges pdo_ends pdo_mapping"),
        *_tests("canopen_device", "shared_rounds node"),
    ],
    "sync": [
        *_DIALOGUES,
        *_tests("canopen_device", "boundaries flags_and_ranges sync_parameters sync"),
        *_tests("canopen_device", "pdo_ends shared_rounds node"),
    ],
    "valve": _tests("devices", f"{_VALVE} valve_deviation valve_supervision ramp compensation"),
    "verdict": [
        *_REFEREE,
        *_tests("scenario", "coverage language recorded evaluation"),
    ],
    "hil_bench/abilities/scenario/recorded.py": [
        *_REFEREE,
        *_tests("scenario", "coverage language recorded evaluation"),
        *_tests("recording", "column_units"),
    ],
    "hil_bench/abilities/scenario/resolve.py": [
        *_REFEREE,
        *_tests("scenario", "files run recorded"),
    ],
    "hil_bench/abilities/scenario/results.py": _tests("cli", "test scenario_run"),
    "hil_bench/abilities/scenario/witness.py": [
        *_tests("scenario", "run coverage run_faults registers"),
        *_tests("cli", "machine_test"),
    ],
    "hil_bench/abilities/campaign/records.py": _tests("campaign", "campaign reports bad_input"),
    "hil_bench/cli/exit_codes.py": [*_REFEREE, *_tests("cli", "test scenario_run")],
    "hil_bench/abilities/scenario/verbs/scenario_report.py": _tests("cli", "test scenario_run"),
    "lock-step": _tests("lockstep", "ends links lockstep"),
    "modbus": [
        *_tests("modbus", "data_types mailbox mailbox_resumed rivals unit_image"),
        *_tests("modbus/server", "pdu framing session readers register_server connections"),
        *_tests("modbus/binding", "control values"),
    ],
    # The area of limits spans packages, so each of its modules has its own.
    "hil_bench/canopen_device/object_dictionary.py": [
        *_DIALOGUES,
        *_tests("canopen_device", "object_dictionary flags_and_ranges sdo eds"),
    ],
    "hil_bench/devices/encoder_406.py": _tests(
        "devices", "measuring_range unsigned_range encoder_406"
    ),
    "hil_bench/devices/profile_objects.py": _tests(
        "devices", "valve_limits measuring_range encoder_406"
    ),
    "hil_bench/abilities/commissioning/plan.py": _tests("commissioning", "rig session"),
    "hil_bench/abilities/commissioning/rig.py": _tests("commissioning", "rig session restoring"),
    "drivers/hil_drivers/valve.py": _tests(
        "drivers", "valve valve_setup_limits valve_without_setup device"
    ),
}
"""Test files of each area, or of a module."""
