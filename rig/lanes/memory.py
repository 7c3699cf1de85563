"""Lanes in memory: the lane is an array's last index, so that a row is loaded at once.

Rows begin where the processor's cache lines begin. A vector of AVX-512 is as long as a cache line.
A vector that lies across two cache lines takes twice as long to read and more than twice as long to
write. Neither numpy nor the compiler's stack aligns vectors by itself.
"""

from typing import Any, Final

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numpy.typing import NDArray

from rig.jit import njit

from .kinds import BITS, LANES, TRUTHS, VECTOR, in_all_lanes, intrinsic, lanes, truths

ALIGNMENT: Final = 8
"""Size of a float64 in bytes."""
CACHE_LINE: Final = 64
_OF_LINE: Final = CACHE_LINE // ALIGNMENT
_ALIGNED: Final = ir.Constant(ir.IntType(32), ALIGNMENT)
_BYTE_ADDRESS: Final = ir.IntType(64)
_POINTERS: Final = ir.VectorType(ir.PointerType(), LANES)


def _row(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    """Return a pointer to row `index` of an array (n, LANES)."""
    view = context.make_array(kind)(context, builder, array)
    first = builder.mul(index, ir.Constant(index.type, LANES))
    return builder.bitcast(builder.gep(view.data, [first]), VECTOR.as_pointer())


@intrinsic
def load(typing_context, array, index):
    """Return row `index` of a C-contiguous float64 array (n, LANES) as lanes."""

    def emit(context, builder, signature, arguments):
        pointer = _row(context, builder, signature.args[0], *arguments)
        return builder.load(pointer, align=ALIGNMENT)

    return lanes(array, types.intp), emit


@intrinsic
def store(typing_context, array, index, value):
    """Write lanes to row `index` of a C-contiguous float64 array (n, LANES)."""

    def emit(context, builder, signature, arguments):
        pointer = _row(context, builder, signature.args[0], *arguments[:2])
        builder.store(arguments[2], pointer, align=ALIGNMENT)
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes), emit


def _elements(context: Any, builder: Any, kind: Any, array: Any, rows: Any) -> Any:
    """Return pointers to element (rows[j], j) of an array (n, LANES), one for each lane j."""
    view = context.make_array(kind)(context, builder, array)
    first = builder.ptrtoint(view.data, _BYTE_ADDRESS)
    addresses = in_all_lanes(builder, first, BITS)
    lane = ir.Constant(BITS, [ALIGNMENT * i for i in range(LANES)])
    width = ir.Constant(BITS, [ALIGNMENT * LANES] * LANES)
    offsets = builder.add(builder.mul(builder.fptosi(rows, BITS), width), lane)
    return builder.inttoptr(builder.add(addresses, offsets), _POINTERS)


def _masked(builder: Any, name: str, result: Any, arguments: Any) -> Any:
    """Emit a call of LLVM's function `llvm.masked.<name>` on lanes; return its result."""
    kind = ir.FunctionType(result, [argument.type for argument in arguments])
    name_of_vector = f"llvm.masked.{name}.v{LANES}f64.v{LANES}p0"
    function = cgutils.get_or_insert_function(builder.module, kind, name_of_vector)
    return builder.call(function, arguments)


@intrinsic
def gather(typing_context, array, rows):
    """Return lanes with element (rows[j], j) of a C-contiguous float64 array (n, LANES) in lane j.

    The rows are given as lanes of whole numbers, each from 0 to n - 1; this is not checked.
    """

    def emit(context, builder, signature, arguments):
        pointers = _elements(context, builder, signature.args[0], *arguments)
        everywhere, nothing = ir.Constant(TRUTHS, [1] * LANES), ir.Constant(VECTOR, ir.Undefined)
        return _masked(builder, "gather", VECTOR, [pointers, _ALIGNED, everywhere, nothing])

    return lanes(array, lanes), emit


@intrinsic
def scatter(typing_context, array, rows, values, where):
    """Write lane j of `values` to element (rows[j], j) of an array if `where` is true in lane j.

    Array and rows are as in `gather`.
    """

    def emit(context, builder, signature, arguments):
        array, rows, values, where = arguments
        pointers = _elements(context, builder, signature.args[0], array, rows)
        _masked(builder, "scatter", ir.VoidType(), [values, pointers, _ALIGNED, where])
        return context.get_dummy_value()

    return types.void(array, lanes, lanes, truths), emit


@intrinsic(prefer_literal=True)
def load_fields(typing_context, array, like, shared):
    """Return a named tuple of the type of `like` whose field i is row i of an array, as lanes.

    The array is float64 (n, LANES). The field with index `shared`, a literal, is not lanes: it is
    one value for all lanes, taken from `like` with its type there.
    """
    kinds: list[Any] = [lanes] * len(like)
    kinds[shared.literal_value] = like.types[shared.literal_value]
    fields = types.NamedTuple(kinds, like.instance_class)

    def emit(context, builder, signature, arguments):
        rows = []
        for i, kind in enumerate(kinds):
            if kind == lanes:
                index = context.get_constant(types.intp, i)
                pointer = _row(context, builder, signature.args[0], arguments[0], index)
                rows.append(builder.load(pointer, align=ALIGNMENT))
            else:
                rows.append(builder.extract_value(arguments[1], i))
        return context.make_tuple(builder, fields, rows)

    return fields(array, like, shared), emit


@njit(cache=True, error_model="numpy", nogil=True)
def empty_lanes(rows):
    """Return an unfilled float64 array (rows, LANES), C-contiguous, aligned to a cache line."""
    count = rows * LANES
    numbers = np.empty(count + _OF_LINE - 1)
    first = -(numbers.ctypes.data // ALIGNMENT) % _OF_LINE
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
