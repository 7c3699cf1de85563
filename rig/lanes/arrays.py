"""Arrays of lanes that are indexed like arrays of floats, for functions that take either.

`in_lanes(array)` turns a float64 array (n, LANES) into an array (n,) of lanes, and one of
(m, n, LANES) into an array (m, n) of lanes. The result reads and writes the memory of the original
array but does not keep it alive. The caller must hold a reference to the original as long as the
result is used.
"""

import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import models, register_model

from .choosing import INLINED
from .kinds import LANES, VECTOR, intrinsic, lanes, overload, overload_attribute
from .memory import ALIGNMENT


class LaneArrayType(types.Type):
    """The compiler's type of an array of lanes with one or two dimensions."""

    def __init__(self, dimensions: int) -> None:
        self.dimensions = dimensions
        super().__init__(f"lane_array_{dimensions}d")


@register_model(LaneArrayType)
class _LaneArrayModel(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        shape = types.UniTuple(types.intp, kind.dimensions)
        members = [("memory", types.voidptr), ("shape", shape)]
        super().__init__(manager, kind, members)


@intrinsic
def in_lanes(typing_context, array):
    """Return a C-contiguous float64 array (..., LANES) as an array of lanes on the same memory.

    The array has two or three dimensions. The caller must keep it alive while the result is used.
    """
    kind = LaneArrayType(array.ndim - 1)

    def emit(context, builder, signature, arguments):
        given = context.make_array(array)(context, builder, arguments[0])
        made = cgutils.create_struct_proxy(kind)(context, builder)
        made.memory = builder.bitcast(given.data, cgutils.voidptr_t)
        sizes = cgutils.unpack_tuple(builder, given.shape)[:-1]
        made.shape = cgutils.pack_array(builder, sizes)
        return made._getvalue()

    return kind(array), emit


def _pointer(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    """Return a pointer to the element of an array of lanes at an index, an integer or a pair."""
    opened = cgutils.create_struct_proxy(kind)(context, builder, array)
    row = index
    if kind.dimensions > 1:
        first, second = cgutils.unpack_tuple(builder, index)
        row = builder.add(builder.mul(first, builder.extract_value(opened.shape, 1)), second)
    memory = builder.bitcast(opened.memory, ir.DoubleType().as_pointer())
    element = builder.gep(memory, [builder.mul(row, ir.Constant(row.type, LANES))])
    return builder.bitcast(element, VECTOR.as_pointer())


def _index_of(array: Any) -> Any:
    return types.intp if array.dimensions == 1 else types.UniTuple(types.intp, array.dimensions)


@intrinsic
def _read(typing_context, array, index):
    def emit(context, builder, signature, arguments):
        return builder.load(_pointer(context, builder, array, *arguments), align=ALIGNMENT)

    return lanes(array, _index_of(array)), emit


@intrinsic
def _write(typing_context, array, index, value):
    def emit(context, builder, signature, arguments):
        pointer = _pointer(context, builder, array, *arguments[:2])
        builder.store(arguments[2], pointer, align=ALIGNMENT)
        return context.get_dummy_value()

    return types.void(array, _index_of(array), lanes), emit


@overload(operator.getitem, jit_options=INLINED)
def _getitem(array, index):
    if isinstance(array, LaneArrayType):
        return lambda array, index: _read(array, index)
    return None


@overload(operator.setitem, jit_options=INLINED)
def _setitem(array, index, value):
    if isinstance(array, LaneArrayType):
        return lambda array, index, value: _write(array, index, value)
    return None


@intrinsic
def _shape_of(typing_context, array):
    def emit(context, builder, signature, arguments):
        return cgutils.create_struct_proxy(array)(context, builder, arguments[0]).shape

    return types.UniTuple(types.intp, array.dimensions)(array), emit


@overload_attribute(LaneArrayType, "shape", jit_options=INLINED)
def _shape(array):
    return lambda array: _shape_of(array)
