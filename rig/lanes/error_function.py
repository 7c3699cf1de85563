"""The complementary error function on lanes.

It has no short series that is accurate everywhere, so the C library's function is called for one
lane after another. It is therefore slow, and is only to be asked where some lane needs it.
"""

import math

from llvmlite import ir
from numba.core import cgutils

from .choosing import INLINED
from .kinds import LANES, intrinsic, lanes, overload


@intrinsic
def _of_each(typing_context, numbers):
    """Return erfc of the number in each lane."""

    def emit(context, builder, signature, arguments):
        kind = ir.FunctionType(ir.DoubleType(), [ir.DoubleType()])
        function = cgutils.get_or_insert_function(builder.module, kind, "erfc")
        found = ir.Constant(arguments[0].type, ir.Undefined)
        for lane in range(LANES):
            index = ir.Constant(ir.IntType(32), lane)
            one = builder.call(function, [builder.extract_element(arguments[0], index)])
            found = builder.insert_element(found, one, index)
        return found

    return lanes(lanes), emit


@overload(math.erfc, jit_options=INLINED)
def _erfc(x):
    return (lambda x: _of_each(x)) if x == lanes else None
