"""A life of a file: it is written, read by verbs, edited, and read again."""

import contextlib
import io
import json
import os
import signal
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from generated.edits import Schema, edit, edit_cells
from generated.seeds import DIALECTS, shorten
from hypothesis import strategies as st

from hil_bench.cli import main
from hil_bench.cli.exit_codes import ExitCode

SLOW = 5.0
"""Processor time of a verb on one file that is reported [s]."""
_HANGS = 60.0


class HangsError(BaseException):
    """A verb takes more processor time than any file is worth."""


class Result(NamedTuple):
    """What a verb made of a file.

    Attributes:
        verb: its name.
        dialect: of the file.
        code: its exit code.
        wrong: what it should not have done; empty where all is well.
        took: processor time [s].
        words: its command line.
    """

    verb: str
    dialect: str
    code: int
    wrong: str
    took: float
    words: tuple[str, ...]


Lives = Iterator[tuple[Result, str]]


def run_verb(dialect: str, words: tuple[str, ...]) -> Result:
    """Run a verb in this process, and judge how it ends."""
    said, errors = io.StringIO(), io.StringIO()
    began = time.process_time()
    code, wrong = -1, ""
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(errors), _limited():
        try:
            code = main(words)
        except HangsError:
            wrong = "hangs"
        except BaseException as error:
            wrong = f"raised {type(error).__name__}: {error}"
    took = time.process_time() - began
    text = said.getvalue() + errors.getvalue()
    wrong = wrong or _find_wrong(code, text, errors.getvalue())
    return Result(words[0], dialect, code, wrong, took, words)


def _find_wrong(code: int, text: str, errors: str) -> str:
    if code not in set(ExitCode):
        return f"exit code {code} is not documented"
    if code == ExitCode.INTERNAL or "Traceback (most recent" in text:
        return f"exit {code}: {errors[-300:]}"
    if code == ExitCode.USAGE and "error: " not in errors:
        return "exit 2 without a message"
    unprintable = [line for line in text.split("\n") if not line.replace("\t", "").isprintable()]
    return f"prints {unprintable[0]!r}" if unprintable else ""


@contextlib.contextmanager
def _limited() -> Iterator[None]:
    def end(_number: int, _frame: object) -> None:
        raise HangsError

    before = signal.signal(signal.SIGVTALRM, end)
    signal.setitimer(signal.ITIMER_VIRTUAL, _HANGS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, before)


def live(draw: Any, root: Path, dialect: str, verb: str = "") -> Lives:
    """Yield what verbs make of a file after each of its edits, and its text."""
    form = DIALECTS[dialect]
    folder, text = draw(st.sampled_from(form.seeds))
    verbs = [words for words in form.verbs if verb in {"", words[0]}]
    path = root / folder / f"generated{form.suffix}"
    os.chdir(path.parent)
    document = {} if form.suffix == ".csv" else tomllib.loads(text)
    shorten(document)
    schema = Schema()
    for number in range(draw(st.integers(2, 6))):
        if form.suffix == ".csv":
            text = draw(edit_cells(text)) if number else text
        else:
            if number:
                draw(edit(document, schema))
                shorten(document)
            text = to_toml(document)
        path.write_text(text, encoding="utf-8")
        words = tuple(word.replace("{}", path.name) for word in draw(st.sampled_from(verbs)))
        with schema.listening():
            result = run_verb(dialect, words)
        left = [each for each in os.listdir(tempfile.gettempdir()) if "hil" in each]
        if left and not result.wrong:
            result = result._replace(wrong=f"leaves {left[0]}")
        yield result, text


def to_toml(document: Mapping[str, Any]) -> str:
    """Return a document as a person would write it: tables under headings."""
    plain, tables = [], []
    for name, value in document.items():
        if isinstance(value, dict):
            rows = (f"{_text(key)} = {_value(each)}" for key, each in value.items())
            tables.append("\n".join([f"[{_text(name)}]", *rows]))
        elif isinstance(value, list) and value and all(isinstance(each, dict) for each in value):
            for table in value:
                rows = (f"{_text(key)} = {_value(each)}" for key, each in table.items())
                tables.append("\n".join([f"[[{_text(name)}]]", *rows]))
        else:
            plain.append(f"{_text(name)} = {_value(value)}")
    return "\n".join([*plain, *tables, ""])


def _text(text: str) -> str:
    if text.isascii() and text.replace("_", "a").isalnum():
        return text
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value(value: object) -> str:
    match value:
        case bool():
            return str(value).lower()
        case str():
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case dict():
            return "{ " + ", ".join(f"{_text(k)} = {_value(v)}" for k, v in value.items()) + " }"
        case list():
            return "[" + ", ".join(map(_value, value)) + "]"
        case _:
            return str(value)


class Tally:
    """Counts of what verbs made of files."""

    def __init__(self) -> None:
        self.files = 0
        self.codes: dict[str, Counter[int]] = {}
        self.wrong: list[tuple[Result, str]] = []
        self.slow: list[Result] = []

    def add(self, result: Result, text: str) -> None:
        """Count a result, with the file that led to it."""
        self.files += 1
        self.codes.setdefault(result.verb, Counter())[result.code] += 1
        if result.wrong:
            self.wrong.append((result, text))
        if result.took > SLOW:
            self.slow.append(result)

    def lines(self) -> Iterator[str]:
        """Yield a table: verb, files, share that it took, exit codes, failures."""
        yield f"{'verb':10} {'files':>7} {'taken':>6} {'wrong':>5}  exit codes"
        for verb, codes in sorted(self.codes.items()):
            count = codes.total()
            taken = 1.0 - (codes[ExitCode.USAGE] + codes[ExitCode.INTERNAL]) / count
            wrong = sum(result.verb == verb for result, _ in self.wrong)
            each = ", ".join(f"{code}: {times}" for code, times in sorted(codes.items()))
            yield f"{verb:10} {count:7} {100 * taken:5.0f}% {wrong:5}  {each}"
