"""Each parameter of a plant is declared once, as a row of a table; all else follows from it."""

import ast
import re
from dataclasses import fields
from itertools import chain
from pathlib import Path

import pytest

from hil_bench.bench.configuration import Origin, load_config
from hil_bench.plants.hydraulic_cylinder.model import extensions, load, options, parameters
from hil_bench.plants.hydraulic_cylinder.model.validation import ROWS

ROOT = Path(__file__).parents[3]
PLANTS = ROOT / "hil_bench" / "plants"
TABLES = {
    PLANTS / "hydraulic_cylinder" / "parameters.tsv": "configuration.md",
    PLANTS / "rotary" / "parameters.tsv": "rotary.md",
    ROOT / "hil_bench" / "devices" / "kinds" / "chain.tsv": "configuration.md",
    ROOT / "hil_bench" / "abilities" / "commissioning" / "plan.tsv": "commissioning.md",
}
"""With the document that explains their keys."""

TOGETHER = {"volume_a_cm3", "volume_b_cm3"}
"""Explained as what follows from the data sheet, which their default of 0 stands for."""

NO_USUAL = {"position_mm", "load_slope_deg", "angle_deg", "viscous_friction_n_m_s"} | {
    "load_viscous_n_m_s"
}
"""Limited by the stroke and to a right angle, any angle, and two that vary freely."""


def rows(table):
    head, *lines = table.read_text(encoding="utf-8").splitlines()
    return [dict(zip(head.split("\t"), line.split("\t"), strict=True)) for line in lines]


CYLINDER, ROTARY, *OTHERS = map(rows, TABLES)
OWN = [row for row in CYLINDER if row["group"] != "shared"]


def documented(text):
    """Yield key, unit, default and meaning of each row of the tables of a document."""
    for line in text.splitlines():
        cells = re.split(r" \| ", line.strip().removesuffix(" |"))
        if len(cells) < 4:
            continue
        keys, units, defaults, meaning = cells[-4:]
        names = re.findall(r"`(\w+)`", keys)
        for number, name in enumerate(names):
            many = len(names) > 1
            unit = units.split(", ")[number] if ", " in units and many else units
            default = defaults.split(", ")[number] if ", " in defaults and many else defaults
            yield name, unit, default, meaning


def default_of(row):
    """Return how a document writes the default of a row."""
    given = {"text": '"{}"', "a word": '"{}"', "points": "[]"}.get(row["accepts"], "{}")
    if row.get("example"):
        return "must be given"
    return row["absent"] or f"`{given.format(row['default'])}`"


def test_each_row_is_complete():
    for row in chain(CYLINDER, ROTARY, *OTHERS):
        has_none = row["accepts"] == "points"

        assert row["group"], row
        assert row["meaning"], row
        given = [row["default"], row["absent"], row.get("example", "")]
        assert given.count("") == 2 + has_none, row


def test_each_row_of_a_plant_has_its_ranges():
    for row in chain(CYLINDER, ROTARY):
        is_number = row["accepts"] not in {"text", "a word", "points", "true or false"}

        assert bool(row["usual"]) == bool(row["usually"]), row
        assert bool(row["possible"]) == bool(row["naturally"]), row
        if row["group"] != "tank":
            assert bool(row["usual"]) == (is_number and row["key"] not in NO_USUAL), row
        for limits in (row["usual"], row["possible"]):
            low, _, high = limits.partition("..")
            assert not limits or float(low or "-inf") < float(high or "inf"), row


def test_a_table_has_each_key_once():
    for table in (OWN, ROTARY):
        assert len({row["key"] for row in table}) == len(table)


RECORDS = {
    parameters.PlantParameters: ("parameters",),
    options.EndStop: ("end stop",),
    extensions.EntrainedAir: ("air",),
    extensions.LuGreFriction: ("bristles",),
    extensions.MeteringLands: ("lands",),
    extensions.Cushion: ("cushion_a",),
    extensions.VariablePump: ("pump",),
    extensions.SupplyUnit: ("supply unit",),
    extensions.CounterbalanceValve: ("counterbalance",),
    load.ConstantLoad: ("constant load",),
    load.SpringLoad: ("spring",),
    load.MassOnSlope: ("slope",),
    options.PlantOptions: ("options", "compensator", "cavitation"),
}
"""The groups whose rows are the numbers of a record."""

