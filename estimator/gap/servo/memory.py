"""Where the rig's plant keeps what, and its parameters in compiled code."""

from typing import Any, Final

import numba.extending
from numba import types
from numba.core import cgutils

from rig.plant import PATH_SIZE, TRANSDUCERS_SIZE, Parameters

SEEN_1: Final = 9
SEEN_2: Final = 10
"""Indices of the pressures behind the lag of their transducers, after the rig's own states."""

# The memory: the command, its path as it is and as it is after the step, the encoder's, how far
# what it sees is behind the ram; where the ram was last remembered, and what was corrected of that.
COMMAND: Final = 0
PATH: Final = 1
NEXT: Final = PATH + PATH_SIZE
SEEN: Final = NEXT + PATH_SIZE
BEHIND: Final = SEEN + TRANSDUCERS_SIZE
REMEMBERED: Final = BEHIND + 1
CORRECTED: Final = REMEMBERED + 1
MEMORY: Final = CORRECTED + 1

_PARAMETERS_TYPE: Final = types.NamedUniTuple(types.float64, len(Parameters._fields), Parameters)
# As it is declared, its arguments would count the context that numba adds.
intrinsic: Final[Any] = numba.extending.intrinsic


@intrinsic
def parameters_of(typing_context, values):
    """Return `Parameters` of an array (count,)."""

    def emit(context, builder, signature, arguments):
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        fields = [
            builder.load(cgutils.gep_inbounds(builder, data, index))
            for index in range(len(Parameters._fields))
        ]
        return context.make_tuple(builder, signature.return_type, fields)

    return _PARAMETERS_TYPE(values), emit
