"""The content of a pack in a form for JSON; the page shows the same."""

from collections.abc import Mapping, Sequence
from typing import Any

WORST_FIRST = ("failed", "inconclusive", "not exercised", "passed")


def summarise(pack: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return a line a section that has a verdict.

    Args:
        pack: with `plant`, `conformance`, `determinism` and `traceability`.
    """
    plant, devices = pack["plant"], pack["conformance"]
    runs = pack["determinism"]["runs"]
    requirements = pack["traceability"]["requirements"]
    digests = sorted({run["digest"] for run in runs})
    shown = f"{len(digests)} digests" if len(digests) > 1 else f"one digest, {digests[0][:12]}"
    return [
        _line("plant", _worst(plant), f"{_counts(plant, 'verdict')} of {len(plant)} checks"),
        _line("conformance", _worst(devices), _device_counts(devices)),
        _line("determinism", pack["determinism"]["verdict"], f"{len(runs)} runs, {shown}"),
        _line(
            "traceability",
            pack["traceability"]["verdict"],
            f"{_counts(requirements, 'outcome')} of {len(requirements)} requirements"
            if requirements
            else "no requirement in the results"
            if pack["traceability"]["files"]
            else "no results were given",
        ),
    ]


def _line(section: str, verdict: str, text: str) -> dict[str, str]:
    return {"section": section, "verdict": verdict, "text": text}


def _worst(items: Sequence[Mapping[str, Any]]) -> str:
    """Return the verdict on all; without any that applies, there is none."""
    verdicts = {item["verdict"] for item in items}
    return next((verdict for verdict in WORST_FIRST if verdict in verdicts), "not applicable")


def _counts(items: Sequence[Mapping[str, Any]], key: str) -> str:
    found = [item[key] for item in items]
    return ", ".join(f"{found.count(verdict)} {verdict}" for verdict in dict.fromkeys(found))


def _device_counts(devices: Sequence[Mapping[str, Any]]) -> str:
    totals: dict[str, int] = {}
    for device in devices:
        for outcome, count in device.get("counts", {}).items():
            totals[outcome] = totals.get(outcome, 0) + count
    always = "passed", "failed", "not applicable"
    shown = {name: count for name, count in totals.items() if count or name in always}
    counts = ", ".join(f"{count} {outcome}" for outcome, count in shown.items())
    what = "device" if len(devices) == 1 else "devices"
    return f"{len(devices)} {what}" + (f": {counts}" if counts else "")
