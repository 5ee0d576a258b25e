"""Mutants of a module: small changes of its source, found in its syntax tree.

Not changed are texts, annotations, type aliases, decorators, `raise` statements, and functions
named `warm_up`, which only compile.
"""

from __future__ import annotations

import ast
import copy
import random
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

__all__ = ["Mutant", "constants_of", "lines_of", "preset_change", "sampled"]

Edit = tuple[int, int, bytes]
"""First and last byte of the source that is replaced, and what replaces it."""
BOUNDARY = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
OPPOSITE = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
ARITHMETIC = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult, ast.Mod: ast.Mult,
    ast.Pow: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.LShift: ast.RShift, ast.RShift: ast.LShift,
}  # fmt: skip
UNWRAPPED = {"wrap", "abs", "clip", "min", "max", "floor", "ceil", "round", "sqrt", "minimum", "maximum", "hypot"}
"""Functions that a mutant drops: their first argument remains, and for `min` and `max` also the last."""
SKIPPED = (ast.JoinedStr, ast.Raise, ast.Import, ast.ImportFrom, ast.Assert)
OF_TYPES = ("NDArray[", "tuple[", "Literal[", "TypeVar(", "Callable[")
"""How the value of a type alias begins, which only annotations use."""
NUMBER = 1.6
"""What replaces the only word of a constant that may be a number too."""
FACTOR = 1.3
"""A constant grows by it, or shrinks by its square root's cube, about 1.5, so that no result stays the same."""


@dataclass(frozen=True)
class Mutant:
    """A change of one module.

    Attributes:
        path: File of the module. line: First changed line. kind: `line` or `constant`.
        before, after: What is changed, and to what, as one line of text each.
        edits: The changes of the source.
    """

    path: Path
    line: int
    kind: str
    before: str
    after: str
    edits: tuple[Edit, ...]

    def source(self) -> str:
        """The whole module, changed."""
        text = self.path.read_bytes()
        for first, last, new in sorted(self.edits, reverse=True):
            text = text[:first] + new + text[last:]
        return text.decode()


class _Source:
    """A module's text, and the place of a node in it."""

    def __init__(self, path: Path) -> None:
        self.path, self.text = path, path.read_bytes()
        self.tree = ast.parse(self.text)
        self._starts = [0]
        for line in self.text.splitlines(keepends=True):
            self._starts.append(self._starts[-1] + len(line))

    def mutant(self, node: Any, new: str, kind: str = "line") -> Mutant:
        first = self._starts[node.lineno - 1] + node.col_offset
        last = self._starts[node.end_lineno - 1] + node.end_col_offset
        before = " ".join(self.text[first:last].decode().split())
        return Mutant(self.path, node.lineno, kind, before, new, ((first, last, new.encode()),))


def lines_of(path: Path) -> list[Mutant]:
    """All line mutants of a file, in order."""
    source = _Source(path)
    found = [source.mutant(node, new) for node, new in _changes(source.tree)]
    same = ast.dump(source.tree)
    return [m for m in found if _tree(m) not in ("", same)]


def sampled(mutants: list[Mutant], count: int, rng: random.Random) -> list[Mutant]:
    """One random mutant of each of `count` random lines."""
    by_line: dict[tuple[Path, int], list[Mutant]] = {}
    for mutant in mutants:
        by_line.setdefault((mutant.path, mutant.line), []).append(mutant)
    lines = rng.sample(sorted(by_line), min(count, len(by_line)))
    return [rng.choice(by_line[line]) for line in lines]


def _tree(mutant: Mutant) -> str:
    """Syntax tree of a mutant; empty if it does not compile."""
    try:
        tree = ast.parse(mutant.source())
        compile(tree, str(mutant.path), "exec")
    except (SyntaxError, ValueError):
        return ""
    return ast.dump(tree)


