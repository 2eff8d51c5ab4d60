"""Pages and Markdown: values are escaped."""

import base64
import re
from collections.abc import Callable, Mapping
from html import escape

from hil_bench.errors import ConfigError

# HTML pages that open offline, made from templates; whatever a value holds, it stays text.

POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
"""The Content-Security-Policy of a report: it loads nothing and runs nothing."""


def render_page(
    package: str,
    template: str,
    values: Mapping[str, object],
    shown: Callable[[object], object] | None = None,
) -> str:
    """Return a page.

    Args:
        package: that the template lies in, beside those that it extends.
        template: its name.
        values: what the template names.
        shown: what stands in the page for a value; None for the value itself.

    Raises:
        ConfigError: Jinja2 is not installed.
    """
    try:
        import jinja2  # noqa: PLC0415 - an extra
        import markupsafe  # noqa: PLC0415 - comes with it
    except ImportError:
        right = "install it with: pip install 'hil-bench[report]'"
        raise ConfigError(f"a page needs Jinja2; {right}") from None
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader(package, "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        finalize=shown,
    )
    environment.filters["data_uri"] = _data_uri
    environment.globals["policy"] = markupsafe.Markup(POLICY)  # noqa: S704 - ours, without markup
    return environment.get_template(template).render(values)


def _data_uri(picture: bytes) -> str:
    return "data:image/svg+xml;base64," + base64.b64encode(picture).decode("ascii")


# Texts from outside in Markdown: what a device says is no HTML, no code and no link.

_MARKUP = re.compile(r"[\\`\[\]]")
"""Characters by which text becomes code or a link, and the one that escapes them."""


def plain(text: str) -> str:
    """Return text as Markdown that shows it as it is, in one line."""
    return _MARKUP.sub(r"\\\g<0>", escape(" ".join(text.split()), quote=False))


def cell(text: str) -> str:
    """Return the same for a cell of a table."""
    return plain(text).replace("|", "\\|")
