"""The compiler's types of lanes: numbers and truth values, each a vector of LLVM."""

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
    """The compiler's type of values of one kind, one for each lane.

    Args:
        name: name of the type.
        of: numba type of each value; values of this kind fill all lanes where lanes are asked for.
        vector: LLVM's type of all values together.
    """

    def __init__(self, name: str, of: Any, vector: Any) -> None:
        self.of, self.vector = of, vector
        super().__init__(name)

    def _is_filled_by(self, other: Any) -> bool:
        return isinstance(other, types.Boolean if self.of == types.boolean else NUMBERS)

    def can_convert_from(self, typing_context: Any, other: Any) -> Any:
        """Return a safe conversion from one value, which fills all lanes; None for other types."""
        return Conversion.safe if self._is_filled_by(other) else None

    def unify(self, typing_context: Any, other: Any) -> Any:
        """Return the type of a variable that has this type on one path and `other` on another.

        It is this type if `other` is that of one value, which then fills all lanes; else None.
        """
        return self if self._is_filled_by(other) else None


lanes: Final = LanesType("lanes", types.float64, VECTOR)
truths: Final = LanesType("truths", types.boolean, TRUTHS)


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, kind.vector)


def in_all_lanes(builder: Any, value: Any, vector: Any) -> Any:
    """Emit code that puts one value into all lanes; return the vector, of LLVM type `vector`."""
    nothing = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(nothing, value, ir.Constant(ir.IntType(32), 0))
    order = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(first, nothing, order)


@lower_cast(types.Boolean, LanesType)
@lower_cast(types.Float, LanesType)
@lower_cast(types.Integer, LanesType)
def _fill_lanes(context: Any, builder: Any, given: Any, kind: Any, value: Any) -> Any:
    return in_all_lanes(builder, context.cast(builder, value, given, kind.of), kind.vector)
