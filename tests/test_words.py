"""Check that docstrings open with what a thing is or does, not with a question word."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
QUESTION = re.compile(
    r"(What|Whether|Which|Who|Whose|Where|How|Have it|"
    r"Returns? (what|whether|which|how|who|whose|where))\b"
)
OPENING = re.compile(rf"[\"']{{3}}\s*{QUESTION.pattern}")


def packages():
    """Yield the top-level packages, and the modules beside them as one."""
    yield from (".ci", "benchmarks", "device_profiles", "drivers", "examples", "hil_bench")
    for path in sorted((ROOT / "hil_bench").iterdir()):
        if (path / "__init__.py").exists():
            yield f"hil_bench/{path.name}"


def files(package):
    """Yield the Python files of a package; of hil_bench only the modules beside its packages."""
    folder = ROOT / package
    yield from folder.glob("*.py") if package == "hil_bench" else folder.rglob("*.py")


def questions(source):
    """Yield line and opening of each docstring that opens with a question word."""
    if not OPENING.search(source):
        return  # without the second that it takes to parse all
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            text = ast.get_docstring(node)
            if text and QUESTION.match(text):
                yield f"{node.body[0].lineno}: {text.splitlines()[0]}"


@pytest.mark.parametrize("package", [*packages()])
def test_docstrings_open_with_what_a_thing_is_or_does(package):
    """No docstring of the package opens with a question word."""
    found = [
        f"{path.relative_to(ROOT)}:{question}"
        for path in files(package)
        for question in questions(path.read_text(encoding="utf-8"))
    ]
    assert not found, "\n".join(found)


PHRASE = re.compile(r"(can(not| not)|could not|to) be had|\b(tells?|told)\b(?! apart)")
"""Phrases that nobody would say beside a machine."""


def messages(source):
    """Yield line and text of each string that is no docstring, where it has such a phrase."""
    if not PHRASE.search(source):
        return
    tree = ast.parse(source)
    alone = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        text = getattr(node, "value", None) if isinstance(node, ast.Constant) else None
        if isinstance(text, str) and id(node) not in alone and PHRASE.search(text):
            yield f"{node.lineno}: {text}"


def test_messages_are_said_as_an_engineer_would():
    """No message of the bench or of the drivers has such a phrase."""
    folders = (ROOT / "hil_bench", ROOT / "drivers")
    found = [
        f"{path.relative_to(ROOT)}:{message}"
        for folder in folders
        for path in sorted(folder.rglob("*.py"))
        for message in messages(path.read_text(encoding="utf-8"))
    ]
    assert not found, "\n".join(found)
    assert [*messages('"""Told."""\na = "told"\nb = "they cannot be told apart"\n')] == ["2: told"]


@pytest.mark.parametrize(
    "text", ["What it does.", "Whether it is.", "Return which is.", "Have it done.", "How it goes."]
)
def test_question_is_found(text):
    """The check sees the question words in functions, classes and modules."""
    source = f'"""{text}"""\nclass A:\n    """{text}"""\ndef f():\n    """{text}"""\n'
    assert len(list(questions(source))) == 3  # one each


def test_statement_is_no_question():
    """The check leaves statements alone, and question words inside them."""
    assert not list(questions('"""Return the place where it is; Whatever."""\n'))
