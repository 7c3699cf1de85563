"""Alignment of lanes in memory: rows begin where the processor's cache lines begin.

A vector of AVX-512 is as long as a cache line. A vector that lies across two cache lines takes
twice as long to read and more than twice as long to write. Neither numpy nor the compiler's stack
aligns vectors by itself.
"""

from typing import Any, Final

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numpy.typing import NDArray

from rig.jit import njit

from .kinds import LANES, VECTOR, intrinsic

CACHE_LINE: Final = 64
_NUMBER: Final = 8
"""Size of a float64 in bytes."""
_OF_LINE: Final = CACHE_LINE // _NUMBER


@njit(cache=True, error_model="numpy", nogil=True)
def empty_lanes(rows):
    """Return an unfilled float64 array (rows, LANES), C-contiguous, aligned to a cache line."""
    count = rows * LANES
    numbers = np.empty(count + _OF_LINE - 1)
    first = -(numbers.ctypes.data // _NUMBER) % _OF_LINE
    return numbers[first : first + count].reshape((rows, LANES))


def aligned(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a copy of an array (..., LANES) that is aligned to a cache line."""
    place: Any = empty_lanes
    copy: NDArray[np.float64] = place(array.size // LANES).reshape(array.shape)
    copy[...] = array
    return copy


@intrinsic
def align_stack(typing_context):
    """Align the stack of the calling compiled function to a cache line.

    The stack holds vectors for which no register is free. LLVM aligns the stack only if a variable
    asks for it, and not for vectors that it stores there by itself; this makes such a variable.
    """

    def emit(context, builder, signature, arguments):
        variable = cgutils.alloca_once(builder, VECTOR)
        variable.align = CACHE_LINE
        # This makes no instruction, but it uses the variable, which would be removed otherwise.
        use = ir.FunctionType(ir.VoidType(), [variable.type])
        builder.call(ir.InlineAsm(use, "", "r,~{memory}", side_effect=True), [variable])
        return context.get_dummy_value()

    return types.void(), emit
