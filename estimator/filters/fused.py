"""Fused multiply-add for compiled code: one rounding, the same bits wherever it is inlined."""

import ctypes
from collections.abc import Callable
from typing import Any, Final, cast

from numba import config, float64
from numba.extending import intrinsic

from rig.lanes import emit_function, lanes


def _fma(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        if kind == lanes:
            return emit_function("fma", builder, *arguments)
        return builder.fma(*arguments)

    kind = lanes if lanes in (a, b, c) else float64
    return kind(kind, kind, kind), emit


def _c_fma() -> Callable[[float, float, float], float]:
    """Return the C library's, for NUMBA_DISABLE_JIT; Python has none before 3.13."""
    # What numpy is linked with is loaded, the mathematics of C among it.
    function = ctypes.CDLL(None).fma
    function.restype, function.argtypes = ctypes.c_double, [ctypes.c_double] * 3
    return cast(Callable[[float, float, float], float], function)


_INTERPRETED: Final = bool(config.DISABLE_JIT)  # type: ignore[attr-defined]

fma = _c_fma() if _INTERPRETED else cast(Callable[[float, float, float], float], intrinsic(_fma))
"""a*b + c rounded once (IEEE 754 fusedMultiplyAdd), of floats or lanes."""
