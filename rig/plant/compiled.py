"""Compiles functions that are parts of larger ones, without making machine code of each part.

Numba makes machine code of every function, and optimises each function anew together with all that
it calls. For a part neither is ever used: the code of a part is copied into the functions that call
it, and becomes machine code there. So a part is kept as it is before both steps, which saves a
third of the time. A part also has no entry for Python: if Python calls a part while the compiler is
on, the process crashes.
"""

from typing import Any, Final

from llvmlite import binding, ir
from numba import typeof, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler

from rig.jit import njit
from rig.lanes import intrinsic

_ENVIRONMENT: Final = "_ZN08NumbaEnv"
"""What numba lets the names of the variables begin with by which functions reach Python's objects;
it fills them in, so that they must be there."""


class _PartLibrary(JITCodeLibrary):
    """The code of one part, for other functions to take over."""

    def _optimize_final_module(self) -> None:
        """Leave it as it is: the functions that take it over are optimised with it."""

    def _finalize_final_module(self) -> None:
        """Keep the code for others, and hand nothing but its variables on to become machine code.

        What is handed on is what numba also writes to its cache as this function's machine code.
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
    """The compiler of parts; `njit` asks for one by this class."""

    def compile_extra(self, func: Any) -> Any:
        """Compile a function into a library of the kind above."""
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
"""Compile a function that only compiled code calls."""

inlined: Final[Any] = njit(**_OPTIONS, forceinline=True)
"""Compile as `inner` does, and put the code where it is called, whatever its size."""


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
    """Return a named tuple of floats with the field of a literal number replaced by a float."""

    def emit(context, builder, signature, arguments):
        return builder.insert_value(arguments[0], arguments[2], index.literal_value)

    return fields(fields, index, types.float64), emit
