"""Compilation of functions that are parts of larger ones, without machine code for each part.

Numba normally makes machine code of every function, and optimises each function again together with
all that it calls. For a part neither result is ever used, as the code of a part is copied into the
functions that call it and becomes machine code there. Both steps are therefore left out for parts,
which saves a third of the time. A part also has no entry for Python: if Python calls a part while
the compiler is on, the process crashes.
"""

from typing import Any, Final

from numba import typeof, types

from rig.jit import PartCompiler, njit
from rig.lanes import intrinsic

_OPTIONS: Final[dict[str, Any]] = {
    "cache": True,
    "error_model": "numpy",
    "nogil": True,
    "no_cpython_wrapper": True,
    "pipeline_class": PartCompiler,
}

inner: Final[Any] = njit(**_OPTIONS, forceinline=False)
"""Decorator that compiles a function which only compiled code may call."""

inlined: Final[Any] = njit(**_OPTIONS, forceinline=True)
"""Decorator that compiles as `inner` does and always inlines the code in its callers."""


def compile_part(part: Any, *arguments: Any) -> None:
    """Compile a part ahead of the functions that call it.

    A caller would compile the part anyway, so this call is never necessary. It puts the part into
    the cache, so that several processes can share the work of compiling.

    Args:
        part: a function that is decorated with `inner` or `inlined`.
        arguments: one for each parameter: an example value, whose type is taken, or a numba type.
    """
    part.compile(
        tuple(each if isinstance(each, types.Type) else typeof(each) for each in arguments)
    )


@intrinsic(prefer_literal=True)
def with_field(typing_context, fields, index, value):
    """Return a named tuple of floats with one field replaced by `value`.

    The field's index is a literal; the original tuple does not change.
    """

    def emit(context, builder, signature, arguments):
        return builder.insert_value(arguments[0], arguments[2], index.literal_value)

    return fields(fields, index, types.float64), emit
