"""Where lanes lie in memory: rows that begin where the processor's cache lines begin.

A vector of AVX-512 is as long as a cache line. One that lies across two of them takes twice the
reads and more than twice the writes. Neither numpy nor the compiler's stack sees to it by itself.
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
"""Bytes of a float64."""
_OF_LINE: Final = CACHE_LINE // _NUMBER


@njit(cache=True, error_model="numpy", nogil=True)
def empty_lanes(rows):
    """Return a float64 array (rows, LANES), C-contiguous, that begins with a cache line."""
    count = rows * LANES
    numbers = np.empty(count + _OF_LINE - 1)
    first = -(numbers.ctypes.data // _NUMBER) % _OF_LINE
    return numbers[first : first + count].reshape((rows, LANES))


def aligned(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a copy of an array (..., LANES) that begins with a cache line."""
    place: Any = empty_lanes
    copy: NDArray[np.float64] = place(array.size // LANES).reshape(array.shape)
    copy[...] = array
    return copy


@intrinsic
def align_stack(typing_context):
    """Begin the stack of this function with a cache line: what no register holds lies there.

    LLVM aligns it where a variable asks for it, and not for vectors that it puts there by itself.
    """

    def emit(context, builder, signature, arguments):
        variable = cgutils.alloca_once(builder, VECTOR)
        variable.align = CACHE_LINE
        # No instruction, but a use: without one the variable would vanish.
        use = ir.FunctionType(ir.VoidType(), [variable.type])
        builder.call(ir.InlineAsm(use, "", "r,~{memory}", side_effect=True), [variable])
        return context.get_dummy_value()

    return types.void(), emit
