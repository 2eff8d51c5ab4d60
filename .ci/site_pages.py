"""Pages of the site that are not in docs/: README, linked examples, what the code says of itself.

MkDocs calls the functions `on_...` (mkdocs.yml, `hooks`). The documents have links from file to
file, as they are read in the checkout; here these become links from page to page.
"""

import argparse
import ast
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from posixpath import relpath
from urllib.parse import urlsplit

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

import hil_bench
import hil_drivers
from hil_bench import cli
from hil_bench.cli.parser import own_verbs

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
VERBS = own_verbs()
_LINK = re.compile(r"(\]\()([^)\s#]+)((?:#[^)\s]*)?\))")
_FROM_A_HOST = re.compile(
    r"""<(?:(?:script|img|iframe|source)\b[^>]*\bsrc|link\b(?=[^>]*\brel="?(?:stylesheet|icon|preload|preconnect))[^>]*\bhref)="?((?:https?:)?//[^">\s]+)"""
)
_LANGUAGES = {
    ".toml": "toml",
    ".py": "python",
    ".md": "markdown",
    ".yml": "yaml",
    ".c": "c",
    ".h": "c",
    ".csv": "text",
}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages whose text is elsewhere."""
    pages = {
        "index.md": (ROOT / "README.md").read_text(encoding="utf-8"),
        "reference/command-line.md": command_line(),
        "reference/fixtures.md": fixtures(),
        "reference/hil_bench.md": public_names(
            "hil_bench", hil_bench.__doc__ or "", hil_bench.__all__
        ),
        "reference/hil_drivers.md": public_names(
            "hil_drivers", hil_drivers.__doc__ or "", hil_drivers.__all__
        ),
    }
    for path in linked_from_documents():
        pages[page_of(path)] = shown(path)
    for name, text in pages.items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn links from file to file into links from page to page."""
    del config, files
    here = page.file.src_uri
    source = source_of(here)

    def page_link(link: re.Match[str]) -> str:
        target = target_of(source, link[2])
        if target is None:
            return link[0]
        return f"{link[1]}{relpath(page_of(target), Path(here).parent.as_posix())}{link[3]}"

    return _LINK.sub(page_link, markdown)


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """Refuse a page that asks a host for a script, a style or a picture: the site opens offline.

    Raises:
        PluginError: it does.
    """
    del config
    found = _FROM_A_HOST.search(output)
    if found:
        raise PluginError(f"{page.file.src_uri}: the page asks a host for {found[1]}")
    return output


def source_of(page: str) -> Path:
    """Return the file whose links a page has."""
    if page == "index.md":
        return ROOT / "README.md"
    return DOCS / page if (DOCS / page).exists() else ROOT / page


def target_of(source: Path, link: str) -> Path | None:
    """Return the file or folder of the checkout that a link names, or None for an address."""
    if urlsplit(link).scheme:
        return None
    path = (source.parent / link).resolve()
    return path if path.exists() and path.is_relative_to(ROOT) else None


def page_of(path: Path) -> str:
    """Return the page, or picture, of a file or folder of the checkout."""
    if path.is_relative_to(DOCS):
        return (path / "README.md" if path.is_dir() else path).relative_to(DOCS).as_posix()
    name = path.relative_to(ROOT).as_posix()
    if name == "README.md":
        return "index.md"
    if path.is_dir():
        return f"{name}/index.md"
    return name if path.suffix == ".md" else f"{name}.md"


def linked_from_documents() -> Iterator[Path]:
    """Yield each file and folder outside docs/ that a document links, README apart."""
    seen = {ROOT / "README.md"}
    waiting = [ROOT / "README.md", *DOCS.rglob("*.md")]
    while waiting:
        document = waiting.pop()
        for link in _LINK.findall(document.read_text(encoding="utf-8")):
            target = target_of(document, link[1])
            if target is None or target in seen or target.is_relative_to(DOCS):
                continue
            seen.add(target)
            if target.suffix == ".md":
                waiting.append(target)
            yield target


def shown(path: Path) -> str:
    """Return the page of a file, or of all files of a folder; its README is its introduction."""
    if path.suffix == ".md":
        return path.read_text(encoding="utf-8")
    if path.is_file():
        return f"# {path.relative_to(ROOT).as_posix()}\n\n{_block(path)}"
    introduction = path / "README.md"
    head = (
        introduction.read_text(encoding="utf-8")
        if introduction.exists()
        else f"# {path.relative_to(ROOT).as_posix()}\n"
    )
    parts = [
        f"\n## {file.relative_to(path).as_posix()}\n\n{_block(file)}"
        for file in sorted(path.rglob("*"))
        if file.suffix in _LANGUAGES and file != introduction and "build" not in file.parts
    ]
    return head + "".join(parts)


def _block(path: Path) -> str:
    """Return a file as a block of code."""
    return f"````{_LANGUAGES.get(path.suffix, 'text')}\n{path.read_text(encoding='utf-8')}````\n"


def command_line() -> str:
    """Return each verb's help as it is printed."""
    parts = ["# Command line\n", f"```text\n{cli.build_parser((), VERBS).format_help()}```\n"]
    for verb in VERBS:
        parts.extend((f"## {verb}\n", f"```text\n{_parser(verb).format_help()}```\n"))
    return "\n".join(parts)


def _parser(verb: str) -> argparse.ArgumentParser:
    """Return the parser of a verb."""
    (verbs,) = (
        action
        for action in cli.build_parser((verb,), VERBS)._actions  # noqa: SLF001 - argparse names no other way
        if isinstance(action, argparse._SubParsersAction)  # noqa: SLF001
    )
    return verbs.choices[verb]


def fixtures() -> str:
    """Return the fixtures of the pytest plugin with their docstrings."""
    source = ROOT / "hil_bench" / "abilities" / "bench_fixtures" / "fixtures.py"
    parts = [
        "# Fixtures\n",
        "What a test may name as its parameters; see [Tests in pytest](../pytest.md).\n",
    ]
    for node in ast.parse(source.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef) and any(
            "fixture" in ast.unparse(mark) for mark in node.decorator_list
        ):
            if node.name.startswith("_"):
                continue
            parts.extend((f"## {node.name}\n", f"{ast.get_docstring(node)}\n"))
    return "\n".join(parts)


def public_names(package: str, introduction: str, names: list[str]) -> str:
    """Return the page of what a package exports, each name where it is defined."""
    module = import_module(package)
    parts = [f"# {package}\n", f"{introduction}\n"]
    for name in names:
        value = getattr(module, name)
        parts.append(f"::: {value.__module__}.{value.__qualname__}")
        parts.append(f"    options:\n      heading: {package}.{name}\n")
    return "\n".join(parts)
