"""The page of a pack: HTML that opens offline, made of the same content as the JSON."""

from collections.abc import Mapping

from hil_bench.errors import ConfigError


def page_html(content: Mapping[str, object]) -> str:
    """Return a pack's content as HTML; whatever names and texts hold, they stay text.

    Raises:
        ConfigError: Jinja2 is not installed.
    """
    try:
        import jinja2  # noqa: PLC0415 - an extra
    except ImportError:
        right = "install it with: pip install 'hil-bench[report]'"
        raise ConfigError(f"an evidence pack needs Jinja2; {right}") from None
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("hil_bench.machine.conformance.evidence", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_shown,
    )
    return environment.get_template("page.html.j2").render(pack=content)


def _shown(value: object) -> object:
    return f"{value:.6g}" if isinstance(value, float) else "–" if value is None else value
