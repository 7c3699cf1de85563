"""This module has what compiled code of the servo-actuator shares, alone and in lanes."""

from typing import Any, Final

import numba.extending
from numba import types
from numba.core import cgutils

from rig.plant import Parameters

SEEN_1: Final = 9
SEEN_2: Final = 10
"""SEEN_1 and SEEN_2 are the indices of the pressures behind the lag of their transducers. These
states come after the rig's own."""

_PARAMETERS_TYPE: Final = types.NamedUniTuple(types.float64, len(Parameters._fields), Parameters)
# With its declared type, callers would have to pass the context that numba adds by itself.
intrinsic: Final[Any] = numba.extending.intrinsic


@intrinsic
def parameters_of(typing_context, values):
    """Return the `Parameters` of an array float64 (count,), in compiled code.

    The array holds a value for each field, in the order of the fields.
    """

    def emit(context, builder, signature, arguments):
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        fields = [
            builder.load(cgutils.gep_inbounds(builder, data, index))
            for index in range(len(Parameters._fields))
        ]
        return context.make_tuple(builder, signature.return_type, fields)

    return _PARAMETERS_TYPE(values), emit
