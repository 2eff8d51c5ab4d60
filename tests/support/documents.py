"""What the documents hold: fenced blocks, commands, inline code, links and headings."""

import functools
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("examples/**/*.md")])
SHELLS = ("sh", "console", "text", "")

_FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_INLINE = re.compile(r"(?<!`)`([^`]+)`(?!`)")
_TABLE = re.compile(r"(?:^ *\|.*\n?)+", re.MULTILINE)
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_HEADING = re.compile(r"^#+ (.*)$", re.MULTILINE)
_ENDS_A_COMMAND = {"&&", "||", "|", ";", "&", ">", ">>", "<"}


class Block(NamedTuple):
    """A fenced block.

    Attributes:
        path: its document.
        line: of its first line of text, from 1.
        language: after the fence; empty without one.
        text: what stands in it.
    """

    path: Path
    line: int
    language: str
    text: str

    def __str__(self) -> str:
        return f"{self.path.relative_to(ROOT)}:{self.line}"


class Command(NamedTuple):
    """A command, as the shell splits it.

    Attributes:
        place: its document and line.
        words: the program first.
    """

    place: str
    words: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.place} {' '.join(self.words)}"


def blocks(*languages: str) -> list[Block]:
    """Return the fenced blocks of all documents in some languages."""
    return [
        Block(path, text.count("\n", 0, match.start()) + 2, *match.groups())
        for path in DOCUMENTS
        for text in [path.read_text(encoding="utf-8")]
        for match in _FENCE.finditer(text)
        if match[1] in languages
    ]


def commands(program: str) -> list[Command]:
    """Return each call of a program that stands in a line of a block."""
    return [
        Command(f"{block.path.relative_to(ROOT)}:{block.line + number}", tuple(words))
        for block in blocks(*SHELLS)
        for number, line in enumerate(block.text.splitlines())
        for words in split(line.removeprefix("$ "))
        if Path(words[0]).name == program
    ]


def remarks(program: str) -> list[Command]:
    """Return each call of a program in comments and docstrings of examples and benchmarks."""
    return [
        Command(f"{path.relative_to(ROOT)}:{number}", tuple(words))
        for pattern in ("examples/**/*.toml", "examples/**/*.py", "benchmarks/*.py")
        for path in sorted(ROOT.glob(pattern))
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
        for match in [re.fullmatch(rf"(?:#|    )? *({program} .*)", line)]
        if match
        for words in split(match[1])
        if words[0] == program
    ]


def split(line: str) -> Iterator[list[str]]:
    """Yield the commands of a line of shell, without comments and what is behind a ">".

    Yields:
        The words of each.
    """
    lexer = shlex.shlex(line, posix=True, punctuation_chars=True)
    lexer.whitespace_split = True
    words: list[str] = []
    try:
        tokens = list(lexer)
    except ValueError:  # prose or a picture, with an apostrophe in it
        return
    for token in [*tokens, ";"]:
        if token not in _ENDS_A_COMMAND:
            words.append(token)
        elif words:
            yield words
            words = []


@functools.cache
def inline_code() -> list[tuple[str, str]]:
    """Return document and text of each piece of code between two backquotes."""
    return [
        (str(path.relative_to(ROOT)), " ".join(match[1].split()))
        for path in DOCUMENTS
        for match in _INLINE.finditer(_FENCE.sub("", path.read_text(encoding="utf-8")))
    ]


def tables() -> list[tuple[Path, str]]:
    """Return document and lines of each table."""
    return [
        (path, table)
        for path in DOCUMENTS
        for table in _TABLE.findall(_FENCE.sub("", path.read_text(encoding="utf-8")))
    ]


def links() -> list[tuple[Path, str]]:
    """Return document and target of each link that leads to a file of ours."""
    return [
        (path, target)
        for path in DOCUMENTS
        for target in _LINK.findall(_FENCE.sub("", path.read_text(encoding="utf-8")))
        if ":" not in target
    ]


def anchors(path: Path) -> set[str]:
    """Return the anchors that GitHub gives the headings of a document."""
    text = _FENCE.sub("", path.read_text(encoding="utf-8"))
    return {
        re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")
        for heading in _HEADING.findall(text)
    }
