"""Expressions over the channels of a test are read and computed here, safely.

An expression is parsed by Python's own grammar, and of what that yields only numbers, channels,
arithmetic and a list of functions are taken. Nothing is evaluated as Python.
"""

import ast
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LONGEST: Final = 500
"""Most characters of an expression; what needs more is easier to read as two figures."""

_DEEPEST: Final = 50
"""Most levels of nesting, far from what Python's stack can hold and from what anybody can read."""

_OPERATORS: Final[dict[type[ast.operator], Callable[[Any, Any], Any]]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
}
_SIGNS: Final[dict[type[ast.unaryop], Callable[[Any], Any]]] = {
    ast.UAdd: np.positive,
    ast.USub: np.negative,
}
_OF_SAMPLES: Final[dict[str, Callable[[Any], Any]]] = {
    "abs": np.abs,
    "sqrt": np.sqrt,
    "exp": np.exp,
    "log": np.log,
    "sin": np.sin,
    "cos": np.cos,
    "sign": np.sign,
}
"""Functions that act on each sample, or on a number."""


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _span(values: Array) -> float:
    return float(np.max(values) - np.min(values))


_OVER_SAMPLES: Final[dict[str, Callable[[Array], Any]]] = {
    "max": np.max,
    "min": np.min,
    "mean": np.mean,
    "rms": _rms,
    "std": np.std,
    "median": np.median,
    "span": _span,
    "first": lambda values: values[0],
    "last": lambda values: values[-1],
}
"""Functions that make one number of all samples; samples that are NaN are left out."""

FUNCTIONS: Final = (*_OF_SAMPLES, *_OVER_SAMPLES, "percentile", "missing")
"""Names of all functions; `percentile(x, p)` has the percentage p as a number, and `missing(x)` is
the share of samples that are NaN."""


class ExpressionError(ValueError):
    """The error of an expression that cannot be used: the broken rule as a phrase, and a remedy."""

    def __init__(self, limit: str, remedy: str) -> None:
        self.limit = limit
        self.remedy = remedy
        super().__init__(f"{limit}; {remedy}")


@dataclass(frozen=True)
class Expression:
    """An expression over channels, such as `max(abs(setpoint_m - position_m))`, in SI.

    Attributes:
        text: the expression.
        channels: names of the channels that it uses, each once, in the order of their first use.
        is_number: whether it makes one number of all samples; if not, it has a value at each
            sample.

    Raises:
        ExpressionError: it is no expression, uses what is not allowed, or calls a function of all
            samples on a number.
    """

    text: str
    channels: tuple[str, ...] = field(init=False, repr=False, compare=False)
    is_number: bool = field(init=False, repr=False, compare=False)
    _tree: ast.expr = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        found: dict[str, None] = {}
        try:
            if len(self.text) > LONGEST:
                raise ExpressionError(f"has more than {LONGEST} characters", "write two figures")
            tree = ast.parse(self.text.strip(), mode="eval").body
            if _depth(tree) > _DEEPEST:
                raise ExpressionError("is too deeply nested", "write two figures")
            is_number = _checked(tree, found)
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            if isinstance(error, ExpressionError):
                raise
            reason = getattr(error, "msg", None) or "too deeply nested"
            remedy = "write such as max(abs(setpoint_m - position_m))"
            raise ExpressionError(f"is no expression ({reason})", remedy) from None
        object.__setattr__(self, "channels", tuple(found))
        object.__setattr__(self, "is_number", is_number)
        object.__setattr__(self, "_tree", tree)

    def __reduce__(self) -> tuple[type["Expression"], tuple[str]]:
        # A tree need not be sent to other processes; it follows from the text.
        return type(self), (self.text,)

    def of(self, columns: Mapping[str, Array]) -> Any:
        """Return the value: a number, or float64 (n,) with one for each sample, in SI.

        A division by zero and the like give infinity or NaN. A number over no samples, or over
        samples that are all NaN, is NaN.

        Args:
            columns: channel -> samples, float64 (n,), for all `channels`.
        """
        with np.errstate(all="ignore"):
            value = _value(self._tree, columns)
        if self.is_number:
            return float(value)
        count = len(next(iter(columns.values()))) if columns else 0
        return np.broadcast_to(np.asarray(value, np.float64), (count,))


def _depth(node: ast.AST) -> int:
    return 1 + max((_depth(each) for each in ast.iter_child_nodes(node)), default=0)


def _checked(node: ast.expr, channels: dict[str, None]) -> bool:
    """Return whether a part of an expression is a number; collect the channels that it uses.

    Raises:
        ExpressionError: the part is not allowed.
    """
    match node:
        case ast.Constant(value=bool() | str() | bytes() | complex() | None):
            pass
        case ast.Constant(value=int() | float()):
            return True
        case ast.Name(id=name):
            channels[name] = None
            return False
        case ast.UnaryOp(op=sign, operand=inner) if type(sign) in _SIGNS:
            return _checked(inner, channels)
        case ast.BinOp(left=left, op=operator, right=right) if type(operator) in _OPERATORS:
            both = _checked(left, channels), _checked(right, channels)
            return all(both)
        case ast.Call(func=ast.Name(id=name), args=given, keywords=[]):
            return _checked_call(name, given, channels)
    shown = ast.unparse(node)
    remedy = f"use numbers, channels, + - * / **, and {', '.join(FUNCTIONS)}"
    raise ExpressionError(f"may not contain {shown[:40]}", remedy)


def _checked_call(name: str, given: list[ast.expr], channels: dict[str, None]) -> bool:
    if name not in FUNCTIONS:
        raise ExpressionError(f"calls {name}, which is not known", f"use {', '.join(FUNCTIONS)}")
    wanted = 2 if name == "percentile" else 1
    if len(given) != wanted:
        limit = f"gives {name} {len(given)} values in place of {wanted}"
        raise ExpressionError(limit, f"write {name}({'x, 95' if wanted == 2 else 'x'})")
    is_number = _checked(given[0], channels)
    if name in _OF_SAMPLES:
        return is_number
    if is_number:
        raise ExpressionError(f"takes the {name} of a number", "let it have a channel")
    if wanted == 2:
        share = given[1]
        if not isinstance(share, ast.Constant) or not _is_percentage(share.value):
            raise ExpressionError("has a percentile that is no number from 0 to 100", "write one")
    return True


def _is_percentage(value: object) -> bool:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and 0 <= value <= 100  # type: ignore[operator]


def _value(node: ast.expr, columns: Mapping[str, Array]) -> Any:
    match node:
        case ast.Constant(value=int() | float() as number):
            # As float64, so that no power grows without bound.
            return np.float64(number)
        case ast.Name(id=name):
            return columns[name]
        case ast.UnaryOp(op=sign, operand=inner):
            return _SIGNS[type(sign)](_value(inner, columns))
        case ast.BinOp(left=left, op=operator, right=right):
            return _OPERATORS[type(operator)](_value(left, columns), _value(right, columns))
        case ast.Call(func=ast.Name(id=name), args=[inner, *more]):
            value = _value(inner, columns)
            if name in _OF_SAMPLES:
                return _OF_SAMPLES[name](value)
            known = value[~np.isnan(value)]
            if name == "missing":
                return 1.0 - known.size / value.size if value.size else np.nan
            if not known.size:
                return np.nan
            if more:
                return np.percentile(known, _value(more[0], columns))
            return _OVER_SAMPLES[name](known)
    raise AssertionError(ast.dump(node))
