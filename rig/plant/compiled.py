"""Compilation of functions that are parts of larger ones, without machine code for each part.

Numba normally makes machine code of every function, and optimises each function again together with
all that it calls. For a part neither result is ever used, as the code of a part is copied into the
functions that call it and becomes machine code there. Both steps are therefore left out for parts,
which saves a third of the time. A part also has no entry for Python: if Python calls a part while
the compiler is on, the process crashes.
"""

from typing import Any, Final

from llvmlite import binding, ir
from numba import typeof, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler

from rig.jit import njit
from rig.lanes import intrinsic

_ENVIRONMENT: Final = "_ZN08NumbaEnv"
"""Beginning of the names that numba gives to the variables through which functions reach Python's
objects. Numba fills these variables in, so that they must exist."""


class _PartLibrary(JITCodeLibrary):
    """Numba's library for the code of one part, which other functions copy.

    Unlike numba's own, it neither optimises the code nor makes machine code of it.
    """

    def _optimize_final_module(self) -> None:
        """Do nothing: the code is optimised together with the functions that copy it."""

    def _finalize_final_module(self) -> None:
        """Keep the code for other functions, and make machine code of its variables only.

        Numba also writes this machine code to its cache as that of the function.
        """
        self._finalize_dynamic_globals()
        self._finalized = True
        self._get_module_for_linking()
        variables = self._codegen._create_empty_module(self.name)
        for found in self._final_module.global_variables:
            if found.name.startswith(_ENVIRONMENT):
                variable = ir.GlobalVariable(variables, ir.IntType(8).as_pointer(), found.name)
                variable.linkage = "common"
                variable.initializer = ir.Constant(variable.value_type, None)
        self._final_module = binding.parse_assembly(str(variables))
        super()._finalize_final_module()


class _PartCompiler(Compiler):
    """The compiler of parts, which is passed to `njit` as its pipeline class."""

    def compile_extra(self, func: Any) -> Any:
        """Compile a function into a `_PartLibrary` and return numba's result."""
        library = _PartLibrary(self.state.targetctx.codegen(), func.__qualname__)
        library.enable_object_caching()
        self.state.library = library
        return super().compile_extra(func)


_OPTIONS: Final[dict[str, Any]] = {
    "cache": True,
    "error_model": "numpy",
    "nogil": True,
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    "pipeline_class": _PartCompiler,
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
