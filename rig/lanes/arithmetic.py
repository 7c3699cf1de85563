"""Operators and functions on lanes, which this module registers with the compiler."""

import math
import operator
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin

from .choosing import INLINED
from .kinds import LANES, NUMBERS, VECTOR, LanesType, lanes, overload, overload_attribute, truths

Emit = Callable[..., Any]
"""A function of LLVM's builder and the arguments' vectors that returns the vector of the result."""


def _teach(function: Any, result: Any, arguments: tuple[Any, ...], emit: Emit) -> None:
    """Register a Python function on lanes with the compiler.

    A plain number among the arguments of a call counts as the same number in all lanes.

    Args:
        function: the function or operator.
        result: numba type of the result, `lanes` or `truths`.
        arguments: numba type of each argument.
        emit: writes the instructions that compute the result.
    """

    class Typed(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            if len(args) != len(arguments) or not any(given in arguments for given in args):
                return None
            fit = all(given in arguments or isinstance(given, NUMBERS) for given in args)
            return signature(result, *arguments) if fit else None

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return emit(builder, *args)

    infer_global(function)(Typed)
    lower_builtin(function, *arguments)(lower)


def _instruction(name: str) -> Emit:
    return lambda builder, *args: getattr(builder, name)(*args)


def emit_function(name: str, builder: Any, *args: Any) -> Any:
    """Emit a call of LLVM's function `llvm.<name>` on vectors of lanes; return its result."""
    kind = ir.FunctionType(VECTOR, [VECTOR] * len(args))
    name_of_vector = f"llvm.{name}.v{LANES}f64"
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name_of_vector), args)


def _comparison(sign: str) -> Emit:
    """Return an `Emit` for a comparison by IEEE 754: with a NaN, only != is true."""
    compare = "fcmp_unordered" if sign == "!=" else "fcmp_ordered"
    return lambda builder, a, b: getattr(builder, compare)(sign, a, b)


def _extreme(sign: str) -> Emit:
    """Return an `Emit` for min ("<") or max (">"), with the same result for NaN as on floats.

    The result is b where b is beyond a, and a elsewhere.
    """
    return lambda builder, a, b: builder.select(builder.fcmp_ordered(sign, b, a), b, a)


for _operator, _name in (
    (operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul"),
    (operator.truediv, "fdiv"), (operator.iadd, "fadd"), (operator.isub, "fsub"),
    (operator.imul, "fmul"),
):  # fmt: skip
    _teach(_operator, lanes, (lanes, lanes), _instruction(_name))
for _operator, _sign in (
    (operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">="),
    (operator.eq, "=="), (operator.ne, "!="),
):  # fmt: skip
    _teach(_operator, truths, (lanes, lanes), _comparison(_sign))
_teach(operator.and_, truths, (truths, truths), _instruction("and_"))
_teach(operator.or_, truths, (truths, truths), _instruction("or_"))
_teach(operator.invert, truths, (truths,), _instruction("not_"))
_teach(operator.neg, lanes, (lanes,), _instruction("fneg"))
_teach(abs, lanes, (lanes,), partial(emit_function, "fabs"))
_teach(min, lanes, (lanes, lanes), _extreme("<"))
_teach(max, lanes, (lanes, lanes), _extreme(">"))
_teach(math.sqrt, lanes, (lanes,), partial(emit_function, "sqrt"))
_teach(math.floor, lanes, (lanes,), partial(emit_function, "floor"))
_teach(math.copysign, lanes, (lanes, lanes), partial(emit_function, "copysign"))


@overload(np.sqrt, jit_options=INLINED)
def _sqrt(number):
    return (lambda number: math.sqrt(number)) if number == lanes else None


@overload_attribute(LanesType, "real", jit_options=INLINED)
def _real(number):
    return lambda number: number
