"""Functions that replace branches where lanes may differ; on floats they have the same result.

If they are not compiled, they work on any conditions that have a truth value.
"""

from typing import Any, Final

from llvmlite import ir
from numba import types

from .kinds import LANES, intrinsic, lanes, overload, truths

INLINED: Final = {"forceinline": True, "error_model": "numpy"}


@intrinsic
def _select(typing_context, condition, chosen, other):
    kind = lanes if lanes in (chosen, other) or condition == truths else types.float64

    def emit(context, builder, signature, arguments):
        return builder.select(*arguments)

    return kind(condition, kind, kind), emit


@intrinsic
def _any(typing_context, condition):
    def emit(context, builder, signature, arguments):
        bits = builder.bitcast(arguments[0], ir.IntType(LANES))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(condition), emit


def select(condition: Any, chosen: Any, other: Any) -> Any:
    """Return `chosen` in lanes where the condition holds, else `other`.

    Both are computed beforehand, so that neither may raise or have side effects.
    """
    return chosen if condition else other


@overload(select, jit_options=INLINED)
def _select_compiled(condition, chosen, other):
    return lambda condition, chosen, other: _select(condition, chosen, other)


def anywhere(condition: Any) -> Any:
    """Return whether a condition holds in at least one lane; on floats, whether it holds."""
    return condition


@overload(anywhere, jit_options=INLINED)
def _anywhere_compiled(condition):
    if condition == truths:
        return lambda condition: _any(condition)
    return lambda condition: condition


def everywhere(condition: Any) -> Any:
    """Return whether a condition holds in all lanes; on floats, whether it holds."""
    return condition


@overload(everywhere, jit_options=INLINED)
def _everywhere_compiled(condition):
    if condition == truths:
        return lambda condition: not _any(~condition)
    return lambda condition: condition
