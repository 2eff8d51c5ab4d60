"""The help of a verb on a narrow terminal: descriptions and examples as written, where they fit."""

import argparse
import textwrap
from collections.abc import Generator, Iterator
from itertools import groupby

_COMMENT_INDENT = 8  # of an example's comment that has no room behind its command
_FAR = 20  # leading spaces of a line that goes on with the comment above


class HelpFormatter(argparse.RawDescriptionHelpFormatter):
    """Wraps what is wider than the terminal, and leaves the rest as it is."""

    def _iter_indented_subactions(
        self, action: argparse.Action
    ) -> Generator[argparse.Action, None, None]:
        # Verbs stand below the headings of their groups.
        headings = getattr(action, "headings", None)
        if headings is None:
            yield from super()._iter_indented_subactions(action)
            return
        widest = (
            self._current_indent + 2 * self._indent_increment + max(map(len, action.choices or ()))
        )
        self._action_max_length = max(self._action_max_length, widest)
        yield from headings

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        lines: list[str] = []
        for is_indented, group in groupby(text.splitlines(), key=lambda line: line[:1] == " "):
            block = list(group)
            if max(map(len, block)) <= width:
                lines += block
            elif is_indented:
                lines += _wrapped_examples(block, width)
            else:
                lines += _wrapped_paragraphs(block, width)
        return "\n".join(indent + line for line in lines)


def _wrapped_paragraphs(block: list[str], width: int) -> Iterator[str]:
    for is_text, group in groupby(block, key=bool):
        if is_text:
            yield from textwrap.wrap(" ".join(group), width, break_on_hyphens=False)
        else:
            yield from group


def _wrapped_examples(block: list[str], width: int) -> Iterator[str]:
    """Yield examples, the comment of each on lines of its own where one does not fit."""
    gap = " " * _COMMENT_INDENT
    for line in block:
        start = len(line) - len(line.lstrip())
        command, _, comment = line[start:].partition("   ")
        if start >= _FAR:
            start, command, comment = 0, "", line
        if command.startswith("hil-bench"):
            yield " " * start + command  # in one piece, to be copied
        elif command:
            further = " " * (start + 2)
            yield from textwrap.wrap(" " * start + command, width, subsequent_indent=further)
        if comment.strip():
            yield from textwrap.wrap(
                comment.strip(), width, initial_indent=gap, subsequent_indent=gap
            )
