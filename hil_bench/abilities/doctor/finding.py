"""The findings of an examination, and the reading of the kernel's files."""

import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

IS_LINUX = sys.platform.startswith("linux")


class Verdict(StrEnum):
    """The meaning of a finding for a bench in real time."""

    GOOD = "good"
    """Nothing is to be changed."""
    HINT = "hint"
    """It works; a change would make it better."""
    MISSING = "missing"
    """Something does not work without a change."""
    ABSENT = "absent"
    """This system has no such thing."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One fact.

    Attributes:
        name: what was looked at.
        verdict: what it means.
        value: what is there, in words.
        advice: what to change, in one line; empty where nothing is.
    """

    name: str
    verdict: Verdict
    value: str
    advice: str = ""


@dataclass(frozen=True, slots=True)
class Topic:
    """The findings on one subject.

    Attributes:
        name: the subject.
        findings: the facts.
    """

    name: str
    findings: tuple[Finding, ...]


Read = Callable[[str], str]
"""Returns the text of a file of the kernel, empty where there is none."""


def read_file(path: str) -> str:
    """Return the text of a file without white space at its ends, empty where it cannot be read."""
    try:
        return Path(path).read_text("utf-8", "replace").strip()
    except OSError:
        return ""


def good(name: str, value: str) -> Finding:
    """Return a finding about which nothing is to be done."""
    return Finding(name, Verdict.GOOD, value)


def absent(name: str, value: str = "not on this system") -> Finding:
    """Return a finding about what this system does not have."""
    return Finding(name, Verdict.ABSENT, value)


def judged(name: str, value: str, advice: str, *, is_good: bool) -> Finding:
    """Return a finding that is good, or a hint with advice."""
    return good(name, value) if is_good else Finding(name, Verdict.HINT, value, advice)


def first_match(text: str, beginnings: Iterable[str]) -> str:
    """Return the rest of the first word of a text with one of these beginnings, or nothing."""
    for word in text.split():
        for beginning in beginnings:
            if word.startswith(beginning):
                return word.removeprefix(beginning)
    return ""
