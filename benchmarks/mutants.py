"""Mutants of a module: its source with one small fault each, for ``benchmarks/mutation.py``.

A fault is a shifted or inverted comparison, another operator, a constant one off, an inverted
condition, a lost statement, a narrower ``except``. Annotations, decorators, texts and what goes to
the logger stay as they are: they do not decide what the bench does.
"""

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

_COMPARISONS: Final = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
_OPERATORS: Final = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitAnd,
}
_NAMES: Final = {"min": "max", "max": "min", "any": "all", "all": "any"}
_NARROWER: Final = {"BaseException": "Exception", "Exception": "ValueError"}
_NEVER: Final = "ZeroDivisionError"
"""A handler of this class catches nothing here."""
_SKIPPED_FIELDS: Final = {"annotation", "returns", "decorator_list", "type_params"}


@dataclass(frozen=True)
class Mutant:
    """One fault.

    Attributes:
        line: where it is in the source.
        what: the piece of source before and after.
        tree: the whole module with it, until the next mutant is asked for.
    """

    line: int
    what: str
    tree: ast.Module


def mutants(source: str) -> Iterator[Mutant]:
    """Yield each mutant of a module, in the order of its source."""
    tree = ast.parse(source)
    for node, parent, field in list(_nodes(tree)):
        for changed in _changes(node, parent):
            before = ast.unparse(node)
            _put(parent, field, node, changed)
            yield Mutant(node.lineno, _shown(before, changed), tree)
            _put(parent, field, changed, node)


def _nodes(
    parent: ast.AST,
) -> Iterator[tuple[ast.expr | ast.stmt | ast.excepthandler, ast.AST, str]]:
    """Yield each node that may change, its parent and the field that it is in."""
    for field, value in ast.iter_fields(parent):
        if field in _SKIPPED_FIELDS:
            continue
        for node in value if isinstance(value, list) else [value]:
            if isinstance(node, ast.AST) and not _is_text(node) and not _is_kept(node, parent):
                if isinstance(node, ast.expr | ast.stmt | ast.excepthandler):
                    yield node, parent, field
                yield from _nodes(node)


def _is_text(node: ast.AST) -> bool:
    """Return True if a node is text only: docstrings, f-strings, calls of the logger."""
    if isinstance(node, ast.Expr):
        call = node.value
        is_logged = isinstance(call, ast.Call) and ast.unparse(call.func).startswith("logger.")
        return isinstance(call, ast.Constant) or is_logged
    is_type_checking = isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
    return isinstance(node, ast.JoinedStr) or is_type_checking


def _is_kept(node: ast.AST, parent: ast.AST) -> bool:
    """Return True if a node keeps an argument of a constructor: without it nothing works at all."""
    is_kept = isinstance(parent, ast.FunctionDef) and parent.name == "__init__"
    return is_kept and isinstance(node, ast.Assign) and isinstance(node.value, ast.Name)


def _changes(node: ast.AST, parent: ast.AST) -> Iterator[ast.AST]:
    """Yield what may stand in place of a node."""
    if isinstance(node, ast.expr):
        found = list(_expressions(node))
        is_condition = isinstance(parent, ast.If | ast.While | ast.IfExp) and parent.test is node
        if is_condition and not found:
            found = [ast.UnaryOp(ast.Not(), node)]
        yield from found
    elif isinstance(node, ast.excepthandler):
        yield from _handlers(node)
    elif isinstance(node, ast.stmt):
        yield from _statements(node)


def _expressions(node: ast.expr) -> Iterator[ast.expr]:
    match node:
        case ast.Compare(left, operators, comparators):
            for position, operator in enumerate(operators):
                for other in _COMPARISONS[type(operator)]:
                    changed = [*operators[:position], other(), *operators[position + 1 :]]
                    yield ast.Compare(left, changed, comparators)
        case ast.BinOp(left, operator, right) if type(operator) in _OPERATORS:
            yield ast.BinOp(left, _OPERATORS[type(operator)](), right)
        case ast.BoolOp(operator, values):
            yield ast.BoolOp(ast.Or() if isinstance(operator, ast.And) else ast.And(), values)
        case ast.UnaryOp(ast.Not() | ast.USub() | ast.Invert(), operand):
            yield operand
        case ast.Constant(value) if isinstance(value, int | float):
            yield from map(ast.Constant, _neighbours(value))
        case ast.Name(name, ast.Load()) if name in _NAMES:
            yield ast.Name(_NAMES[name], ast.Load())


def _neighbours(value: float) -> tuple[float, ...]:
    """Return constants that stand for another one."""
    if isinstance(value, bool):
        return (not value,)
    return (value + 1, value - 1) if isinstance(value, int) else (1.5 * value or 1.0,)


def _statements(node: ast.stmt) -> Iterator[ast.stmt]:
    match node:
        case ast.Expr() | ast.Raise() | ast.Delete():
            yield ast.Pass()
        case ast.Assign(targets) if not isinstance(targets[0], ast.Name):
            yield ast.Pass()
        case ast.AugAssign(target, operator, value):
            if not isinstance(value, ast.Constant):  # or the constant becomes 0
                yield ast.Pass()
            if type(operator) in _OPERATORS:
                yield ast.AugAssign(target, _OPERATORS[type(operator)](), value)
        case ast.Return(ast.expr() as value) if ast.unparse(value) not in {"None", "False"}:
            yield ast.Return(ast.Constant(None))
        case ast.Return(None):
            yield ast.Pass()
        case ast.Break():
            yield ast.Continue()
        case ast.Continue():
            yield ast.Break()


def _handlers(node: ast.excepthandler) -> Iterator[ast.excepthandler]:
    """Yield handlers that catch less."""
    match node:
        case ast.ExceptHandler(ast.Tuple(elements), name, body):
            for left_out in range(len(elements)):
                kept = [*elements[:left_out], *elements[left_out + 1 :]]
                yield ast.ExceptHandler(ast.Tuple(kept, ast.Load()), name, body)
        case ast.ExceptHandler(ast.expr() as caught, name, body):
            narrower = _NARROWER.get(ast.unparse(caught), _NEVER)
            for other in dict.fromkeys((narrower, _NEVER)):
                yield ast.ExceptHandler(ast.Name(other, ast.Load()), name, body)


def _put(parent: ast.AST, field: str, old: ast.AST, new: ast.AST) -> None:
    """Put one node in the place of another, at the same line."""
    ast.fix_missing_locations(ast.copy_location(new, old))
    value = getattr(parent, field)
    if isinstance(value, list):
        value[next(place for place, node in enumerate(value) if node is old)] = new
    else:
        setattr(parent, field, new)


def _shown(before: str, changed: ast.AST) -> str:
    """Return the first lines of both pieces of source."""
    return f"{before.splitlines()[0]} -> {ast.unparse(changed).splitlines()[0]}"
