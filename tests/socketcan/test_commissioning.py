"""Commissioning on real SocketCAN: `hil-bench run` plays the machine, of which the other side is
told nothing. In lock-step on SYNC, so that no verdict depends on how fast this computer is.
"""

import re

import pytest
from support.machines import AIR, OIL, SOUND, SWAPPED, WRONG_REVISION, with_fault

from hil_bench.cli import main

PLAN = """
[limits]
position_mm = [-150, 150]
speed_mm_s = 400
pressure_bar = [-1, 110]
[communication]
[direction]
"""
SLOW = f"[plan]\nperiod_ms = 4\n{PLAN}"
OSCILLATION = f"[plan]\nperiod_ms = 2\n{PLAN}[chirp]\n"


@pytest.fixture
def commission(start_bench, channel, tmp_path, monkeypatch):
    """Commission a machine; return the exit code."""
    # Pictures are tested elsewhere.
    monkeypatch.setattr(
        "hil_bench.abilities.commissioning.report.importlib.util.find_spec", lambda _: None
    )

    def commission_machine(machine, sheet, plan):
        for name, text in (("machine", machine), ("sheet", sheet), ("plan", plan)):
            (tmp_path / f"{name}.toml").write_text(text, encoding="utf-8")
        period_ms = re.search(r"period_ms = (\d)", plan)[1]
        lockstep = ["--lockstep", "--sync-period-us", f"{period_ms}000"]
        start_bench(tmp_path / "machine.toml", *lockstep)
        files = [str(tmp_path / "plan.toml"), str(tmp_path / "sheet.toml")]
        bus = ["-i", "socketcan", "-c", channel, *lockstep]
        return main(["commission", *files, *bus, "--yes", "--output", str(tmp_path / "output")])

    return commission_machine


@pytest.mark.parametrize(
    ("machine", "sheet", "plan", "found"),
    [
        (SOUND, "", SLOW, []),
        (SOUND + OIL + AIR, OIL, OSCILLATION, ["air in the oil"]),
        (SWAPPED, "", SLOW, ["pressure sensors swapped"]),
        (with_fault("invert", "valve"), "", SLOW, ["valve inverted"]),
        (with_fault("freeze", "position"), "", SLOW, ["position sensor stuck"]),
        (WRONG_REVISION, "", SLOW, ["wrong EDS revision"]),
    ],
    ids=["sound", "air", "swapped", "inverted", "stuck", "revision"],
)
def test_what_is_wrong_with_a_machine_is_named(commission, capsys, machine, sheet, plan, found):
    assert commission(machine, sheet, plan) == (1 if found else 0)
    told, complaints = capsys.readouterr()
    assert re.findall(r"^found +([^:]*)", told, re.MULTILINE) == found
    assert complaints == ""
