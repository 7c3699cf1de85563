"""How functions are compiled that are part of larger ones.

What Python would call a function by takes as long to compile as the function itself, the more so
where its arguments are tuples of arrays. These have none: called from Python while the compiler is
on, they crash the process.
"""

from typing import Any, Final

from numba import njit, types

from .lanes.kinds import intrinsic

_OPTIONS: Final[dict[str, Any]] = {
    "cache": True,
    "error_model": "numpy",
    "nogil": True,
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}

inner: Final[Any] = njit(**_OPTIONS)
"""Compile a function that only compiled code calls."""

inlined: Final[Any] = njit(**_OPTIONS, forceinline=True)
"""As `inner`, and put its code where it is called, whatever its size."""


@intrinsic(prefer_literal=True)
def with_field(typing_context, fields, index, value):
    """Return a named tuple of floats with the field of a literal number replaced by a float."""

    def emit(context, builder, signature, arguments):
        return builder.insert_value(arguments[0], arguments[2], index.literal_value)

    return fields(fields, index, types.float64), emit
