"""Texts from outside in Markdown: what a device says is no HTML, no code and no link."""

import re
from html import escape

_MARKUP = re.compile(r"[\\`\[\]]")
"""Characters by which text becomes code or a link, and the one that escapes them."""


def plain(text: str) -> str:
    """Return text as Markdown that shows it as it is, in one line."""
    return _MARKUP.sub(r"\\\g<0>", escape(" ".join(text.split()), quote=False))


def cell(text: str) -> str:
    """Return the same for a cell of a table."""
    return plain(text).replace("|", "\\|")
