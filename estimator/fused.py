"""Fused multiply-add for compiled code: one rounding, the same bits wherever it is inlined."""

from collections.abc import Callable
from typing import Any, cast

from numba import float64
from numba.extending import intrinsic


def _fma(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return float64(float64, float64, float64), emit


fma = cast(Callable[[float, float, float], float], intrinsic(_fma))
"""a*b + c rounded once (IEEE 754 fusedMultiplyAdd); in compiled code only."""
