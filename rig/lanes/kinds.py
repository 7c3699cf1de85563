"""The compiler's two types of lanes: numbers and truth values, each a vector of LLVM."""

from typing import Any, Final

import numba.extending
from llvmlite import ir
from numba import types
from numba.core.typeconv.castgraph import Conversion
from numba.extending import lower_cast, models, register_model

LANES: Final = 8
"""Number of rigs that are computed together: one vector of AVX-512, or two of AVX2."""

VECTOR: Final = ir.VectorType(ir.DoubleType(), LANES)
BITS: Final = ir.VectorType(ir.IntType(64), LANES)
TRUTHS: Final = ir.VectorType(ir.IntType(1), LANES)
# Typed as Any: by numba's annotations, callers would have to pass the context that numba adds.
intrinsic: Final[Any] = numba.extending.intrinsic
overload: Final[Any] = numba.extending.overload
overload_attribute: Final[Any] = numba.extending.overload_attribute

NUMBERS: Final = (types.Float, types.Integer)


class LanesType(types.Type):
    """The compiler's type of float64 numbers, one for each lane."""

    def __init__(self) -> None:
        super().__init__("lanes")

    def can_convert_from(self, typing_context: Any, other: Any) -> Any:
        """Return a safe conversion from a number, which fills all lanes; None for other types."""
        return Conversion.safe if isinstance(other, NUMBERS) else None

    def unify(self, typing_context: Any, other: Any) -> Any:
        """Return lanes as the type of a variable that is a number on another path; else None."""
        return self if isinstance(other, NUMBERS) else None


class TruthsType(types.Type):
    """The compiler's type of truth values, one for each lane."""

    def __init__(self) -> None:
        super().__init__("truths")

    def can_convert_from(self, typing_context: Any, other: Any) -> Any:
        """Return a safe conversion from a boolean, which fills all lanes; None for other types."""
        return Conversion.safe if isinstance(other, types.Boolean) else None

    def unify(self, typing_context: Any, other: Any) -> Any:
        """Return truths as the type of a variable that is a boolean on another path; else None."""
        return self if isinstance(other, types.Boolean) else None


lanes: Final = LanesType()
truths: Final = TruthsType()


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VECTOR)


@register_model(TruthsType)
class _TruthsModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, TRUTHS)


def in_all_lanes(builder: Any, value: Any, vector: Any) -> Any:
    """Emit code that puts one value into all lanes; return the vector, of LLVM type `vector`."""
    nothing = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(nothing, value, ir.Constant(ir.IntType(32), 0))
    order = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(first, nothing, order)


@lower_cast(types.Float, LanesType)
@lower_cast(types.Integer, LanesType)
def _number_in_lanes(context: Any, builder: Any, given: Any, _: Any, value: Any) -> Any:
    return in_all_lanes(builder, context.cast(builder, value, given, types.float64), VECTOR)


@lower_cast(types.Boolean, TruthsType)
def _truth_in_lanes(context: Any, builder: Any, given: Any, _: Any, value: Any) -> Any:
    return in_all_lanes(builder, value, TRUTHS)
