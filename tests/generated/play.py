"""A life of a file: it is written, read by verbs, edited, and read again."""

import contextlib
import faulthandler
import gc
import io
import json
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

from generated.dialects import ARGUMENTS, BYTES, COSTLY, Dialect
from generated.edits import Schema, byte_edits, cell_edits, document_edits, line_edits
from generated.seeds import STEM, lay_scenario, shorten
from hypothesis import strategies as st

from hil_bench.cli import main
from hil_bench.cli.exit_codes import ExitCode

SLOW = 5.0
"""Processor time of a verb on one file that is reported [s]."""
_MOST = 60.0
"""Processor time after which a verb is ended and reported [s]."""
_HANGS = 300.0
"""Likewise, time by the clock [s]."""
_MOST_MEMORY = 1 << 20
"""Memory that a verb may take for a file, beside that of earlier ones [KiB]."""
_OUTPUT = "out"
"""Beginning of the names of files and folders that a verb is given to write."""

Draw = Callable[[st.SearchStrategy[Any]], Any]


class EndedError(BaseException):
    """A verb takes more time than any file is worth."""


class Result(NamedTuple):
    """What a verb made of a file.

    Attributes:
        verb: its name.
        dialect: of the file.
        code: its exit code, -1 where it was ended.
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


Lives = Iterator[tuple[Result, str | bytes]]


class _Terminal(io.StringIO):
    """Answers of somebody at a terminal."""

    def isatty(self) -> bool:
        return True


def run_verb(dialect: str, words: tuple[str, ...], answers: str | None = None) -> Result:
    """Run a verb in this process, and judge how it ends."""
    said, errors = io.StringIO(), io.StringIO()
    began, memory = time.process_time(), _most_memory()
    code, wrong = -1, ""
    stdin = io.StringIO() if answers is None else _Terminal(answers)
    with (
        contextlib.redirect_stdout(said),
        contextlib.redirect_stderr(errors),
        patch.object(sys, "stdin", stdin),
        _limited(),
    ):
        try:
            code = main(words)
        except EndedError as error:
            wrong = str(error)
        except BaseException as error:
            wrong = f"raised {type(error).__name__}: {error}"
    took = time.process_time() - began
    if code >= 0:
        wrong = _find_wrong(code, said.getvalue(), errors.getvalue(), words)
    if not wrong and (more := _most_memory() - memory) > _MOST_MEMORY:
        wrong = f"takes {more >> 10} MiB of memory"
    return Result(words[0], dialect, code, wrong, took, words)


def _most_memory() -> int:
    """Return the most memory that this process has ever taken [KiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _find_wrong(code: int, said: str, errors: str, words: tuple[str, ...]) -> str:
    if code not in set(ExitCode):
        return f"exit code {code} is not documented"
    if code == ExitCode.INTERNAL or "Traceback (most recent" in said + errors:
        return f"exit {code}: {errors[-300:]}"
    if code == ExitCode.USAGE and "error: " not in errors:
        return "exit 2 without a message"
    for line in (said + errors).split("\n"):
        if not line.replace("\t", "").isprintable():
            return f"prints {line!r}"
    for line in errors.splitlines() if code == ExitCode.USAGE else ():
        if line.startswith("hil-bench: error: ") and not _names_input(line, words):
            return f"names no file: {line}"
    return ""


def _names_input(line: str, words: tuple[str, ...]) -> bool:
    """Return True if a message names the file, another file, or an option of the command line."""
    names = (STEM, "--", ": cannot be read", *words[1:])
    return any(name in line for name in names if len(name) > 1)


@contextlib.contextmanager
def _limited() -> Iterator[None]:
    timers = {
        signal.SIGPROF: (signal.ITIMER_PROF, _MOST),
        signal.SIGALRM: (signal.ITIMER_REAL, _HANGS),
    }
    reasons = {signal.SIGPROF: "takes too long", signal.SIGALRM: "hangs"}

    def end(number: int, _frame: object) -> None:
        raise EndedError(reasons[signal.Signals(number)])

    before = {each: signal.signal(each, end) for each in timers}
    for timer, longest in timers.values():
        signal.setitimer(timer, longest)
    # Machine code hears no signal: this ends the program, and shows where it is.
    faulthandler.dump_traceback_later(_HANGS + 60.0, exit=True, file=sys.__stderr__)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
        for each, (timer, _longest) in timers.items():
            signal.setitimer(timer, 0.0)
            signal.signal(each, before[each])


def live(draw: Draw, root: Path, form: Dialect, verb: str = "") -> Lives:
    """Yield what verbs make of a file after each of its edits, and its text."""
    seed = draw(st.integers(0, len(form.seeds) - 1))
    os.chdir(root / form.seeds[seed][0])
    schema = Schema()
    kept = _sound(form, seed)
    verbs = [words for words in form.verbs if verb in {"", words[0]}]
    verbs = [words for words in verbs if _takes(form, seed, words, schema)]
    for _ in range(draw(st.integers(3, 12)) if verbs else 0):
        tried = _edited(draw, form, kept, schema)
        result, text = _play(form, draw(st.sampled_from(verbs)), tried, schema)
        yield result, text
        if result.code != ExitCode.USAGE:
            kept = tried


def _sound(form: Dialect, seed: int) -> Any:
    text = form.seeds[seed][1]
    kept = tomllib.loads(text) if form.edit == "document" else text
    if form.plays and isinstance(kept, dict):
        shorten(kept)
    return kept


_HEARD: dict[tuple[str, int, tuple[str, ...]], tuple[bool, Schema]] = {}


def _takes(form: Dialect, seed: int, words: tuple[str, ...], schema: Schema) -> bool:
    """Return True if a verb takes the sound file, or is played anyway; note its keys."""
    case = (form.name, seed, words)
    if case not in _HEARD:
        heard = Schema()
        result, _ = _play(form, words, _sound(form, seed), heard)
        is_played = form.edit == BYTES or words[0] in COSTLY
        _HEARD[case] = result.code != ExitCode.USAGE or is_played, heard
    is_taken, heard = _HEARD[case]
    schema.tables |= heard.tables
    return is_taken


def _play(
    form: Dialect, words: tuple[str, ...], kept: Any, schema: Schema
) -> tuple[Result, str | bytes]:
    """Write a file, and return what a verb makes of it, and its text."""
    text = to_toml(kept) if isinstance(kept, dict) else kept
    answers = None
    if form.edit == ARGUMENTS:
        words, answers = _fill_in(words, text)
    else:
        path = Path(f"{STEM}{form.suffix}")
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        words = tuple(word.replace("{}", path.name) for word in words)
        if "on_bench.scenario.toml" in words:
            lay_scenario(Path("on_bench.scenario.toml"), kept)
    before = set(os.listdir())
    with schema.listening():
        result = run_verb(form.name, words, answers)
    return _with_left_behind(result, before), text


def _edited(draw: Draw, form: Dialect, kept: Any, schema: Schema) -> Any:
    if isinstance(kept, bytes):
        return draw(byte_edits(kept))
    if isinstance(kept, str):
        return draw((cell_edits if form.edit == "cells" else line_edits)(kept))
    tried = draw(document_edits(kept, schema))
    if form.plays:
        shorten(tried)
    return tried


def _fill_in(words: tuple[str, ...], text: str) -> tuple[tuple[str, ...], str | None]:
    """Return a command line whose {0}, {1} are lines of a text; without any, the text answers."""
    lines = text.split("\n")
    filled = []
    for word in words:
        number = word[1:-1] if word.startswith("{") else ""
        filled.append(word if not number else (*lines, *[""] * 10)[int(number)].replace("\0", ""))
    return tuple(filled), None if any("{" in word for word in words) else text


def _with_left_behind(result: Result, before: set[str]) -> Result:
    """Return the result with what the verb has left beside its output; all of it is removed."""
    made = [Path(name) for name in set(os.listdir()) - before]
    scratch = Path(tempfile.gettempdir())
    left = [each for each in made if not each.name.startswith(_OUTPUT)]
    if any(map(_is_used, scratch.iterdir())):
        gc.collect()  # the folder of an FMU goes with its plant
        left += [each for each in scratch.iterdir() if "hil" in each.name and _is_used(each)]
    for path in (*made, *left):
        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    return result._replace(wrong=f"leaves {left[0]}") if left and not result.wrong else result


def _is_used(path: Path) -> bool:
    """Return False for the folder of running benches' sockets, with nothing but their locks."""
    return not path.is_dir() or any(each.suffix != ".lock" for each in path.iterdir())


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
    """Counts of what verbs made of files.

    Args:
        found: folder for the files that broke a verb; None to keep none.
    """

    def __init__(self, found: Path | None = None) -> None:
        self.files = 0
        self.wrong: Counter[str] = Counter()
        self._codes: dict[str, Counter[int]] = {}
        self._took: Counter[str] = Counter()
        self._found = found

    def add(self, result: Result, text: str | bytes) -> None:
        """Count a result, and show at once what is wrong with it."""
        self.files += 1
        self._codes.setdefault(result.verb, Counter())[result.code] += 1
        self._took[result.verb] += result.took
        case = f"{' '.join(result.words)} ({result.dialect})"
        if result.took > SLOW:
            print(f"slow: {result.took:.1f} s {case}", flush=True)
        if result.wrong:
            print(f"WRONG {self.files}: {case}: {result.wrong}", flush=True)
            self.wrong[result.verb] += 1
            if self._found:
                self._found.mkdir(parents=True, exist_ok=True)
                path = self._found / f"{self.files}-{result.dialect}-{result.verb}.txt"
                path.write_bytes(text if isinstance(text, bytes) else text.encode())

    def lines(self) -> Iterator[str]:
        """Yield a table: verb, files, share that it took, failures, time, exit codes."""
        yield f"{'verb':11} {'files':>7} {'taken':>6} {'wrong':>5} {'ms':>6}  exit codes"
        for verb, codes in sorted(self._codes.items()):
            count = codes.total()
            taken = 1.0 - (codes[ExitCode.USAGE] + codes[ExitCode.INTERNAL] + codes[-1]) / count
            each = ", ".join(f"{code}: {times}" for code, times in sorted(codes.items()))
            took = 1e3 * self._took[verb] / count
            wrong = self.wrong[verb]
            yield f"{verb:11} {count:7} {100 * taken:5.0f}% {wrong:5} {took:6.0f}  {each}"
        yield f"{'all':11} {self.files:7} {'':6} {self.wrong.total():5}"