FOLLOWS = {"conductance"}
"""A number that follows from two keys."""


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.__name__)
def test_the_numbers_of_a_record_are_rows(record):
    numbers = {
        field.name
        for field in fields(record)
        if field.type in (float, float | None) and field.name not in FOLLOWS
    }
    keys = [key for group in RECORDS[record] for key in ROWS.groups[group]]

    assert {key.field or key.name for key in keys} - {"signed_root"} == numbers
    for key in keys:
        said = re.search(
            rf"^ +{key.field}: (?:.|\n)*?\[([^\]]+)\]", record.__doc__ or "", re.MULTILINE
        )
        unit = "" if said is None or said[1] == "-" else said[1]
        assert not key.field or said is None or unit == key.unit.si


def test_no_module_declares_a_key_of_a_table():
    names = {row["key"] for row in (*CYLINDER, *ROTARY)} - {"oil", "model", "supply"}
    second = []
    for path in (*PLANTS.rglob("*.py"), *(ROOT / "hil_bench" / "bench").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Key":
                first = node.args[0] if node.args else None
                if isinstance(first, ast.Constant) and first.value in names:
                    second.append(f"{path.name}: {first.value}")
            if isinstance(node, ast.Dict):
                second += [
                    f"{path.name}: {key.value}"
                    for key, value in zip(node.keys, node.values, strict=True)
                    if isinstance(key, ast.Constant)
                    and key.value in names
                    and isinstance(value, ast.Call)
                    and getattr(value.func, "id", "") == "Range"
                ]
    assert second == []


def test_one_module_reads_files_of_toml():
    others = {
        "cli/arguments.py",  # a single value of the command line
        "abilities/campaign/shrink.py",  # its own text, read again
        "abilities/evidence/content.py",  # what the distribution itself carries
    }
    house = ROOT / "hil_bench"

    found = {
        path.relative_to(house).as_posix()
        for path in house.rglob("*.py")
        if "import tomllib" in path.read_text(encoding="utf-8")
    }

    assert found == {"config/document.py"} | others


def test_the_sheet_of_a_key_is_the_one_that_determines_it(write):
    # Every datum of the four sheets: what they determine are the rows of these sheets.
    config = load_config(
        write(
            "[plant.axis1]\nbore_mm = 63\nrod_mm = 36\nstroke_mm = 500\nrated_flow_l_min = 60\n"
            "rated_pressure_drop_bar = 5\noverlap_percent = 15\nfrequency_90deg_hz = 40\n"
            "ratio_a_b = 2\nflow_at_half_opening_percent = 60\nnull_leakage_l_min = 1.5\n"
            'null_leakage_pressure_bar = 210\noil = "HLP 46"\nsupply = "unit"\n'
            "pump_displacement_cm3 = 28\npump_speed_rpm = 1450\nrelief_pressure_bar = 210\n"
        )
    )

    derived = {each.key.name for each in config.settings if each.origin is Origin.DATA_SHEET}

    assert derived == {row["key"] for row in OWN if row["sheet"] and row["group"] != "sheet"}


@pytest.mark.parametrize("table", TABLES, ids=lambda path: path.name)
def test_the_document_says_what_the_rows_say(table):
    said = {*documented((ROOT / "docs" / TABLES[table]).read_text(encoding="utf-8"))}

    for row in rows(table):
        unit = row["unit"].removesuffix("/2").removesuffix(" in ns")
        meaning = ": ".join(part for part in (row.get("symbol"), row["meaning"]) if part)
        if row["key"] not in TOGETHER and row["group"] != "shared":
            assert (row["key"], unit, default_of(row), meaning) in said