def _changes(node: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    """Nodes below a node, with the text that replaces them."""
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        if node.name == "warm_up":
            return
        children: list[ast.AST] = list(node.body)
    elif isinstance(node, ast.ClassDef):
        children = [item for item in node.body if not isinstance(item, ast.AnnAssign)]
    elif isinstance(node, SKIPPED) or _is_guard(node):
        return
    elif isinstance(node, ast.AnnAssign):
        children = [] if node.value is None else [node.value]
    else:
        children = [child for child in ast.iter_child_nodes(node) if not isinstance(child, ast.expr_context)]
    if isinstance(node, ast.stmt):
        yield from ((node, new) for new in _of_statement(node))
    elif isinstance(node, ast.expr):
        yield from ((node, f"({ast.unparse(new)})") for new in _of_expression(node))
    for child in children:
        yield from _changes(child)


def _is_guard(node: ast.AST) -> bool:
    """Whether a statement is of names and types only."""
    if isinstance(node, ast.If):
        return "TYPE_CHECKING" in ast.unparse(node.test)
    return isinstance(node, ast.Assign) and (
        ast.unparse(node.targets[0]).startswith("__") or ast.unparse(node.value).startswith(OF_TYPES)
    )


def _of_statement(node: ast.stmt) -> Iterator[str]:
    is_text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    if isinstance(node, ast.Assign | ast.AugAssign | ast.Continue | ast.Break | ast.Expr) and not is_text:
        yield "pass"
    if isinstance(node, ast.AugAssign) and type(node.op) in ARITHMETIC:
        yield ast.unparse(ast.AugAssign(node.target, ARITHMETIC[type(node.op)](), node.value))


def _of_expression(node: ast.expr) -> Iterator[ast.expr]:
    if isinstance(node, ast.BinOp) and type(node.op) in ARITHMETIC:
        yield ast.BinOp(node.left, ARITHMETIC[type(node.op)](), node.right)
    elif isinstance(node, ast.BoolOp):
        yield ast.BoolOp(ast.And() if isinstance(node.op, ast.Or) else ast.Or(), node.values)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not | ast.Invert):
        yield node.operand
    elif isinstance(node, ast.Compare):
        yield from _of_comparison(node)
    elif isinstance(node, ast.IfExp):
        yield ast.IfExp(ast.UnaryOp(ast.Not(), node.test), node.body, node.orelse)
    elif isinstance(node, ast.Call):
        yield from _of_call(node)
    elif isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Tuple) and len(node.slice.elts) == 2:
        yield ast.Subscript(node.value, ast.Tuple(node.slice.elts[::-1], ast.Load()), ast.Load())
    elif isinstance(node, ast.Constant) and not isinstance(node.value, str | bytes | None | type(...)):
        yield ast.Constant(_changed_number(node.value))


def _of_comparison(node: ast.Compare) -> Iterator[ast.expr]:
    for n, op in enumerate(node.ops):
        for table in (BOUNDARY, OPPOSITE):
            if type(op) in table:
                new = copy.deepcopy(node)
                new.ops[n] = table[type(op)]()
                yield new


def _of_call(node: ast.Call) -> Iterator[ast.expr]:
    args = node.args
    if any(isinstance(arg, ast.Starred) for arg in args):
        return
    name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
    if args and name in UNWRAPPED:
        yield args[0]
        if name in ("min", "max") and len(args) > 1:
            yield args[-1]
    for n in range(len(args) - 1):
        if ast.dump(args[n]) != ast.dump(args[n + 1]) and not (name in UNWRAPPED or name in ("isinstance", "range")):
            swapped = [*args[:n], args[n + 1], args[n], *args[n + 2 :]]
            yield ast.Call(node.func, swapped, node.keywords)


def _changed_number(value: Any) -> Any:
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + 1
    return value * FACTOR if value else 1.0


