"""This module gives numba's `njit`, after the folder for compiled code has been set.

Named tuples are passed whole from one compiled function to another. Numba would pass each of their
fields as an argument of its own. As most functions take the rig's parameters, of which there are
more than a hundred, the calls would be most of the code to be compiled.
"""

from .compile_cache import use_compile_cache

use_compile_cache()

from typing import Any  # noqa: E402 (numba reads at its import where compiled code is kept)

from numba import njit as njit, types  # noqa: E402
from numba.core.datamodel import models  # noqa: E402
from numba.core.datamodel.registry import default_manager  # noqa: E402


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
