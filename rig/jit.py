"""This module gives numba's `njit`, after the folder for compiled code has been set.

Named tuples are passed whole from one compiled function to another. Numba would pass each of their
fields as an argument of its own, and read each from Python by code of its own. As most functions
take the rig's parameters, of which there are more than a hundred, this would be most of the code to
be compiled.

The signature of an operator for given types is looked up once and kept. Numba would try all
definitions of the operator at each place where it stands, which takes a fifth of the time that
compiling takes.

What nobody here uses is left out: the times and events by which numba tells how it compiles, the
entry of each function for C, and the sizes in the message about an array that does not fit the
slice to which it is assigned.
"""

from .compile_cache import use_compile_cache

use_compile_cache()

from collections.abc import Iterator  # noqa: E402
from contextlib import contextmanager  # noqa: E402
from functools import partial  # noqa: E402
from types import FunctionType  # noqa: E402
from typing import Any, Final  # noqa: E402 (numba reads at its import where compiled code is kept)

from llvmlite import binding, ir  # noqa: E402
from numba import njit as _njit, types  # noqa: E402
from numba.core import cgutils, event  # noqa: E402
from numba.core.boxing import unbox_tuple  # noqa: E402
from numba.core.codegen import CPUCodeLibrary, JITCodeLibrary  # noqa: E402
from numba.core.compiler import Compiler  # noqa: E402
from numba.core.datamodel import models  # noqa: E402
from numba.core.datamodel.registry import default_manager  # noqa: E402
from numba.core.pythonapi import NativeValue, unbox  # noqa: E402
from numba.core.types.functions import BaseFunction  # noqa: E402
from numba.core.typing.templates import _OverloadFunctionTemplate  # noqa: E402
from numba.extending import overload  # noqa: E402
from numba.np import arrayobj  # noqa: E402

_ENVIRONMENT: Final = "_ZN08NumbaEnv"
"""Beginning of the names that numba gives to the variables through which functions reach Python's
objects. Numba fills these variables in, so that they must exist."""


def njit(*given: Any, **options: Any) -> Any:
    """Decorate a function as numba's `njit` does.

    Only a function that is decorated with its signature has an entry for C, by which compiled code
    calls a function that is passed to it as an argument of type `numba.types.FunctionType`.
    """
    if not given or isinstance(given[0], FunctionType):
        options.setdefault("no_cfunc_wrapper", True)
    return _njit(*given, **options)


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


class PartCompiler(Compiler):
    """The compiler of parts (`rig.plant.compiled`), given to `njit` as its pipeline class."""

    def compile_extra(self, func: Any) -> Any:
        """Compile a function into a library without machine code and return numba's result."""
        library = _PartLibrary(self.state.targetctx.codegen(), func.__qualname__)
        library.enable_object_caching()
        self.state.library = library
        return super().compile_extra(func)


class _Whole:
    """The part of a data model that says how a value is passed as an argument: as it is."""

    def get_argument_type(self) -> Any:
        return self.get_value_type()  # type: ignore[attr-defined]

    def as_argument(self, builder: Any, value: Any) -> Any:
        return value

    def from_argument(self, builder: Any, value: Any) -> Any:
        return value


class _WholeTuple(_Whole, models.TupleModel):
    """The data model of named tuples whose fields differ in type."""


class _WholeUniTuple(_Whole, models.UniTupleModel):
    """The data model of named tuples whose fields are all of one type."""


default_manager.register(types.NamedTuple, _WholeTuple)
default_manager.register(types.NamedUniTuple, _WholeUniTuple)


@unbox(types.NamedUniTuple)
def _read(kind: Any, given: Any, c: Any) -> Any:
    """Emit code that reads a named tuple from Python: floats in a loop, others as numba does."""
    if kind.dtype != types.float64:
        return unbox_tuple(kind, given, c)
    size = c.context.get_value_type(types.intp)
    fields = cgutils.alloca_once(c.builder, c.context.get_value_type(kind))
    item = cgutils.get_or_insert_function(
        c.builder.module, ir.FunctionType(c.pyapi.pyobj, [c.pyapi.pyobj, size]), "PyTuple_GetItem"
    )
    with cgutils.for_range(c.builder, ir.Constant(size, len(kind))) as loop:
        number = c.pyapi.float_as_double(c.builder.call(item, [given, loop.index]))
        c.builder.store(number, cgutils.gep_inbounds(c.builder, fields, 0, loop.index))
    failed = cgutils.is_not_null(c.builder, c.pyapi.err_occurred())
    return NativeValue(c.builder.load(fields), is_error=failed)


_ask = BaseFunction.get_call_type


def _remembered(self: Any, context: Any, args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
    """Return the signature of an operator or another built-in function for given types.

    This stands in place of numba's method. Signatures of numba's own definitions are kept with the
    function's type, which is made anew when definitions are added. The signature of a definition
    that is itself compiled depends on the caller's options too, and is looked up each time.
    """
    if kws:
        return _ask(self, context, args, kws)
    answers = self.__dict__.setdefault("_answers", {})
    if args not in answers:
        signature = _ask(self, context, args, kws)
        if self.get_impl_key(signature) is not self.typing_key:
            return signature
        answers[args] = signature
    return answers[args]


BaseFunction.get_call_type = _remembered  # type: ignore[assignment, method-assign]

_decorate = _OverloadFunctionTemplate._get_jit_decorator


def _as_parts(self: Any) -> Any:
    """Return the decorator that compiles a definition of a function which compiled code may call.

    This stands in place of numba's method. Such a definition, as that of `max`, is a part of the
    functions that call it, and each process compiles it anew.
    """
    return partial(_decorate(self), pipeline_class=PartCompiler, no_cfunc_wrapper=True)


_OverloadFunctionTemplate._get_jit_decorator = _as_parts  # type: ignore[method-assign]


def _optimise_functions(self: Any, module: Any) -> None:
    """Optimise each function of an LLVM module that has code, and leave out mere declarations.

    This stands in place of numba's method, which does the same for declarations too.
    """
    module.data_layout = self._codegen._data_layout
    for function in module.functions:
        if not function.is_declaration:
            passes, builder = self._codegen._function_pass_manager()
            with self._recorded_timings.record(f"Function passes on {function.name!r}", builder):
                passes.run(function, builder)


CPUCodeLibrary._optimize_functions = _optimise_functions  # type: ignore[method-assign]


@contextmanager
def _untimed(kind: Any, callback: Any) -> Iterator[None]:
    """Measure no time in this context.

    This stands in place of numba's function, by which each function that is being compiled, with
    all that wait for it, would count each call of the optimiser.
    """
    yield


event.install_timer = _untimed
# Else two events would be made for each call of LLVM.
binding.ffi.lib._lock._cblist.clear()


def _refuse_shape(src_shapes: Any, index_shape: Any) -> None:
    """Stand for compiled code that refuses to assign an array to a slice of another shape.

    Numba's own code for this writes both shapes into the message. Each process would compile
    numba's functions for texts for that, which takes two seconds.

    Raises:
        ValueError: always, in compiled code.
    """
    raise NotImplementedError


@overload(_refuse_shape)
def _refuse_shape_compiled(src_shapes: Any, index_shape: Any) -> Any:
    def refuse(src_shapes: Any, index_shape: Any) -> None:
        raise ValueError("cannot assign slice from input of different size")

    return refuse


arrayobj.raise_with_shape_context = _refuse_shape
