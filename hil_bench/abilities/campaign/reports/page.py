"""A page from a template: values are escaped, figures are inside."""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from hil_bench.abilities.campaign.identity import program_identity
from hil_bench.errors import about_file, whole_file
from hil_bench.figure_style import settle_layout
from hil_bench.outside.page import render_page

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_page(path: Path, template: str, content: Mapping[str, object]) -> None:
    """Write a page; one that cannot be written is a `ConfigError`.

    Args:
        path: of the page.
        template: the name of the template.
        content: what it names.
    """
    text = render_page(__package__, template, {"program": program_identity(), **content})
    with about_file(path), whole_file(path) as file:
        file.write_text(text, encoding="utf-8")


def svg_of(figure: "Figure") -> str:
    """Return a figure as the text of an SVG element, the same for the same figure."""
    from markupsafe import Markup  # noqa: PLC0415 - comes with jinja2

    settle_layout(figure)
    out = io.StringIO()
    figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    text = out.getvalue()
    return Markup(text[text.index("<svg") :])  # noqa: S704 - from matplotlib, which escapes texts
