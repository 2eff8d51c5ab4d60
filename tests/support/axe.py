"""Whether everybody can use a page, as axe-core judges it."""

from pathlib import Path

_AXE = Path(__file__).parents[1] / "browser" / "vendor" / "axe.min.js"


def serious_problems(page):
    """Return what axe-core finds serious or critical in a page, with the elements."""
    source = _AXE.read_text(encoding="utf-8")
    found = page.locator("html").evaluate(
        f"async () => {{ {source}; return (await axe.run()).violations; }}"
    )
    return [
        (each["id"], [node["html"] for node in each["nodes"]])
        for each in found
        if each["impact"] in {"serious", "critical"}
    ]