def constants_of(path: Path, rng: random.Random) -> list[Mutant]:
    """A mutant of each constant of the presets in a file: defaults of its fields, and mappings from their names.

    A number grows by 1.3 or shrinks by 1.5, whichever the generator says and the field's bounds allow; a zero becomes a
    tenth of its upper bound. A boolean becomes its opposite, a choice each other choice.
    """
    source = _Source(path)
    fields: dict[str, list[ast.AnnAssign]] = {}
    found: list[Mutant] = []
    for node in ast.walk(source.tree):
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.value is not None:
            fields.setdefault(node.target.id, []).append(node)
    for name, given in fields.items():
        for field in given:
            value = _default(field)
            found += [] if value is None else _of_constant(source, name, value, field, rng)
    for node in ast.walk(source.tree):
        for key, value in zip(node.keys, node.values, strict=True) if isinstance(node, ast.Dict) else ():
            if isinstance(key, ast.Constant) and key.value in fields:
                value = value.elts[0] if isinstance(value, ast.Tuple) else value  # the value, and where it is printed
                found += _of_constant(source, str(key.value), value, fields[key.value][0], rng)
    return sorted(found, key=lambda mutant: mutant.edits)


def _default(field: ast.AnnAssign) -> ast.expr | None:
    call = field.value
    if isinstance(call, ast.Call) and ast.unparse(call.func) == "Field":
        given = [word.value for word in call.keywords if word.arg == "default"]
        return call.args[0] if call.args else given[0] if given else None
    return call


def _of_constant(
    source: _Source, name: str, value: ast.expr, field: ast.AnnAssign, rng: random.Random
) -> Iterator[Mutant]:
    try:
        old = ast.literal_eval(value)
    except ValueError:
        return
    if isinstance(old, bool):
        others: list[Any] = [not old]
    elif isinstance(old, int | float):
        others = [_within_bounds(old, field, rng)]
    elif isinstance(old, str):
        others = [word for word in _words(source, field.annotation) if word != old] or [NUMBER]
    else:
        others = []
    for other in others:
        mutant = source.mutant(value, repr(other), "constant")
        yield Mutant(source.path, mutant.line, "constant", f"{name}={mutant.before}", repr(other), mutant.edits)


def _words(source: _Source, annotation: ast.expr) -> list[str]:
    """Choices of a field: those that its type names, or an alias of it in the same package."""
    names = {node.id for node in ast.walk(annotation) if isinstance(node, ast.Name)}
    types = [annotation]
    for path in sorted(source.path.parent.glob("*.py")):
        for node in ast.parse(path.read_bytes()).body:
            if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") in names:
                types.append(node.value)
    nodes = (node for one in types for node in ast.walk(one))
    return [node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)]


def _within_bounds(old: float, field: ast.AnnAssign, rng: random.Random) -> float:
    words = field.value.keywords if isinstance(field.value, ast.Call) else []
    bounds = {word.arg: word.value.value for word in words if isinstance(word.value, ast.Constant)}
    low, high = bounds.get("ge", bounds.get("gt")), bounds.get("le", bounds.get("lt"))
    if isinstance(old, int):
        more, less = old + max(1, round(0.3 * old)), old - max(1, round(old / 3.0))
    elif old == 0.0:
        return 0.1 * high if high else 1.0
    else:
        more, less = (float(f"{value:.6g}") for value in (old * FACTOR, old / FACTOR**1.5))
    allowed = [
        value
        for value in (more, less)
        if (low is None or value > low or (value == low and "ge" in bounds))
        and (high is None or value < high or (value == high and "le" in bounds))
    ]
    return rng.choice(allowed or [more])


def preset_change(path: Path, changes: dict[str, str]) -> Mutant:
    """A mutant that sets constants of a preset to given values wherever the file has them."""
    source = _Source(path)
    found = [m for m in constants_of(path, random.Random(0)) if m.before.split("=")[0] in changes]
    missing = changes.keys() - {m.before.split("=")[0] for m in found}
    if missing:
        raise SystemExit(f"error: {path}: no constant {', '.join(sorted(missing))} in its fields or mappings")
    edits = {(*m.edits[0][:2], changes[m.before.split("=")[0]].encode()) for m in found}
    old, new = ", ".join(m.before for m in found), ", ".join(f"{k}={v}" for k, v in changes.items())
    return Mutant(source.path, found[0].line, "constant", old, new, tuple(sorted(edits)))
