"""Makes the mutants of a module: each is its syntax tree with one small change."""

import ast
import copy
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

_OPERATORS: Final[dict[type[ast.AST], type[ast.AST]]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Mod: ast.Mult,
    ast.Pow: ast.Mult, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip
"""What each operator is changed to."""
_REVERSED: Final[dict[type[ast.AST], type[ast.AST]]] = {
    ast.Lt: ast.Gt, ast.LtE: ast.GtE, ast.Gt: ast.Lt, ast.GtE: ast.LtE,
}  # fmt: skip
_CALLS: Final = {"min": "max", "max": "min", "abs": "float", "isnan": "isfinite"}
_UNTOUCHED: Final = ("annotation", "returns", "decorator_list", "bases", "type_params")
"""Fields of the syntax tree that do nothing while the program runs."""


@dataclass(frozen=True)
class Mutant:
    """A module with one change.

    Attributes:
        line: line of the change in the module.
        where: function, class or constant in which it is.
        before, after: the changed piece of code as it was and is.
        source: the whole module as it was.
        path: way to the change in its syntax tree.
        changed: what stands there instead.
        left_out: the element of a tuple or set that is left out; empty for any other change.
        occurrence: its number, from 1, among the mutants of the module with the same words.
    """

    line: int
    where: str
    before: str
    after: str
    source: str
    path: "Path"
    changed: ast.AST
    left_out: str = ""
    occurrence: int = 1

    @property
    def tree(self) -> ast.Module:
        """The module's syntax tree with the change, made anew each time."""
        tree = ast.parse(self.source)
        _put(tree, self.path, self.changed)
        return ast.fix_missing_locations(tree)

    @property
    def name(self) -> str:
        """The change in words, without the line, which moves with every edit above it.

        From the second of several places with the same words on, their number follows in brackets.
        """
        change = f"`{self.before}` -> `{self.after}`"
        words = f"without `{self.left_out}`" if self.left_out else change
        number = f" ({self.occurrence})" if self.occurrence > 1 else ""
        return f"{self.where}: {words}{number}"


def mutants_of(source: str) -> Iterator[Mutant]:
    """Yield all mutants of a module's source, in the order of its lines."""
    tree = ast.parse(source)
    known: Counter[str] = Counter()
    for path, node, where in _places(tree, (), ""):
        for changed in _changes(node, path):
            left_out = _left_out(node, changed)
            line = (left_out or node).lineno  # type: ignore[attr-defined]
            missing = _shown(left_out) if left_out is not None else ""
            mutant = Mutant(
                line, where, _shown(node), _shown(changed), source, path, changed, missing
            )
            known[mutant.name] += 1
            yield replace(mutant, occurrence=known[mutant.name])


Path = tuple[tuple[str, int], ...]
"""Way to a node from the root: names of fields, each with an index in a list, or -1."""


def _places(node: ast.AST, path: Path, where: str) -> Iterator[tuple[Path, ast.AST, str]]:
    for name, value in ast.iter_fields(node):
        if name in _UNTOUCHED:
            continue
        for index, child in enumerate(value) if isinstance(value, list) else ((-1, value),):
            if not isinstance(child, ast.AST) or _is_silent(child):
                continue
            inside = _named(child, where)
            here = (*path, (name, index))
            if hasattr(child, "lineno"):
                yield here, child, inside
            yield from _places(child, here, inside)


def _is_silent(node: ast.AST) -> bool:
    """Return whether a statement does nothing: a docstring, an import, a type's name."""
    if isinstance(node, ast.Import | ast.ImportFrom | ast.JoinedStr):
        return True
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _named(node: ast.AST, where: str) -> str:
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return f"{where}.{node.name}" if where else node.name
    if not where and isinstance(node, ast.Assign | ast.AnnAssign):
        target = node.target if isinstance(node, ast.AnnAssign) else node.targets[0]
        return ast.unparse(target)
    return where


def _changes(node: ast.AST, path: Path) -> Iterator[ast.AST]:
    """Yield what a node is changed to, each a new node."""
    match node:
        case ast.Compare(ops=[operator, *_]):
            for known in (_OPERATORS, _REVERSED):
                if type(operator) in known:
                    yield _with(node, ops=[known[type(operator)](), *node.ops[1:]])
            for index in range(1, len(node.ops)):
                ops = list(node.ops)
                ops[index] = _OPERATORS[type(ops[index])]()  # type: ignore[call-overload]
                yield _with(node, ops=ops)
        case ast.BinOp(op=operator) | ast.AugAssign(op=operator) if type(operator) in _OPERATORS:
            yield _with(node, op=_OPERATORS[type(operator)]())
        case ast.BoolOp(op=operator):
            yield _with(node, op=_OPERATORS[type(operator)]())
        case ast.UnaryOp(op=ast.Not() | ast.USub()):
            yield node.operand
        case ast.Constant(value=bool() as value):
            yield ast.Constant(not value)
        case ast.Constant(value=int() as number):
            yield ast.Constant(number + 1)
        case ast.Constant(value=float() as number):
            yield ast.Constant(2.0 * number if number else 1.0)
        case ast.IfExp(body=body, orelse=orelse):
            yield _with(node, body=orelse, orelse=body)
        case ast.Call(func=ast.Name(id=name)) if name in _CALLS:
            yield _with(node, func=ast.Name(_CALLS[name], ast.Load()))
        case ast.Tuple(elts=elements) | ast.Set(elts=elements) if _is_row(path, node):
            for index in range(len(elements)):
                yield _with(node, elts=[*elements[:index], *elements[index + 1 :]])
        case ast.Attribute(value=ast.Name(id="Cause"), attr=name) if name != "LIMIT_LOW":
            yield _with(node, attr="LIMIT_LOW")
        case ast.Name(id="_TRIP" | "_RAMP_DOWN" | "_HOLD", ctx=ast.Load()):
            yield _with(node, id="_INDICATE")
        case ast.Continue():
            yield ast.Break()
    if isinstance(node, ast.AugAssign | ast.Raise) or _sets_memory(node):
        yield ast.Pass()


def _left_out(node: ast.AST, changed: ast.AST) -> ast.AST | None:
    """Return the element that a changed tuple or set lacks; None for any other change."""
    if not isinstance(node, ast.Tuple | ast.Set) or not isinstance(changed, type(node)):
        return None
    return next(each for each in node.elts if each not in changed.elts)


def _is_row(path: Path, node: ast.AST) -> bool:
    """Return whether a tuple or set lists what holds, so that one can be left out of it."""
    return path[-1][0] != "targets" and all(
        isinstance(each, ast.Call | ast.Name | ast.Attribute | ast.Starred)
        for each in node.elts  # type: ignore[attr-defined]
    )


def _sets_memory(node: ast.AST) -> bool:
    if isinstance(node, ast.Assign):
        return isinstance(node.targets[0], ast.Subscript)
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)


def _with(node: ast.AST, **fields: object) -> ast.AST:
    changed = copy.copy(node)
    for name, value in fields.items():
        setattr(changed, name, value)
    return changed


def _put(tree: ast.AST, path: Path, changed: ast.AST) -> None:
    """Put a changed node at its place in a tree."""
    node = tree
    for name, index in path[:-1]:
        value = getattr(node, name)
        node = value if index < 0 else value[index]
    name, index = path[-1]
    if index < 0:
        setattr(node, name, changed)
    else:
        getattr(node, name)[index] = changed


def _shown(node: ast.AST) -> str:
    text = " ".join(ast.unparse(node).split())
    return text if len(text) <= 100 else f"{text[:97]}..."
