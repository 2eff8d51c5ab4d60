"""A page from a template: values are escaped, figures are inside."""

import io
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from hil_bench.campaign.identity import program_identity
from hil_bench.errors import ConfigError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_page(path: Path, template: str, content: Mapping[str, object]) -> None:
    """Write a page.

    Args:
        path: of the page.
        template: the name of the template.
        content: what it names.

    Raises:
        ConfigError: it cannot be written.
    """
    from jinja2 import DictLoader, Environment, StrictUndefined  # noqa: PLC0415 - an extra

    folder = resources.files("hil_bench.campaign.reports")
    sources = {
        name: folder.joinpath(name).read_text(encoding="utf-8") for name in ("base.html", template)
    }
    environment = Environment(
        loader=DictLoader(sources),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    text = environment.get_template(template).render(program=program_identity(), **content)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from None


def svg_of(figure: "Figure") -> str:
    """Return a figure as the text of an SVG element, the same for the same figure."""
    from markupsafe import Markup  # noqa: PLC0415 - comes with jinja2

    out = io.StringIO()
    figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    text = out.getvalue()
    return Markup(text[text.index("<svg") :])  # noqa: S704 - from matplotlib, which escapes texts
