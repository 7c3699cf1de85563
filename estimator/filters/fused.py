"""Fused multiply-add for compiled code, which rounds once and gives the same bits everywhere."""

import ctypes
from collections.abc import Callable
from typing import Any, Final, cast

from llvmlite import ir
from numba import config, float64
from numba.extending import intrinsic

from rig.lanes import emit_function, lanes


def emit_fma(builder: Any, a: Any, b: Any, c: Any) -> Any:
    """Emit a*b + c, rounded once, for LLVM values that are floats or vectors of lanes."""
    if a.type == ir.DoubleType():
        return builder.fma(a, b, c)
    return emit_function("fma", builder, a, b, c)


def _fma(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return emit_fma(builder, *arguments)

    kind = lanes if lanes in (a, b, c) else float64
    return kind(kind, kind, kind), emit


def _c_fma() -> Callable[[float, float, float], float]:
    """Return `fma` of the C library, for runs with NUMBA_DISABLE_JIT.

    Python itself has no such function before 3.13.
    """
    # The C mathematics library is loaded already, as numpy is linked with it.
    function = ctypes.CDLL(None).fma
    function.restype, function.argtypes = ctypes.c_double, [ctypes.c_double] * 3
    return cast(Callable[[float, float, float], float], function)


INTERPRETED: Final = bool(config.DISABLE_JIT)  # type: ignore[attr-defined]

fma = _c_fma() if INTERPRETED else cast(Callable[[float, float, float], float], intrinsic(_fma))
"""Function of (a, b, c) that returns a*b + c, rounded once (IEEE 754 fusedMultiplyAdd), for floats
or lanes."""
