"""The page of a pack: HTML that opens offline, made of the same content as the JSON."""

from collections.abc import Mapping

from hil_bench.outside.page import render_page


def page_html(content: Mapping[str, object]) -> str:
    """Return a pack's content as HTML."""
    return render_page(__package__, "page.html.j2", {"pack": content}, _shown)


def _shown(value: object) -> object:
    return f"{value:.6g}" if isinstance(value, float) else "–" if value is None else value
