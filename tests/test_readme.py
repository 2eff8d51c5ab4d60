"""What README.md shows works as shown."""

import re
import shlex
from pathlib import Path

import pytest

from hil_bench.cli import VERBS

pytest_plugins = ["pytester"]

README = Path(__file__).parents[1] / "README.md"
TEXT = README.read_text(encoding="utf-8")
SNIPPETS = re.findall(r"^```python\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
COMMANDS = re.findall(r"\bhil-bench ([a-z][^`\n]*)", TEXT)


@pytest.mark.parametrize("snippet", SNIPPETS, ids=range(len(SNIPPETS)))
def test_the_python_runs(snippet, capsys):
    exec(compile(snippet, str(README), "exec"), {})  # noqa: S102 - it is our own README
    position = float(capsys.readouterr().out.split(" mm")[0])
    # The loop ends in the first 10 ms cycle at or beyond 50 mm, at about 0.1 m/s.
    assert 50.0 <= position < 55.0


def test_the_tests_pass(pytester):
    snippets = re.findall(r"^```py\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
    pytester.makepyfile("\n".join(snippets))
    pytester.runpytest_subprocess().assert_outcomes(passed=len(snippets))


@pytest.mark.parametrize("command", COMMANDS)
def test_every_verb_named_is_there(command):
    assert shlex.split(command, comments=True)[0] in VERBS


def test_every_link_leads_to_a_file():
    links = re.findall(r"\]\(([^)#:]+)\)", TEXT)
    assert links
    assert [link for link in links if not (README.parent / link).exists()] == []
