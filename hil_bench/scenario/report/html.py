"""The report as one HTML file that opens offline: no script, nothing from elsewhere."""

import base64

from hil_bench.errors import ConfigError
from hil_bench.scenario.report.content import Report


def report_html(report: Report) -> str:
    """Return a report as HTML; whatever names and texts hold, they stay text.

    Raises:
        ConfigError: Jinja2 is not installed.
    """
    try:
        import jinja2  # noqa: PLC0415 - an extra
    except ImportError:
        right = "install it with: pip install 'hil-bench[report]'"
        raise ConfigError(f"a report needs Jinja2; {right}") from None
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("hil_bench.scenario.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        finalize=_shown,
    )
    environment.filters["data_uri"] = _data_uri
    return environment.get_template("report.html.j2").render(report=report)


def _shown(value: object) -> object:
    return f"{value:.4g}" if isinstance(value, float) else "" if value is None else value


def _data_uri(picture: bytes) -> str:
    return "data:image/svg+xml;base64," + base64.b64encode(picture).decode("ascii")
